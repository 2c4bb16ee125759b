"""Kernels of MultibodyPlants against Drake: ports of instances, discrete steps."""

import numpy as np
import pytest
from kernel_checks import CheckKernel
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import (
    BallRpyJoint,
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    RevoluteSpring,
    SpatialInertia,
    UnitInertia,
    default_model_instance,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource, Sine

from teleop_drake.loops import simulate
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.plant_kernel import PlantKernel
from teleop_drake.loops.engine.run import CompiledRun


def body(plant, name, instance):
    inertia = UnitInertia.SolidBox(0.1, 0.2, 0.3).ShiftFromCenterOfMass([0, 0, -0.4])
    return plant.AddRigidBody(
        name, instance, SpatialInertia(0.7, np.array([0.0, 0.0, 0.4]), inertia)
    )


def two_cart_poles(time_step, has_sampled_outputs=True):
    """Returns two carts, each a model instance, with a pole each.

    All carts come before all poles, so that the elements of an instance are apart.
    """
    plant = MultibodyPlant(time_step)
    plant.set_name("plant")
    plant.SetUseSampledOutputPorts(time_step > 0 and has_sampled_outputs)
    limits = {"left": 100.0, "right": 0.5}
    carts = {}
    for name, limit in limits.items():
        carts[name] = body(plant, "cart", plant.AddModelInstance(name))
        frames = plant.world_frame(), carts[name].body_frame()
        rail = plant.AddJoint(PrismaticJoint(f"rail {name}", *frames, [1, 0, 0]))
        plant.AddJointActuator(f"motor {name}", rail, limit)
    for name, cart in carts.items():
        pole = body(plant, "pole", cart.model_instance())
        frames = cart.body_frame(), pole.body_frame()
        pin = plant.AddJoint(
            RevoluteJoint(f"pin {name}", *frames, [0, 1, 0], damping=0.3)
        )
        plant.AddJointActuator(f"pin motor {name}", pin, 3.0)
    plant.Finalize()
    return plant


def driven(plant):
    """Returns a diagram in which one instance is driven by a port of its own."""
    builder = DiagramBuilder()
    builder.AddSystem(plant)
    sine = Sine([2.0, 5.0], [3.0, 1.0], [0.1, 0.2], True)
    wave = builder.AddNamedSystem("wave", sine)
    push = builder.AddNamedSystem("push", ConstantVectorSource([0.3, -0.2, 0.1, 0.0]))
    right = plant.GetModelInstanceByName("right")
    builder.Connect(wave.get_output_port(0), plant.get_actuation_input_port(right))
    builder.Connect(
        push.get_output_port(), plant.get_applied_generalized_force_input_port()
    )
    return builder.Build()


def test_each_port_of_a_model_instance_is_that_of_the_plant():
    CheckKernel(two_cart_poles(0.0))
    CheckKernel(driven(two_cart_poles(0.0)))


def test_a_plant_in_a_diagram_without_outputs_is_recorded():
    recording = simulate(driven(two_cart_poles(0.0)), duration=0.1)
    assert recording.solver.engine == "compiled"
    # The motor of the right cart can do 0.5 N.
    efforts = recording.signals["plant.net_actuation"]
    assert efforts[:, 1].max() == 0.5
    np.testing.assert_array_equal(
        recording.signals["plant.right_net_actuation"], efforts[:, [1, 3]]
    )


def test_a_plant_with_a_force_on_a_body_runs_in_drake():
    plant = two_cart_poles(0.0)
    builder = DiagramBuilder()
    builder.AddSystem(plant)
    force = ExternallyAppliedSpatialForce()
    force.body_index = plant.GetBodyByName(
        "cart", plant.GetModelInstanceByName("left")
    ).index()
    force.F_Bq_W = SpatialForce(tau=[0, 0, 0], f=[2.0, 0, 0])
    forces = ConstantValueSource(Value[list[ExternallyAppliedSpatialForce]]([force]))
    source = builder.AddNamedSystem("force", forces)
    builder.Connect(
        source.get_output_port(), plant.get_applied_spatial_force_input_port()
    )
    recording = simulate(builder.Build(), duration=0.1)
    assert recording.solver.engine == "drake"
    assert "takes nothing from the input applied_spatial_force" in recording.notes[0]
    assert recording.signals["plant.state"][-1, 4] > 0.01


def test_a_discrete_plant_without_exported_states_runs_in_drake():
    """Its sampled outputs are recorded, and no compiled program has them."""
    recording = simulate(driven(two_cart_poles(0.01)), duration=0.1)
    assert recording.solver.engine == "drake"
    assert "its kernel has no output generalized_acceleration" in "".join(
        recording.notes
    )


@pytest.mark.parametrize("has_sampled_outputs", [True, False])
def test_a_discrete_plant_steps_as_in_drake(has_sampled_outputs):
    plant = two_cart_poles(0.01, has_sampled_outputs)
    diagram = driven(plant)
    context = diagram.CreateDefaultContext()
    x = 0.3 * np.arange(1.0, 9.0)
    plant.SetPositionsAndVelocities(plant.GetMyContextFromRoot(context), x)
    evaluator = Evaluator(diagram, context, as_machine_code=True)
    run = CompiledRun(evaluator, context, end=1.5, accuracy=1e-6, max_step=0.1)
    simulator = Simulator(diagram, context)
    for time in (0.005, 0.102, 1.406):
        simulator.AdvanceTo(time)
        run.Sample(time)
        expected = plant.GetPositionsAndVelocities(plant.GetMyContextFromRoot(context))
        np.testing.assert_allclose(run.memory.m, expected, rtol=0, atol=1e-11)


def ball(plant):
    frame = body(plant, "ball", default_model_instance()).body_frame()
    plant.AddJoint(BallRpyJoint("shoulder", plant.world_frame(), frame))


def spring(plant):
    frame = body(plant, "link", default_model_instance()).body_frame()
    joint = RevoluteJoint("hinge", plant.world_frame(), frame, [0, 0, 1])
    plant.AddForceElement(RevoluteSpring(plant.AddJoint(joint), 0.0, 1.0))


def limited(plant):
    frame = body(plant, "link", default_model_instance()).body_frame()
    plant.AddJoint(
        RevoluteJoint("hinge", plant.world_frame(), frame, [0, 0, 1], -1.0, 1.0)
    )


def controlled(plant):
    frame = body(plant, "link", default_model_instance()).body_frame()
    joint = RevoluteJoint("hinge", plant.world_frame(), frame, [0, 0, 1])
    motor = plant.AddJointActuator("motor", plant.AddJoint(joint))
    motor.set_controller_gains(PdControllerGains(p=1.0, d=1.0))


@pytest.mark.parametrize(
    ("add", "step", "message"),
    [
        (ball, 0.0, "joint shoulder is ball_rpy"),
        (spring, 0.0, "RevoluteSpring"),
        (limited, 0.001, "joint hinge has limits"),
        (controlled, 0.001, "actuator motor has a controller"),
    ],
)
def test_what_moves_in_another_way_is_refused_by_name(add, step, message):
    plant = MultibodyPlant(step)
    add(plant)
    plant.Finalize()
    with pytest.raises(UnsupportedSystem, match=message):
        PlantKernel(plant, plant.CreateDefaultContext())

"""Kernels of MultibodyPlants against Drake: ports of instances, discrete steps."""

import numpy as np
import pytest
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    DiscreteContactApproximation,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)
from pydrake.multibody.tree import (
    BallRpyJoint,
    DoorHinge,
    DoorHingeConfig,
    LinearSpringDamper,
    PdControllerGains,
    PrismaticJoint,
    PrismaticSpring,
    RevoluteJoint,
    RevoluteSpring,
    SpatialInertia,
    UnitInertia,
    default_model_instance,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource, Sine

from teleop_drake.loops import Compile, simulate
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import NearLimit, UnsupportedSystem
from teleop_drake.loops.engine.plant_kernel import PlantKernel
from teleop_drake.loops.engine.plant_limits import LimitsOf
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
    assert_array_equal(
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


def test_results_of_the_steps_of_a_discrete_plant_are_recorded_on_demand():
    """No compiled program has them: it goes without them unless they are named."""
    diagram = driven(two_cart_poles(0.01))
    recording = simulate(diagram, duration=0.1)
    assert recording.solver.engine == "compiled"
    assert "plant.state" in recording
    name = "plant.generalized_acceleration"
    assert name not in recording
    assert any(name in note and "drake" in note for note in recording.notes)
    assert name in Compile(diagram, duration=0.1).Run().notes[0]
    named = simulate(diagram, duration=0.1, signals=[name])
    assert named.solver.engine == "drake"
    assert f"its kernel has no output {name[6:]}" in "".join(named.notes)


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
        assert_allclose(run.memory.m, expected, rtol=0, atol=1e-11)


def sprung(time_step):
    """Returns a cart with two poles and springs of all kinds, one to the world."""
    plant = MultibodyPlant(time_step)
    plant.set_name("plant")
    cart, pole, tip = (body(plant, x, default_model_instance()) for x in "abc")
    frames = plant.world_frame(), cart.body_frame()
    rail = plant.AddJoint(PrismaticJoint("rail", *frames, [1, 0, 0]))
    frames = cart.body_frame(), pole.body_frame()
    pin = plant.AddJoint(RevoluteJoint("pin", *frames, [0, 1, 0], damping=0.3))
    frames = pole.body_frame(), tip.body_frame()
    plant.AddJoint(RevoluteJoint("elbow", *frames, [0, 0.6, 0.8]))
    plant.AddForceElement(PrismaticSpring(rail, 0.3, 40.0))
    plant.AddForceElement(RevoluteSpring(pin, -0.2, 5.0))
    plant.AddForceElement(RevoluteSpring(pin, 0.5, 2.0))
    to_world = plant.world_body(), [0.5, 0.2, 1.0], tip, [0, 0.1, 0.4]
    plant.AddForceElement(LinearSpringDamper(*to_world, 0.4, 30.0, 0.7))
    inside = cart, [0.3, 0, 0], tip, [0.1, 0, 0.2]
    plant.AddForceElement(LinearSpringDamper(*inside, 0.3, 20.0, 0.0))
    plant.Finalize()
    return plant


def test_springs_of_joints_and_between_points():
    CheckKernel(sprung(0.0))
    plant = sprung(0.005)
    context = plant.CreateDefaultContext()
    x = [0.1, 0.4, -0.3, 0.2, 0.5, -0.7]
    plant.SetPositionsAndVelocities(context, x)
    evaluator = Evaluator(plant, context, as_machine_code=True)
    run = CompiledRun(evaluator, context, end=1.0, accuracy=1e-9, max_step=0.1)
    run.Sample(0.5001)
    simulator = Simulator(plant, context)
    simulator.AdvanceTo(0.5001)
    own = simulator.get_context()
    expected = plant.GetPositionsAndVelocities(own)
    assert_allclose(run.memory.m, expected, rtol=0, atol=1e-10)


def ball(plant):
    frame = body(plant, "ball", default_model_instance()).body_frame()
    plant.AddJoint(BallRpyJoint("shoulder", plant.world_frame(), frame))


def door(plant):
    frame = body(plant, "link", default_model_instance()).body_frame()
    joint = RevoluteJoint("hinge", plant.world_frame(), frame, [0, 0, 1])
    plant.AddForceElement(DoorHinge(plant.AddJoint(joint), DoorHingeConfig()))


def limited(plant, limit=1.0):
    frame = body(plant, "link", default_model_instance()).body_frame()
    plant.AddJoint(
        RevoluteJoint("hinge", plant.world_frame(), frame, [0, 0, 1], -limit, limit)
    )


def hinge(approximation, limit):
    """Returns a discrete plant with a hinge that has a limit."""
    plant = MultibodyPlant(0.001)
    kind = DiscreteContactApproximation.__members__[approximation]
    plant.set_discrete_contact_approximation(kind)
    limited(plant, limit)
    plant.Finalize()
    return plant


def test_a_joint_that_comes_to_its_limit_runs_in_drake():
    """The limit of 1 rad is reached after 0.5 s by a hinge that turns at 2 rad/s."""
    plant = MultibodyPlant(0.001)
    limited(plant)
    plant.Finalize()
    with pytest.raises(UnsupportedSystem, match="joint hinge has limits"):
        Evaluator(plant, plant.CreateDefaultContext())
    context = plant.CreateDefaultContext()
    plant.SetVelocities(context, [2.0])
    within = simulate(plant, context=context, duration=0.49, signals=["state"])
    assert within.solver.engine == "compiled"
    assert within["state"][-1, 0] == pytest.approx(0.98, abs=1e-9)
    beyond = simulate(plant, context=context, duration=0.6, signals=["state"])
    assert beyond.solver.engine == "drake"
    assert beyond["state"][:, 0].max() < 1.001
    told = beyond.notes[0]
    assert "joint hinge of MultibodyPlant comes to its limit at 0.49" in told
    program = Compile(plant, context=context, duration=0.49, signals=["state"])
    assert program.Run().solver.engine == "compiled"
    assert program.Run(duration=0.6).notes[0] == told


@pytest.mark.parametrize(
    "approximation", sorted(DiscreteContactApproximation.__members__)
)
def test_drake_limits_no_joint_before_it_is_near(approximation):
    """A fast joint moves as if it had no limit until NearLimit would be raised."""
    paths = []
    for limit in (1.0, np.inf):
        plant = hinge(approximation, limit)
        simulator = Simulator(plant)
        context = simulator.get_mutable_context()
        plant.SetVelocities(context, [30.0])
        rows = []
        for k in range(1, 40):
            simulator.AdvanceTo(0.001 * k + 1e-6)
            rows.append(plant.GetPositionsAndVelocities(context))
        paths.append(np.array(rows))
    differs = np.abs(paths[0] - paths[1]).max(axis=1) > 1e-12
    first = int(np.argmax(differs))
    assert first > 10
    with pytest.raises(NearLimit):
        LimitsOf(hinge(approximation, 1.0)).Check(
            "plant", np.arange(first), paths[0][:first]
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
        (door, 0.0, "DoorHinge"),
        (controlled, 0.001, "actuator motor has a controller"),
    ],
)
def test_what_moves_in_another_way_is_refused_by_name(add, step, message):
    plant = MultibodyPlant(step)
    add(plant)
    plant.Finalize()
    with pytest.raises(UnsupportedSystem, match=message):
        PlantKernel(plant, plant.CreateDefaultContext())

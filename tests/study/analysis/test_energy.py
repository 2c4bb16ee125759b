"""Conservation of energy: robots conserve it, and tissue only dissipates it."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.primitives import ConstantVectorSource
from wired import Wired

from teleop_drake.model.blocks.environments.layered_force_field import LayeredForceField
from teleop_drake.model.blocks.robots import MakeRobot
from teleop_drake.model.scenario import LayerConfig

ROBOTS = {
    "slider": {"model": "slider", "start": [0.0], "damping": 0.0},
    "two_link_arm": {"model": "two_link_arm", "start": [0.85, 0.0], "elbow": "down"},
}


def Energies(robot_name, *, layers, v0, duration):
    """Simulates a free robot in a force field; returns (times, kinetic, stored)."""
    robot = MakeRobot(**ROBOTS[robot_name])
    n = robot.GetInputPort("control_force").size()
    field = LayeredForceField(layers=layers, num_axes=n)
    diagram = Wired(
        {
            "robot": robot,
            "nothing": ConstantVectorSource(np.zeros(n)),
            "environment": field,
        },
        {
            "robot.control_force": "nothing",
            "environment.tool_position": "robot.tool_position",
            "environment.tool_velocity": "robot.tool_velocity",
            "robot.environment_force": "environment.environment_force",
        },
    )
    simulator = Simulator(diagram)
    ApplySimulatorConfig(
        SimulatorConfig(
            integration_scheme="runge_kutta5",
            accuracy=1e-10,
            use_error_control=True,
            max_step_size=0.02,
        ),
        simulator,
    )
    plant = robot.GetSubsystemByName("plant")
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetVelocities(context, v0)
    times = []
    kinetic = []
    stored = []

    def Monitor(root_context):
        times.append(root_context.get_time())
        kinetic.append(plant.CalcKineticEnergy(context))
        x = robot.GetOutputPort("tool_position").Eval(
            robot.GetMyContextFromRoot(root_context)
        )[0]
        stored.append(
            sum(
                layer.stiffness * (x - layer.reference) ** 2 / 2
                for i, layer in enumerate(layers)
                if layer.start <= x
                and (i + 1 == len(layers) or x < layers[i + 1].start)
            )
        )

    simulator.set_monitor(Monitor)
    simulator.AdvanceTo(duration)
    return np.array(times), np.array(kinetic), np.array(stored)


BONE = {"name": "bone", "stiffness": 150.0}
TISSUE = {"name": "tissue", "start": -math.inf, "stiffness": 0.01, "damping": 0.5}


@pytest.mark.mostly_slow
@pytest.mark.filterwarnings("ignore:.*no event is located")
@pytest.mark.parametrize(
    ("robot", "v0", "surface"),
    [("slider", [0.3], 0.1), ("two_link_arm", [0.4, -0.9], 0.9)],
)
def test_energy_is_conserved_but_for_damping(robot, v0, surface):
    _, free, _ = Energies(robot, layers=[], v0=v0, duration=1.0)
    assert free[0] > 0
    assert_allclose(free, free[0], rtol=1e-8)
    bone = LayerConfig(**BONE, start=surface, reference=surface)
    _, kinetic, stored = Energies(robot, layers=[bone], v0=v0, duration=1.0)
    assert stored.max() > 0.5 * kinetic[0]
    assert_allclose(kinetic + stored, kinetic[0], rtol=1e-6)
    tissue = LayerConfig(**TISSUE)
    _, kinetic, stored = Energies(robot, layers=[tissue], v0=v0, duration=2.0)
    total = kinetic + stored
    assert np.all(np.diff(total) <= 1e-10)
    assert total[-1] < 0.8 * total[0]

"""Tests of tasks in space, whose metrics are taken along a surface's normal."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from own_kinds import PuckConfig
from pydrake.systems.framework import BasicVector

from teleop_drake.loops.kernel import Kernel, KernelBlock
from teleop_drake.model.blocks.environments.wall import FrictionWallConfig
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import RunMetrics

NORMAL = np.array([0.6, 0.48, -0.64])


class Puck(KernelBlock):
    """A puck with a mass of 1 kg: dv/dt = F_c - F_e."""

    def __init__(self, start):
        KernelBlock.__init__(self)
        for name in ("control_force", "environment_force"):
            self.DeclareVectorInputPort(name, 3)
        self.DeclareContinuousState(BasicVector([*start, *np.zeros(3)]), 3, 3, 0)
        names = ("tool_position", "tool_velocity", "tool_acceleration")
        self.DeclareOutputs(**dict.fromkeys(names, 3))

    def Kernel(self):
        forces = ("control_force", "environment_force")
        return Kernel(
            outputs={
                "tool_position": (lambda x: x[:3], "state"),
                "tool_velocity": (lambda x: x[3:], "state"),
                "tool_acceleration": (lambda F_c, F_e: F_c - F_e, *forces),
            },
            rate=(lambda x, F_c, F_e: np.append(x[3:], F_c - F_e), "state", *forces),
        )


class FastPuckConfig(PuckConfig):
    def MakeRobot(self):
        return Puck(self.start)


def Insertion(turn):
    """Returns the run of a puck's insertion, rotated by `turn` as a whole."""
    damped = ["controller.kind=damped_force", "controller.damped_force.damping=4"]
    scenario = LoadScenario("needle_insertion", [*damped, "duration=8"])
    scenario.robot = FastPuckConfig(start=turn @ [0.11, 0.02, 0.0])
    scenario.environment.direction = turn[:, 0]
    scenario.surgeon.velocity = turn @ [0.1, 0.01, 0.005]
    scenario.surgeon.contact_force = turn @ [0.2, 0.0, 0.0]
    return simulate(scenario)


def test_a_turned_task_has_the_same_metrics():
    """A rotated insertion of an isotropic robot has the same metrics."""
    across = np.cross(NORMAL, [0.0, 0.0, 1.0]) / np.hypot(0.6, 0.48)
    turn = np.column_stack([NORMAL, across, np.cross(NORMAL, across)])
    straight, turned = (Insertion(x) for x in (np.eye(3), turn))
    metrics = RunMetrics(turned)
    expected = RunMetrics(straight)
    assert None not in expected["collision"].values()
    for key in ("puncture", "collision"):
        assert metrics[key] == pytest.approx(expected[key], rel=1e-5, abs=1e-8)
    assert [x.name for x in turned.events] == [x.name for x in straight.events]
    at = np.array([metrics["puncture"]["time"]])
    # The tissue pulls the puck back to its axis.
    force = turned.Interpolate("environment_force", at - 1e-9)[0] @ turn
    offset = turned.Interpolate("tool_position", at)[0] @ turn - [0, 0.02, 0]
    assert_allclose(force[1:], 5.0 * offset[1:], rtol=1e-5)
    assert force[0] == pytest.approx(metrics["puncture"]["force"], rel=1e-6)


def test_the_tool_slides_at_coulombs_limit():
    scenario = LoadScenario("wall_sliding", ["controller.kind=direct_force"])
    wall = scenario.environment
    assert isinstance(wall, FrictionWallConfig)
    recording = simulate(scenario, engine="compiled")
    surface = recording.FindSurface("contact")
    v = recording["tool_velocity"][-1]
    F = recording["environment_force"][-1]
    v_t = v - surface.Along(v) * surface.normal_W
    F_t = F - surface.Along(F) * surface.normal_W
    speed = np.linalg.norm(v_t)
    assert speed > 20 * wall.creep_speed
    expected = wall.friction * surface.Along(F) * v_t / speed
    assert_allclose(F_t, expected, rtol=2e-3)
    assert RunMetrics(recording)["puncture"] is None

"""Tests of the kind `friction_wall`."""

from dataclasses import replace

import numpy as np
import pytest
from walls import Refusal

from teleop_drake.environments import FrictionWallConfig
from teleop_drake.linear_model.loop import LinearizeLoop
from teleop_drake.linear_model.operating_point import OperatingPoints
from teleop_drake.robots import FactsOfRobot
from teleop_drake.scenario import LoadScenario

NORMAL = np.array([0.8, 0.6])
ALONG = np.outer(NORMAL, NORMAL)


def test_slopes():
    """Of the force at rest: what it is to analyze and to the architectures."""
    config = FrictionWallConfig(
        start=0.0, direction=NORMAL, stiffness=150.0, friction=0.4, creep_speed=0.1
    )
    K, D = config.StiffnessAndDamping(0.02 * NORMAL)
    np.testing.assert_allclose(K, 150 * ALONG, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        D, 150 * 0.02 * 0.4 / 0.1 * (np.eye(2) - ALONG), rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("friction: -0.1", "friction = -0.1"),
        ("creep_speed: 0", "creep_speed = 0.0"),
        ("damping: -1", "damping = -1.0"),
    ],
)
def test_refuses(change, message):
    assert Refusal("friction_wall", change).startswith(
        f"environment.{message}: must be"
    )


def test_a_tool_that_rests_on_it_creeps_in_the_linear_model():
    """With the damping mu F_n/v_s along the wall, on top of what there is without."""
    wall = "start: 1.0, stiffness: 150, creep_speed: 0.001"
    models = []
    for friction in (0.0, 0.4):
        scenario = LoadScenario(
            "two_dof_collision",
            [
                f"environment={{kind: friction_wall, {wall}, friction: {friction}}}",
                "controller.kind=direct_force",
            ],
        )
        point = OperatingPoints(scenario)[-1]
        models.append(LinearizeLoop(scenario, point).slave.A[2:4, 2:4])
    robot = replace(scenario.robot, start=point.position).MakeRobot()
    F_n = 150 * (point.position[0] - 1.0)
    damping = 0.4 * F_n / 0.001 * np.diag([0.0, 1.0])
    expected = -np.linalg.solve(FactsOfRobot(robot).inertia, damping)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(models[1] - models[0], expected, atol=1e-4 * scale)

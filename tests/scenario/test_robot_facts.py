"""Tests of what is remembered of a scenario's robot."""

import numpy as np

from teleop_drake.robots import FactsOfRobot
from teleop_drake.scenario import LoadScenario
from teleop_drake.scenario.robot_facts import FactsOfConfig


def test_facts_are_those_of_the_robot_whatever_was_asked_before():
    for mass in (1.0, 2.0, 1.0):
        robot = LoadScenario("one_dof", {"robot.mass": mass}).robot
        facts, expected = FactsOfConfig(robot), FactsOfRobot(robot.MakeRobot())
        for name in ("start", "inertia", "damping"):
            np.testing.assert_array_equal(getattr(facts, name), getattr(expected, name))
        assert facts.inertia is FactsOfConfig(robot).inertia
    arm = LoadScenario("two_dof_combined").robot
    assert FactsOfConfig(arm).inertia.shape == (2, 2)

"""The robots: a file for each kind, and their place in task space."""

from typing import Any

from pydrake.systems.framework import System

from teleop_drake.kinds import KindTable
from teleop_drake.robots.arm import ArmConfig
from teleop_drake.robots.base import PlantRobotConfig, RobotConfig
from teleop_drake.robots.driven_arm import DrivenArmConfig
from teleop_drake.robots.facts import FactsOfConfig, FactsOfRobot, RobotFacts
from teleop_drake.robots.puma560 import Puma560Config
from teleop_drake.robots.robot_diagram import MakeRobotDiagram
from teleop_drake.robots.slider import SliderConfig
from teleop_drake.robots.two_link_arm import TwoLinkArmConfig
from teleop_drake.validation import Within

ROBOT_KINDS = KindTable(
    RobotConfig,
    (SliderConfig, TwoLinkArmConfig, ArmConfig, Puma560Config),
    noun="robot",
    key="model",
    is_named=True,
)
"""Every kind of robot."""

__all__ = [
    "ROBOT_KINDS",
    "ArmConfig",
    "DrivenArmConfig",
    "FactsOfConfig",
    "FactsOfRobot",
    "MakeRobot",
    "MakeRobotDiagram",
    "PlantRobotConfig",
    "Puma560Config",
    "RobotConfig",
    "RobotFacts",
    "SliderConfig",
    "TwoLinkArmConfig",
]


def MakeRobot(*, model: str, **fields: Any) -> System:
    """Makes a robot by the name of its model; see robot_diagram.MakeRobotDiagram.

    Raises:
        ScenarioError: If a field is not allowed.
    """
    config: RobotConfig = ROBOT_KINDS.Find(model, "robot.model")(**fields)
    with Within("robot"):
        return config.MakeRobot()

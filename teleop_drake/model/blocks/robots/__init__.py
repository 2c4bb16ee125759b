"""The robots: a file for each kind, and the plants and kinematics that they share."""

import dataclasses

from pydrake.systems.framework import System

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.validation import Choices, Refuse, Within
from teleop_drake.model.blocks.robots.arm import ArmConfig
from teleop_drake.model.blocks.robots.base import PlantRobotConfig, RobotConfig
from teleop_drake.model.blocks.robots.driven_arm import DrivenArmConfig
from teleop_drake.model.blocks.robots.facts import (
    FactsOfConfig,
    FactsOfRobot,
    RobotFacts,
)
from teleop_drake.model.blocks.robots.puma560 import Puma560Config
from teleop_drake.model.blocks.robots.robot_diagram import MakeRobotDiagram
from teleop_drake.model.blocks.robots.slider import SliderConfig
from teleop_drake.model.blocks.robots.two_link_arm import TwoLinkArmConfig
from teleop_drake.model.kinds import KindTable

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


def MakeRobot(
    model: str,
    start: ArrayLike,
    *,
    mass: float | None = None,
    damping: float | None = None,
    elbow: str | None = None,
    link_mass: float | None = None,
    posture: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
    gravity_compensation: bool | None = None,
    payload: float | None = None,
    payload_error: float | None = None,
    hold: str | None = None,
    hold_frequency: float | None = None,
    hold_damping_ratio: float | None = None,
    friction: float | None = None,
    friction_speed: float | None = None,
    file: str | None = None,
    add_motors: bool | None = None,
    tool_frame: str | None = None,
    locked: list[str] | None = None,
    base: ArrayLike | None = None,
) -> System:
    """Makes a robot by the name of its model; see robot_diagram.MakeRobotDiagram.

    None stands for the default of the model, whose config describes each field:
    SliderConfig, TwoLinkArmConfig, ArmConfig and Puma560Config.

    Args:
        model: `slider`, `two_link_arm`, `arm` or `puma560`, or `module:Class`.
        start: p_WT at time 0 in m (n).
        mass: Mass of a slider, kg.
        damping: Damping of a slider's rail, N s/m.
        elbow: Bend of the elbow of a two_link_arm, up or down.
        link_mass: Mass of each link of a two_link_arm, kg.
        posture: Joint positions of an arm or a puma560 near which those at the start
            are searched, rad or m.
        gravity: Acceleration of gravity on an arm or a puma560, m/s^2.
        gravity_compensation: Whether the motors of an arm or a puma560 compensate its
            weight.
        payload: Mass at the tool of an arm or a puma560, kg.
        payload_error: Mass that the gravity compensation assumes beyond `payload`, kg.
        hold: Quantity that an arm or a puma560 holds besides the tool's position.
        hold_frequency: Natural frequency of the hold, rad/s.
        hold_damping_ratio: Damping ratio of the hold.
        friction: Share of the published joint friction of a puma560.
        friction_speed: Joint speed within which the Coulomb friction of a puma560
            changes sign, rad/s.
        file: SDFormat, URDF or MJCF file of an arm.
        add_motors: Whether the joints of an arm without motors get motors.
        tool_frame: Name of the body or frame of an arm that is its tool.
        locked: Names of the joints of an arm that are locked at their defaults.
        base: Pose of an arm's base in the world: x, y, z in m; roll, pitch, yaw in rad.

    Raises:
        ScenarioError: If a field is not allowed, or the model has no such field.
    """
    # The arguments by name; this must come before any other local variable.
    arguments = dict(locals())
    kind = ROBOT_KINDS.Find(arguments.pop("model"), "robot.model")
    given = {name: value for name, value in arguments.items() if value is not None}
    known = [item.name for item in dataclasses.fields(kind)]
    for name, value in given.items():
        if name not in known:
            choices = Choices(name, known)
            Refuse(f"robot.{name}", value, f"left out: a {model} has {choices}")
    config: RobotConfig = kind(**given)
    with Within("robot"):
        return config.MakeRobot()

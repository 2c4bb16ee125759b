"""The robots: SDF models, their start poses, and their place in task space."""

from teleop_drake.robots.robots import (
    CheckRobot,
    InverseKinematics,
    LoadRobotPlant,
    MakeRobot,
    NumTaskAxes,
    RobotModels,
    TaskDamping,
    TaskInertiaInverse,
)

__all__ = [
    "CheckRobot",
    "InverseKinematics",
    "LoadRobotPlant",
    "MakeRobot",
    "NumTaskAxes",
    "RobotModels",
    "TaskDamping",
    "TaskInertiaInverse",
]

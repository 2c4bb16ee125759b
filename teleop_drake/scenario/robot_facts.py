"""Facts of a scenario's robot, from which defaults derive."""

from teleop_drake.robots import ROBOT_KINDS, FactsOfRobot, RobotConfig, RobotFacts
from teleop_drake.scenario.tree import ToTree

_MAX_FACTS = 64

_facts: dict[tuple[type, str], RobotFacts] = {}


def FactsOfConfig(robot: RobotConfig) -> RobotFacts:
    """Returns the facts of the robot that a config makes; see robots.FactsOfRobot.

    To make one takes as long as to run machine code, and a sweep asks for the same
    robot again and again. So they are remembered, of kinds of the package that name no
    file.
    """
    names_file = any(getattr(robot, name) is not None for name in robot.file_fields)
    if names_file or type(robot) not in ROBOT_KINDS.kinds:
        return FactsOfRobot(robot.MakeRobot())
    key = type(robot), repr(ToTree(robot))
    if key not in _facts:
        if len(_facts) >= _MAX_FACTS:
            _facts.clear()
        _facts[key] = FactsOfRobot(robot.MakeRobot())
    return _facts[key]

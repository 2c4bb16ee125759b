"""What is asked of the operator and the robot, and what counts: a file a task."""

from typing import Any

from teleop_drake.scenario import AnyScenario, Scenario, TrackingScenario
from teleop_drake.tasks.base import SpeedLimit, Task
from teleop_drake.tasks.insertion import Insertion
from teleop_drake.tasks.tracking import Tracking

TASKS: dict[type, Task[Any]] = {Scenario: Insertion(), TrackingScenario: Tracking()}
"""The task of each class of scenarios, and of those that derive from it."""


def TaskOf(scenario: AnyScenario) -> Task[Any]:
    """Returns the task that a scenario describes.

    Args:
        scenario: Any.

    Raises:
        TypeError: If it is no scenario.
    """
    for scenario_class in type(scenario).__mro__:
        if scenario_class in TASKS:
            return TASKS[scenario_class]
    raise TypeError(f"scenario = {type(scenario).__name__}: must be a scenario")


__all__ = [
    "TASKS",
    "Insertion",
    "SpeedLimit",
    "Task",
    "TaskOf",
    "Tracking",
]

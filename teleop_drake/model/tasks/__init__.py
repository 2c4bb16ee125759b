"""The tasks of operator and robot: insertion, and the tracking of chapter 3."""

from typing import Any

from teleop_drake.loops.framework.validation import Refuse, ScenarioError, WrongKind
from teleop_drake.model.kinds import ImportOwn
from teleop_drake.model.scenario import AnyScenario, Scenario, TrackingScenario
from teleop_drake.model.scenario.loading import LoadOverridden
from teleop_drake.model.tasks.base import SpeedLimit, Task
from teleop_drake.model.tasks.insertion import Insertion
from teleop_drake.model.tasks.tracking import Tracking

TASKS: dict[type, Task[Any]] = {Scenario: Insertion(), TrackingScenario: Tracking()}
"""The task of each class of scenarios and of its derived classes."""


def TaskOf(scenario: AnyScenario) -> Task[Any]:
    """Returns the task that a scenario names, or otherwise the task of its class.

    Raises:
        ScenarioError: If the scenario names a class that is not a task.
        WrongKind: If the argument is not a scenario.
    """
    own = getattr(scenario, "task", None)
    if own is not None:
        kind = ImportOwn(own, "task")
        if not (isinstance(kind, type) and issubclass(kind, Task)):
            base = f"{Task.__module__.rpartition('.')[0]}.{Task.__name__}"
            Refuse("task", own, f"a class that derives from {base}")
        return kind()
    for scenario_class, task in TASKS.items():
        if isinstance(scenario, scenario_class):
            return task
    raise WrongKind(f"scenario = a {type(scenario).__name__}: must be a scenario")


def ComparedControllers(scenario: AnyScenario) -> list[str]:
    """Returns the kinds of controllers that a comparison uses by default.

    They are those of the task. If the scenario has no gains for one of them, its own
    controller is the only one.
    """
    kinds = list(TaskOf(scenario).controllers)
    for kind in kinds:
        try:
            LoadOverridden(scenario, {"controller.kind": kind})
        except ScenarioError:
            return [scenario.controller.kind]
    return kinds


__all__ = [
    "TASKS",
    "ComparedControllers",
    "Insertion",
    "SpeedLimit",
    "Task",
    "TaskOf",
    "Tracking",
]

"""Sweeps: runs of a scenario over a grid of values and controllers."""

from teleop_drake.scenario.overrides import ALIASES
from teleop_drake.sweep.folder import WriteTables
from teleop_drake.sweep.plan import PlanSweep, SweepPlan
from teleop_drake.sweep.result import SweepError, SweepResult
from teleop_drake.sweep.run import Execution, RunSweep, RunSweeps, Sweep
from teleop_drake.sweep.statistics import (
    Differences,
    HasSeeds,
    Statistics,
    VariesSeedsOnly,
)
from teleop_drake.sweep.task_result import SelectMetrics, TaskSweepResult
from teleop_drake.sweep.values import ParseValues
from teleop_drake.tasks.metrics import FlattenMetrics, MetricUnits

__all__ = [
    "ALIASES",
    "Differences",
    "Execution",
    "FlattenMetrics",
    "HasSeeds",
    "MetricUnits",
    "ParseValues",
    "PlanSweep",
    "RunSweep",
    "RunSweeps",
    "SelectMetrics",
    "Statistics",
    "Sweep",
    "SweepError",
    "SweepPlan",
    "SweepResult",
    "TaskSweepResult",
    "VariesSeedsOnly",
    "WriteTables",
]

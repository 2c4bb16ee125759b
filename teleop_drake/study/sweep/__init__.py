"""Sweeps: runs of a scenario over a grid of values and controllers."""

from teleop_drake.model.scenario.overrides import ALIASES
from teleop_drake.model.tasks.metrics import FlattenMetrics, MetricUnits
from teleop_drake.study.sweep.folder import WriteTables
from teleop_drake.study.sweep.plan import PlanSweep, SweepPlan
from teleop_drake.study.sweep.result import SweepError, SweepResult
from teleop_drake.study.sweep.run import Execution, RunSweep, RunSweeps, Sweep
from teleop_drake.study.sweep.statistics import (
    Differences,
    HasSeeds,
    Statistics,
    VariesSeedsOnly,
)
from teleop_drake.study.sweep.task_result import SelectMetrics, TaskSweepResult
from teleop_drake.study.sweep.values import ParseValues

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

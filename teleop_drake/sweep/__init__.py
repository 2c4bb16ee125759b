"""Many runs: a grid of values times controllers."""

from teleop_drake.sweep.plan import ALIASES, MAX_RUNS, ParseValues, PlanSweep, SweepPlan
from teleop_drake.sweep.result import (
    CHANNEL_METRICS,
    FlattenMetrics,
    MetricUnits,
    SelectMetrics,
    SweepError,
    SweepResult,
)
from teleop_drake.sweep.run import RunSweep, Sweep

__all__ = [
    "ALIASES",
    "CHANNEL_METRICS",
    "MAX_RUNS",
    "FlattenMetrics",
    "MetricUnits",
    "ParseValues",
    "PlanSweep",
    "RunSweep",
    "SelectMetrics",
    "Sweep",
    "SweepError",
    "SweepPlan",
    "SweepResult",
]

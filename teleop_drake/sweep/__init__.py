"""Many runs: a grid of values times controllers."""

from teleop_drake.sweep.sweep import (
    ALIASES,
    CHANNEL_METRICS,
    MAX_RUNS,
    TELEOPERATION_METRICS,
    TRACKING_METRICS,
    FlattenMetrics,
    MetricUnits,
    ParseValues,
    PlanSweep,
    RunSweep,
    SelectMetrics,
    Sweep,
    SweepError,
    SweepPlan,
    SweepResult,
)

__all__ = [
    "ALIASES",
    "CHANNEL_METRICS",
    "MAX_RUNS",
    "TELEOPERATION_METRICS",
    "TRACKING_METRICS",
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

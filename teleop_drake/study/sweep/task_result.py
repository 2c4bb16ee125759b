"""The result of a sweep of a scenario, whose task defines the metrics."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.model.scenario import AnyScenario
from teleop_drake.model.tasks.metrics import FlattenMetrics, MetricUnits
from teleop_drake.study.sweep.result import Matching, SweepResult

_HEADLINES = (
    "start_velocity_overshoot",
    "puncture.force",
    "puncture.velocity_overshoot",
    "collision.initial_impact_force",
    "collision.peak_force",
    "collision.settling_time",
    "velocity_rms_error",
    "max_error",
    "rms_error",
)


@dataclass(kw_only=True)
class TaskSweepResult(SweepResult):
    """The results of a sweep of a scenario.

    Attributes:
        scenario: The first valid scenario of the grid.
    """

    scenario: AnyScenario

    def __post_init__(self) -> None:
        """Sets the units: those of the metrics of the scenario's task."""
        self.units = MetricUnits(self.scenario)

    def _MostUsed(self) -> list[str]:
        return SelectMetrics(self.scenario)

    @cached_property
    def _metrics(self) -> list[Record]:
        """The metrics of each run and of its channels, by their names."""
        return [
            FlattenMetrics((record["metrics"] or {}) | record.get("channels", {}))
            for record in self.records
        ]


def SelectMetrics(
    scenario: AnyScenario, names: Sequence[str] | None = None
) -> list[str]:
    """Returns the scalar metrics that match some names.

    Args:
        names: Scalar metrics, or groups such as "collision" or "velocity_rms_error".
            None selects the most used metrics.

    Raises:
        SweepError: If a name matches no metric.
    """
    known = MetricUnits(scenario)
    if names is None:
        return [name for name in known if name.startswith(_HEADLINES)]
    return Matching(known, names)

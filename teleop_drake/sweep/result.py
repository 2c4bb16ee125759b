"""The result of a sweep: records, and the metrics in them by name."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from teleop_drake.arrays import Array, Record
from teleop_drake.scenario import AnyScenario, ScenarioError
from teleop_drake.tasks.metrics import FlattenMetrics, MetricUnits
from teleop_drake.upper import UpperFunction

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


class SweepError(ScenarioError):
    """Bad input; its message names the parameter, the value and what is allowed."""


@dataclass(kw_only=True)
class SweepResult:
    """The results of a sweep.

    Attributes:
        scenario: The first valid scenario of the grid.
        axes: Keys of the grid and their values; the last one varies fastest.
        records: The records of the runs, in the order of the grid: `run` (its number),
            `varied` (key to value), `status` (`completed`, `diverged` or `failed`),
            `reason` (why it was not completed) and, unless it failed, the entries of
            RunSummary except the wall times. The `metrics` of a failed run are None.
    """

    scenario: AnyScenario
    axes: dict[str, list[Any]]
    records: list[Record]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis."""
        return tuple(len(values) for values in self.axes.values())

    def Values(self, metric: str) -> Array:
        """Returns a metric of each run, NaN for a run without a value.

        Args:
            metric: A name in MetricUnits(scenario), such as "collision.peak_force".

        Returns:
            Array of the shape of the grid.

        Raises:
            SweepError: If there is no such metric.
        """
        SelectMetrics(self.scenario, [metric])
        values = [metrics.get(metric) for metrics in self._metrics]
        return np.array(values, dtype=float).reshape(self.shape)  # NaN where None.

    def Metrics(self) -> list[str]:
        """Returns the names of the most used metrics that at least one run has."""
        names = SelectMetrics(self.scenario)
        return [name for name in names if np.isfinite(self.Values(name)).any()]

    def Status(self) -> Array:
        """Returns the status of each run as an array of text in the grid's shape."""
        return np.array([record["status"] for record in self.records]).reshape(
            self.shape
        )

    def plot(self, *metrics: str) -> Any:
        """Plots metrics against the delay, or against another key that is varied.

        Args:
            *metrics: Names in MetricUnits(scenario), such as "collision.peak_force";
                by default the metrics of Metrics().

        Returns:
            The figure of teleop_drake.figures.sweeps.PlotSweep(), which a notebook
            shows.
        """
        return UpperFunction("PlotSweep")(self, *metrics)

    def Table(self) -> list[Record]:
        """Returns the rows of runs.csv, which `pandas.DataFrame` accepts.

        Each row has the same keys: run, the keys of the grid, status, reason and the
        metrics. A metric is None for a run without a value.
        """
        names = MetricUnits(self.scenario)
        return [
            {
                "run": record["run"],
                **record["varied"],
                "status": record["status"],
                "reason": record["reason"],
                **{name: metrics.get(name) for name in names},
            }
            for record, metrics in zip(self.records, self._metrics, strict=True)
        ]

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
    selected: dict[str, None] = {}
    for name in names:
        found = [x for x in known if x == name or x.startswith(f"{name}.")]
        if not found:
            raise SweepError(f"metric {name!r}: must be one of {', '.join(known)}")
        selected |= dict.fromkeys(found)
    return list(selected)

"""The result of a sweep: records, and the metrics in them by name."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Record
from teleop_drake.loops.framework.validation import ScenarioError


class SweepError(ScenarioError):
    """Bad input; its message names the parameter, the value and what is allowed."""


@dataclass(kw_only=True)
class SweepResult:
    """The results of a sweep.

    Attributes:
        axes: Keys of the grid and their values; the last one varies fastest.
        records: The records of the runs, in the order of the grid: `run` (its number),
            `varied` (key to value), `status` (`completed`, `diverged` or `failed`),
            `reason` (why it was not completed) and, unless it failed, `metrics` by
            name and `solver`, the SolverStatistics except the wall times. For the runs
            of a scenario these are the entries of RunSummary. The `metrics` of a failed
            run are None.
        units: The units of the metrics, by their names.
    """

    axes: dict[str, list[Any]]
    records: list[Record]
    units: dict[str, str] = field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis."""
        return tuple(len(values) for values in self.axes.values())

    def Values(self, metric: str) -> Array:
        """Returns a metric of each run, NaN for a run without a value.

        Args:
            metric: A name in `units`, such as "collision.peak_force".

        Returns:
            Array of the shape of the grid.

        Raises:
            SweepError: If there is no such metric.
        """
        Matching(self.units, [metric])
        values = [metrics.get(metric) for metrics in self._metrics]
        return np.array(values, dtype=float).reshape(self.shape)  # NaN where None.

    def Metrics(self) -> list[str]:
        """Returns the names of the most used metrics that at least one run has."""
        names = self._MostUsed()
        return [name for name in names if np.isfinite(self.Values(name)).any()]

    def _MostUsed(self) -> list[str]:
        return list(self.units)

    def Status(self) -> Array:
        """Returns the status of each run as an array of text in the grid's shape."""
        return np.array([record["status"] for record in self.records]).reshape(
            self.shape
        )

    def plot(self, *metrics: str) -> Any:
        """Plots metrics against the delay, or against another key that is varied.

        Args:
            *metrics: Names in `units`, such as "collision.peak_force"; by default the
                metrics of Metrics().

        Returns:
            The figure of figures.sweeps.PlotSweep(), which a notebook
            shows.
        """
        from teleop_drake.study.figures.sweeps import PlotSweep  # Figures show sweeps.

        return PlotSweep(self, *metrics)

    def Table(self) -> list[Record]:
        """Returns the rows of runs.csv, which `pandas.DataFrame` accepts.

        Each row has the same keys: run, the keys of the grid, status, reason and the
        metrics. A metric is None for a run without a value.
        """
        return [
            {
                "run": record["run"],
                **record["varied"],
                "status": record["status"],
                "reason": record["reason"],
                **{name: metrics.get(name) for name in self.units},
            }
            for record, metrics in zip(self.records, self._metrics, strict=True)
        ]

    @cached_property
    def _metrics(self) -> list[Record]:
        """The metrics of each run by their names."""
        return [record["metrics"] or {} for record in self.records]


def Matching(known: Iterable[str], names: Iterable[str]) -> list[str]:
    """Returns the known metrics that match some names, or refuses a name."""
    selected: dict[str, None] = {}
    for name in names:
        found = [x for x in known if x == name or x.startswith(f"{name}.")]
        if not found:
            raise SweepError(f"metric {name!r}: must be one of {', '.join(known)}")
        selected |= dict.fromkeys(found)
    return list(selected)

"""Statistics of the league: shares and medians over runs and searches, with intervals.

A time is infinite where a run never comes to rest. The median is then a number as long
as more than half of the runs come to rest. No mean is taken of such times.

Intervals are for 95 % confidence. Those of shares are Wilson's. Those of medians are
percentiles of a bootstrap over the runs and over the searches: each resample draws runs
and seeds of the search with replacement. Differences are paired: the two architectures
are compared in each run, and a resample draws runs for both.
"""

import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from league.runs import Outcome
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.study.sweep.statistics import LEVEL, ShareInterval

FOLDER = Path(__file__).parent

NUM_RESAMPLES = 1000

BASELINE = "damper to command"
"""With its compromise the others are compared, run by run."""

Row = dict[str, Any]
"""A row of a table."""


class Estimate(NamedTuple):
    """A number with its interval."""

    value: float
    low: float
    high: float


def Median(values: Array) -> Estimate:
    """Returns the median over seeds and runs of values (S, R), with its interval."""
    return _Estimated(lambda x: _Middle(x.reshape(*x.shape[:-2], -1)), values)


def Share(flags: Array) -> Estimate:
    """Returns the share of true flags (S, R); its interval counts runs, not seeds."""
    share = float(flags.mean())
    runs = flags.shape[1]
    return Estimate(share, *ShareInterval(round(share * runs), runs))


def Difference(values: Array, others: Array) -> Estimate:
    """Returns the median over runs of the difference of values (S, R) to others (Z, R).

    The value of a run is its median over the seeds. If both never come to rest, the
    difference is 0; if one does not, it is infinite.
    """

    def Of(own: Array, other: Array) -> Array:
        x, y = _OverSeeds(own), _OverSeeds(other)
        with np.errstate(invalid="ignore"):
            return _Middle(np.where(x == y, 0.0, x - y))

    return _Estimated(Of, values, others)


def ShareBelow(values: Array, others: Array) -> Estimate:
    """Returns the share of runs in which values (S, R) are below others (Z, R).

    The value of a run is its median over the seeds. A tie counts one half.
    """

    def Of(own: Array, other: Array) -> Array:
        x, y = _OverSeeds(own), _OverSeeds(other)
        return np.asarray(np.mean((x < y) + 0.5 * (x == y), axis=-1))

    return _Estimated(Of, values, others)


def Columns(**estimates: Estimate) -> dict[str, float]:
    """Returns the cells of a row: of each name the value, and `_low` and `_high`."""
    cells = {}
    for name, estimate in estimates.items():
        cells[name] = estimate.value
        cells[f"{name}_low"] = estimate.low
        cells[f"{name}_high"] = estimate.high
    return {name: float(f"{value:.4g}") for name, value in cells.items()}


def _Estimated(statistic: Callable[..., Array], *values: Array) -> Estimate:
    """Returns a statistic of arrays (S, R) of the same runs, with its interval.

    Args:
        statistic: A function of arrays (..., S, R), which returns an array (...).
    """
    resampled = np.sort(statistic(*(_Draw(x) for x in values)))
    tail = int((1 - LEVEL) / 2 * NUM_RESAMPLES)
    low, high = resampled[tail], resampled[-1 - tail]
    return Estimate(float(statistic(*values)), float(low), float(high))


def _Draw(values: Array) -> Array:
    """Returns resamples (NUM_RESAMPLES, S, R); the runs drawn depend on R alone."""
    seeds, runs = values.shape
    of_runs = np.random.default_rng(0).integers(runs, size=(NUM_RESAMPLES, 1, runs))
    of_seeds = np.random.default_rng(1).integers(seeds, size=(NUM_RESAMPLES, seeds, 1))
    return values[of_seeds, of_runs]


def _OverSeeds(values: Array) -> Array:
    """Returns the lower median over the seeds (..., R) of values (..., S, R)."""
    return _Middle(np.swapaxes(values, -1, -2))


def _Middle(values: Array) -> Array:
    """Returns the lower median along the last axis, which is one of the values."""
    middle = (values.shape[-1] - 1) // 2
    return np.asarray(np.partition(values, middle, axis=-1)[..., middle])


def GroupOf(run: str) -> str:
    """Returns the group of a held-out run, from its name."""
    words = run.split("-")[1:]
    return next(word for word in reversed(words) if word.isalpha() and word != "trace")


def RunRows(name: str, results: Sequence[Row]) -> list[Row]:
    """Returns the rows of an entry in league_runs.csv, from its results by seed."""
    rows = []
    for member in results[0]["members"]:
        found = [x["members"][member] for x in results if member in x["members"]]
        for run in found[0]["runs"]:
            outcomes = [Outcome(*item["runs"][run]) for item in found]
            row: Row = {"architecture": name, "member": member, "run": run}
            row["bounded"] = " ".join(f"{outcome.is_bounded:d}" for outcome in outcomes)
            for field in ("rest", "arrival", "impact", "effort"):
                values = (getattr(outcome, field) for outcome in outcomes)
                row[field] = " ".join(f"{value:.4g}" for value in values)
            rows.append(row)
    return rows


def Values(rows: Sequence[Row], field: str) -> Array:
    """Returns a field of rows of league_runs.csv by seed and run (S, R)."""
    columns = [[float(x) for x in str(row[field]).split()] for row in rows]
    return np.array(columns).T


def StatisticsRows(runs: Sequence[Row]) -> list[Row]:
    """Returns the rows of league.csv from those of league_runs.csv."""

    def Select(architecture: str, member: str, group: str) -> list[Row]:
        return [
            row
            for row in runs
            if (row["architecture"], row["member"]) == (architecture, member)
            and group in (GroupOf(row["run"]), "all")
        ]

    groups = [*dict.fromkeys(GroupOf(row["run"]) for row in runs), "all"]
    members = dict.fromkeys((row["architecture"], row["member"]) for row in runs)
    rows = []
    for architecture, member in members:
        for group in groups:
            own = Select(architecture, member, group)
            other = Select(BASELINE, "compromise", group)
            rest = Values(own, "rest")
            row: Row = {"architecture": architecture, "member": member, "runs": group}
            row |= {"count": rest.shape[1], "seeds": rest.shape[0]}
            row |= Columns(
                bounded=Share(Values(own, "bounded") == 1),
                at_rest=Share(np.isfinite(rest)),
                rest=Median(rest),
                arrival=Median(Values(own, "arrival")),
                impact=Median(Values(own, "impact")),
                effort=Median(Values(own, "effort")),
            )
            if other:
                row |= Columns(
                    rests_sooner=ShareBelow(rest, Values(other, "rest")),
                    rest_difference=Difference(rest, Values(other, "rest")),
                    impact_difference=Difference(
                        Values(own, "impact"), Values(other, "impact")
                    ),
                )
            rows.append(row)
    return rows


def ReadTable(name: str = "league", folder: Path = FOLDER) -> list[Row]:
    """Returns the rows of a table with numbers where there are numbers."""
    text = (folder / f"{name}.csv").read_text(encoding="utf-8")
    return [
        {key: _Number(value) for key, value in row.items()}
        for row in csv.DictReader(text.splitlines())
    ]


def _Number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text

"""Statistics over the seeds of a sweep: medians, shares, and differences in pairs.

A run over a network is one random draw of its delays and losses. The key `seed` of a
grid selects the draw, so runs with the same seed have the same delays and losses.
Controllers are therefore compared seed by seed.

Intervals are for 95 % confidence: of a median by the bootstrap (percentiles of
`scipy.stats.bootstrap`), of a share by Wilson's method (`scipy.stats.binomtest`).
"""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Interval, Record
from teleop_drake.study.sweep.result import SweepError, SweepResult
from teleop_drake.study.sweep.values import SEED

LEVEL = 0.95
"""Confidence of every interval."""

CONTROLLERS = ("controller", "controller.kind")
"""The keys of a grid that name controllers."""

_NUM_RESAMPLES = 2000


def HasSeeds(result: SweepResult) -> bool:
    """Returns whether a sweep has two seeds or more."""
    return len(result.axes.get(SEED, [])) > 1


def VariesSeedsOnly(result: SweepResult) -> bool:
    """Returns whether a sweep varies only the seed, or the seed and the controller."""
    varied = {key for key, values in result.axes.items() if len(values) > 1}
    return HasSeeds(result) and varied <= {SEED, *CONTROLLERS}


def MedianInterval(values: Array) -> Interval:
    """Returns the bootstrap interval of a median, NaN for fewer than two values."""
    if len(values) < 2:
        return math.nan, math.nan
    from scipy.stats import bootstrap  # It takes a second.

    # The generator is new each time: the same runs give the same bytes.
    interval = bootstrap(
        (values,),
        np.median,
        n_resamples=_NUM_RESAMPLES,
        confidence_level=LEVEL,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return float(interval.low), float(interval.high)


def ShareInterval(count: int, total: int) -> Interval:
    """Returns Wilson's interval of a share."""
    from scipy.stats import binomtest

    interval = binomtest(count, total).proportion_ci(LEVEL, method="wilson")
    return float(interval.low), float(interval.high)


def Statistics(result: SweepResult) -> list[Record]:
    """Returns the rows of statistics.csv: for each point of the grid, over its seeds.

    A row has these columns:

    * the keys of the grid without `seed`;
    * `metric`, `statistic` and `unit`;
    * `runs`, the number of runs, and `count`, the number of runs with a value;
    * `value`, and its confidence interval from `low` to `high`;
    * `p5` and `p95`, the 5 % and 95 % quantiles of the runs, for a median only.

    The statistic of a metric is the `median` over the runs that did not end early. The
    statistic of `diverged`, and of `collision.settles` where a run can settle, is the
    `share` of all runs. A missing number is None.

    Raises:
        SweepError: If the sweep has no seeds.
    """
    points = _Points(result)
    units = result.units
    medians = _Medians(result)
    is_diverged = _BySeed(result, result.Status() == "diverged")
    # A finite number means that the event has happened in the run.
    shares = {"diverged": np.where(is_diverged, 1.0, math.nan)}
    if "collision.settling_time" in medians:
        shares["collision.settles"] = medians["collision.settling_time"]
    rows = []
    for i, point in enumerate(points):
        for metric, values in shares.items():
            rows.append(_Row(point, metric, "share", "", values[i]))
        for metric, values in medians.items():
            rows.append(_Row(point, metric, "median", units[metric], values[i]))
    return rows


def Differences(result: SweepResult) -> list[Record]:
    """Returns the rows of differences.csv: each controller against the first one.

    A row has the columns of Statistics(). Its `value` is the median over the seeds of
    the difference between the metric with `controller` and the metric with `baseline`,
    both with the same seed. `count` is the number of pairs in which both runs have a
    value.

    Args:
        result: A sweep with the key `seed`. With one controller there are no rows.

    Raises:
        SweepError: If the sweep has no seeds.
    """
    points = _Points(result)
    key = next((k for k in CONTROLLERS if len(result.axes.get(k, [])) > 1), None)
    if key is None:
        return []
    baseline = result.axes[key][0]
    units = result.units
    medians = _Medians(result)
    rows = []
    for i, point in enumerate(points):
        if point[key] == baseline:
            continue
        k = points.index(point | {key: baseline})
        own = {**point, "baseline": baseline}
        for metric, values in medians.items():
            x = values[i] - values[k]
            rows.append(_Row(own, metric, "median difference", units[metric], x))
    return rows


def Bands(values: Array, estimate: Callable[[Array], Any]) -> Array:
    """Returns a statistic of the finite numbers along the last axis.

    The result is NaN where there are no finite numbers.

    Args:
        values: Array (..., seeds).
        estimate: A function that takes a vector of finite numbers and returns a number.
    """

    def OfFinite(row: Array) -> Any:
        finite = row[np.isfinite(row)]
        return estimate(finite) if finite.size else math.nan

    return np.apply_along_axis(OfFinite, -1, values)


def _Points(result: SweepResult) -> list[Record]:
    """Returns the points of the grid without the seed."""
    if SEED not in result.axes:
        raise SweepError("result: must be of a grid with the key seed")
    others = {key: values for key, values in result.axes.items() if key != SEED}
    combinations = itertools.product(*others.values())
    return [dict(zip(others, values, strict=True)) for values in combinations]


def _BySeed(result: SweepResult, values: Array) -> Array:
    """Returns values in the shape of the grid as (points, seeds)."""
    axis = list(result.axes).index(SEED)
    return np.moveaxis(values, axis, -1).reshape(-1, values.shape[axis])


def _Medians(result: SweepResult) -> dict[str, Array]:
    """Returns the values of each metric (points, seeds); NaN if a run ended early."""
    is_complete = result.Status() == "completed"
    return {
        metric: _BySeed(result, np.where(is_complete, result.Values(metric), math.nan))
        for metric in result.units
        if not metric.startswith("diverged")
    }


def _Row(
    point: Record, metric: str, statistic: str, unit: str, values: Array
) -> Record:
    """Returns a row with a statistic of the finite values, and its interval."""
    x = values[np.isfinite(values)]
    names = ("value", "low", "high", "p5", "p95")
    numbers: list[float] = []
    if statistic == "share":
        numbers = [len(x) / len(values), *ShareInterval(len(x), len(values))]
    elif x.size:
        quantiles = np.quantile(x, (0.05, 0.95)).tolist()
        numbers = [float(np.median(x)), *MedianInterval(x), *quantiles]
    known = zip(names, numbers, strict=False)
    return {
        **point,
        "runs": len(values),
        "metric": metric,
        "statistic": statistic,
        "unit": unit,
        "count": len(x),
        **dict.fromkeys(names),
        **{name: number for name, number in known if not math.isnan(number)},
    }

"""The dead time between two recorded signals, separated from the response's own lag.

signal_pair has the model and its fit by least squares.

A first search covers all dead times at once: for a given lag, the correlation of z and
y by FFT has the error of each. The profile

    S(T) = least sum of squares over everything but T

decides what the record can tell. Dead times with S(T) <= S_min (1 + F/n) are not
refuted; F is the 95 % quantile of the F distribution, and n the number of independent
rows, which is smaller than the number of rows if the residuals are correlated.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Interval
from teleop_drake.study.numerics.lagged_signal import Lag, lagged
from teleop_drake.study.numerics.signal_pair import Fit, SignalPair

# The most points of the first search.
_MOST_COARSE = 2**14

# The lags of the first search: their time constants, as shares of the record, and their
# damping ratios.
_NUM_TIMES = 12
_DAMPINGS = (0.2, 0.7, 1.5)

# The confidence of intervals.
_CONFIDENCE = 0.95

# The most minima of the first search that are examined closely.
_MOST_MINIMA = 5


class _Coarse(NamedTuple):
    """The errors of all dead times of the first search.

    Attributes:
        delays: The dead times, s (K).
        squares: The sum of squares of each, for each lag (L, K).
        lags: The lags (L).
    """

    delays: Array
    squares: Array
    lags: list[Lag]

    def best(self, order: int) -> tuple[Array, list[Lag]]:
        """Returns the least squares of each dead time, and the lag that has it."""
        members = [i for i, lag in enumerate(self.lags) if lag.order == order]
        chosen = np.argmin(self.squares[members], axis=0)
        least = self.squares[members].min(axis=0)
        return least, [self.lags[members[i]] for i in chosen]


def _search(
    pair: SignalPair, orders: Sequence[int], known: Sequence[Lag] = ()
) -> _Coarse:
    """Returns the sum of squares of all dead times on a grid, for a family of lags.

    Args:
        pair: The record.
        orders: The orders of the lags of the family.
        known: Further lags.
    """
    from scipy.signal import fftconvolve

    span = 2 * pair.half
    stride = -(-len(pair.grid) // _MOST_COARSE)
    count = len(pair.grid) // stride
    step = pair.step * stride
    # Means of neighbours: what is dropped otherwise would be folded into the rest.
    part = slice(0, count * stride)
    times = pair.grid[part].reshape(count, stride).mean(axis=1)
    u = pair.on_grid[part].reshape(count, stride).mean(axis=1)
    y = np.interp(times, pair.time, pair.response)
    most = min(math.ceil(pair.maximum / step), count - 2)
    kept = y[most:] - y[most:].mean()
    num = len(kept)
    taus = np.geomspace(2 * step, max(span / 8, 4 * step), _NUM_TIMES)
    lags = [*known, *[Lag()] * (0 in orders)]
    lags += [Lag(1, float(tau)) for tau in taus if 1 in orders]
    lags += [Lag(2, float(x), d) for x in taus for d in _DAMPINGS if 2 in orders]
    squares = []
    for lag in lags:
        z = lagged(u, step, lag)
        z = z - z.mean()
        sums = np.concatenate([[0.0], np.cumsum(z)])
        powers = np.concatenate([[0.0], np.cumsum(z * z)])
        # Row i of the response meets z at i - k, k = 0 to `most`.
        first = most - np.arange(most + 1)
        total = sums[first + num] - sums[first]
        power = powers[first + num] - powers[first] - total**2 / num
        products = fftconvolve(z, kept[::-1], mode="valid")[::-1]
        gained = products**2 / np.maximum(power, 1e-300)
        gained[power < 1e-12 * max(power.max(), 1e-300)] = 0.0
        squares.append(np.maximum(kept @ kept - gained, 0.0))
    scale = len(pair.y) / num
    return _Coarse(step * np.arange(most + 1), np.array(squares) * scale, lags)


class LagFit(NamedTuple):
    """The best fit with a lag of one order, and the dead times not refuted with it.

    Attributes:
        fit: The best fit.
        intervals: The dead times that the record does not refute, s, ascending; empty
            if the record refutes a lag of this order.
    """

    fit: Fit
    intervals: list[Interval]


@dataclass(frozen=True, kw_only=True)
class DeadTime:
    """What a record tells about the dead time.

    Attributes:
        order: The order of the lag that the Bayesian information criterion prefers.
        fits: The fits with lags of the allowed orders, by order.
        num_independent: The number of independent rows.
        num_pairs: The number of independent pairs of rows if the signals are unrelated.
        explained: The share of the response's variance that the command explains.
        intervals: The dead times that no allowed order refutes, s, ascending and
            disjoint.
        search: Dead times in s, and the least root mean square error that was found
            with each (2, K).
    """

    order: int
    fits: dict[int, LagFit]
    num_independent: float
    num_pairs: float
    explained: float
    intervals: list[Interval]
    search: Array

    @property
    def fit(self) -> Fit:
        """The chosen fit."""
        return self.fits[self.order].fit


def find_dead_time(pair: SignalPair, orders: Sequence[int] = (0, 1, 2)) -> DeadTime:
    """Fits the dead time together with a lag of each allowed order.

    Args:
        pair: The record.
        orders: The orders of the lag that are allowed, ascending.
    """
    from scipy.stats import f

    coarse = _search(pair, orders)
    best: dict[int, Fit] = {}
    for order in orders:
        least, lags = coarse.best(order)
        k = int(np.argmin(least))
        starts = [Fit(float(coarse.delays[k]), 0.0, lags[k], 0.0)]
        # The fit with a lag of a lower order is a start, too.
        if order - 1 in best:
            lower = best[order - 1]
            damping = 5.0 if order == 2 else 1.0
            time = max(lower.lag.time, pair.row_step) / (2 * damping)
            starts.append(lower._replace(lag=Lag(order, time, damping)))
        found = [pair.refine(start, num_trials=40) for start in starts]
        best[order] = min(found, key=lambda fit: fit.squares)
    richest = best[orders[-1]]
    residuals = pair.residuals(richest)
    independent = independent_count(residuals)
    floor = pair.rounding(richest)

    def criterion(order: int) -> float:
        """Returns the Bayesian information criterion, up to a constant."""
        squares = best[order].squares + floor
        return independent * math.log(max(squares, 1e-300)) + order * math.log(
            independent
        )

    degrees = max(independent - 4 - orders[-1], 2.0)
    limit = richest.squares * (1 + f.ppf(_CONFIDENCE, 1, degrees) / degrees) + floor
    variance = float(np.var(pair.y))
    chosen = min(orders, key=criterion)
    left = float(np.mean(pair.left(best[chosen]) ** 2))
    explained = 1 - left / max(variance, 1e-300)
    fits = {
        order: LagFit(fit, _not_refuted(pair, coarse, fit, limit))
        for order, fit in best.items()
    }
    # The first search does not have the lag of the fit, which explains more.
    searched = [coarse.squares, _search(pair, (), [best[chosen].lag]).squares]
    least = np.concatenate(searched).min(axis=0)
    delay = best[chosen].delay
    every = [x for fit in fits.values() for x in fit.intervals]
    return DeadTime(
        order=chosen,
        fits=fits,
        num_independent=independent,
        num_pairs=common_count(pair.delayed(best[chosen]), pair.y),
        explained=explained if variance > 0 else 0.0,
        intervals=_merged([*every, (delay, delay)], pair.row_step),
        search=np.stack([coarse.delays, np.sqrt(least / len(pair.y))]),
    )


def _autocorrelation(signal: Array) -> Array:
    """Returns the autocorrelation of a signal (N) at lags from 0 to N/2."""
    deviations = signal - signal.mean()
    power = float(deviations @ deviations)
    if power == 0:
        return np.ones(1)
    size = 2 ** math.ceil(math.log2(2 * len(signal)))
    spectrum = np.abs(np.fft.rfft(deviations, size)) ** 2
    correlation: Array = np.fft.irfft(spectrum, size)[: len(signal) // 2] / power
    return correlation


def independent_count(residuals: Array) -> float:
    """Returns the number of independent rows that carry as much information.

    It is the number of rows divided by the sum of the autocorrelations, which is cut
    off where five times the sum is exceeded (A. Sokal, in Functional Integration,
    1997).
    """
    num = len(residuals)
    times = 2 * np.cumsum(_autocorrelation(residuals)) - 1
    is_cut = np.arange(len(times)) >= 5 * times
    cut = int(np.argmax(is_cut)) if is_cut.any() else len(times) - 1
    return float(min(max(num / max(times[cut], 1e-9), 8.0), num))


def common_count(first: Array, second: Array) -> float:
    """Returns the number of independent pairs of rows of two unrelated signals.

    The correlation coefficient of two unrelated signals has the variance 1/count, with
    the count N / sum of the products of their autocorrelations (M. S. Bartlett, J. R.
    Stat. Soc. 98, 1935).
    """
    products = _autocorrelation(first) * _autocorrelation(second)
    total = max(2 * float(products.sum()) - 1, 1.0)
    return max(len(first) / total, 1.0)


def _not_refuted(
    pair: SignalPair, coarse: _Coarse, best: Fit, limit: float
) -> list[Interval]:
    """Returns the dead times whose least squares, with a lag of an order, stay low.

    Args:
        best: The best fit with a lag of that order.
        limit: The largest sum of squares that is not refuted.
    """
    intervals = []
    if best.squares <= limit:
        intervals.append(_around(pair, best, limit))
    least, lags = coarse.best(best.lag.order)
    falls = np.r_[True, least[1:] <= least[:-1]]
    rises = np.r_[least[:-1] <= least[1:], True]
    minima = sorted(np.flatnonzero(falls & rises), key=lambda k: least[k])
    for k in minima[:_MOST_MINIMA]:
        start = Fit(float(coarse.delays[k]), best.drift, lags[k], 0.0)
        if _lies_in(start.delay, intervals, coarse.delays[1]):
            continue
        fit = pair.refine(start, num_trials=20)
        if fit.squares <= limit and not _lies_in(fit.delay, intervals, pair.step):
            intervals.append(_around(pair, fit, limit))
    return _joined(pair, best, _merged(intervals, pair.row_step), limit)


def _joined(
    pair: SignalPair, best: Fit, intervals: list[Interval], limit: float
) -> list[Interval]:
    """Joins neighbours if the dead time between them is not refuted, either."""
    joined = intervals[:1]
    for low, high in intervals[1:]:
        middle = (joined[-1][1] + low) / 2
        if pair.refine(best, middle).squares <= limit:
            joined[-1] = (joined[-1][0], high)
        else:
            joined.append((low, high))
    return joined


def _lies_in(delay: float, intervals: list[Interval], margin: float) -> bool:
    return any(low - margin <= delay <= high + margin for low, high in intervals)


def _merged(intervals: list[Interval], margin: float) -> list[Interval]:
    """Returns the union of intervals, ascending; those within a margin are joined."""
    merged: list[Interval] = []
    for low, high in sorted(intervals):
        if merged and low <= merged[-1][1] + margin:
            merged[-1] = (merged[-1][0], max(high, merged[-1][1]))
        else:
            merged.append((low, high))
    return merged


def _around(pair: SignalPair, best: Fit, limit: float) -> Interval:
    """Returns the dead times about a fit whose least squares stay below a limit."""
    ends = []
    for sign, bound in ((-1, 0.0), (1, pair.maximum)):
        inner = best
        distance = pair.step / 2
        is_last = False
        while not is_last:
            delay = best.delay + sign * distance
            is_last = sign * (delay - bound) >= 0
            outer = pair.refine(inner, bound if is_last else delay)
            if outer.squares > limit:
                break
            inner = outer
            distance *= 3
        if inner is not outer:
            ends.append(_edge(pair, best.squares, inner, outer, limit))
        else:
            ends.append(bound)
    return ends[0], ends[1]


def _edge(
    pair: SignalPair, least: float, inner: Fit, outer: Fit, limit: float
) -> float:
    """Returns the dead time between two fits at which the limit is reached, s.

    Args:
        least: The least sum of squares, from which the root of the excess grows nearly
            in proportion to the distance.
    """
    from scipy.optimize import brentq

    def distance(squares: float) -> float:
        return math.sqrt(max(squares - least, 0.0)) - math.sqrt(limit - least)

    def distance_at(delay: float) -> float:
        known = {inner.delay: inner.squares, outer.delay: outer.squares}
        if delay in known:
            return distance(known[delay])
        return distance(pair.refine(inner, delay).squares)

    tolerance = 1e-3 * abs(outer.delay - inner.delay)
    return float(brentq(distance_at, inner.delay, outer.delay, xtol=tolerance))

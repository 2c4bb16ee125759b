"""The dead time between two recorded signals, separated from the response's own lag.

    y(t) = a + b z(t - T(t)) + noise,   z: a lag's response to the command u

with T(t) = T + d (t - t_m), t_m the middle of the record. The dead time T, its drift d
and the lag are fitted together by least squares. The gain b, the offset a and the lag's
motion from before the record are linear and are eliminated (variable projection: G. H.
Golub and V. Pereyra, SIAM J. Numer. Anal. 10, 1973).

A first search covers all dead times at once: for a given lag, the correlation of z and
y by FFT has the error of each. The profile

    S(T) = least sum of squares over everything but T

decides what the record can tell. Dead times with S(T) <= S_min (1 + F/n) are not
refuted; F is the 95 % quantile of the F distribution, and n the number of independent
rows, which is smaller than the number of rows if the residuals are correlated.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from teleop_drake.arrays import Array, Interval
from teleop_drake.numerics.lagged_signal import Lag, free_motions, lagged

# The most rows that are fitted, and the most points of the first search.
_MOST_ROWS = 10_000
_MOST_COARSE = 2**14

# The command's grid has this number of points for each row, up to a most.
_POINTS_PER_ROW = 8
_MOST_POINTS = 200_000

# The lags of the first search: their time constants, as shares of the record, and their
# damping ratios.
_NUM_TIMES = 12
_DAMPINGS = (0.2, 0.7, 1.5)

# The damping ratios that a fit may find.
_LEAST_DAMPING = 0.02
_MOST_DAMPING = 20.0

# The confidence of intervals.
_CONFIDENCE = 0.95

# The most minima of the first search that are examined closely.
_MOST_MINIMA = 5


_Curve = Callable[[Array, Array, Array], Array]
"""A function of times in s, and of the times and values of samples."""


def _spline(t: Array, times: Array, values: Array) -> Array:
    """Returns the cubic spline through samples."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(times, values)(t))


def _lines(t: Array, times: Array, values: Array) -> Array:
    """Returns the straight lines through samples."""
    return np.asarray(np.interp(t, times, values))


class Fit(NamedTuple):
    """A fitted model.

    Attributes:
        delay: The dead time in the middle of the record, s.
        drift: Its change per time, s/s.
        lag: The response's own lag.
        squares: The sum of the squared residuals.
    """

    delay: float
    drift: float
    lag: Lag
    squares: float


@dataclass
class DeadTimeProblem:
    """A command and a response, prepared for fits of a dead time.

    Args:
        command_time: Times of the command's rows, s, ascending (M).
        command: The command (M). Between rows it is read along a cubic spline or along
            straight lines, whichever passes closer to rows that are left out.
        time: Times of the response's rows, s, ascending (N).
        response: The response (N).
        maximum: The largest dead time that is considered, s, > 0. Rows of the response
            within this time of the first command are not fitted.
        spread: The standard deviation in s of delays that differ from row to row. On
            average, they blur the command.
    """

    command_time: Array
    command: Array
    time: Array
    response: Array
    maximum: float
    spread: float = 0.0

    def __post_init__(self) -> None:
        from scipy.ndimage import gaussian_filter1d

        begin = self.command_time[0]
        end = self.command_time[-1]
        span = end - begin
        self.middle = begin + span / 2
        self.half = span / 2
        self.row_step = float(np.median(np.diff(self.command_time)))
        count = min(round(_POINTS_PER_ROW * span / self.row_step), _MOST_POINTS) + 1
        self.grid = np.linspace(begin, end, count)
        self.step = span / (count - 1)
        curves: list[_Curve] = [_spline, _lines]
        errors = [self._error_of(curve) for curve in curves]
        best = int(np.argmin(errors))
        self.on_grid = curves[best](self.grid, self.command_time, self.command)
        # The error at rows that are left out is at least four times as large. A lag
        # reads the grid along lines.
        bend = float(np.sqrt(np.mean(np.diff(self.on_grid, 2) ** 2)))
        self.command_error = math.hypot(errors[best] / 4, bend / 12)
        if self.spread > 0:
            width = self.spread / self.step
            self.on_grid = gaussian_filter1d(self.on_grid, width, mode="nearest")
        is_fitted = self.time >= begin + self.maximum - self.step / 2
        rows = np.flatnonzero(is_fitted & (self.time <= end))
        stride = -(-len(rows) // _MOST_ROWS)
        self.rows = rows[::stride]
        self.t = self.time[self.rows]
        self.y = self.response[self.rows]
        self.weights = np.ones(len(self.y))

    def _error_of(self, curve: _Curve) -> float:
        """Returns the error of the curve through every other row at those left out."""
        left_out = slice(1, 2 * ((len(self.command) - 1) // 2), 2)
        known = self.command_time[::2], self.command[::2]
        errors = self.command[left_out] - curve(self.command_time[left_out], *known)
        return float(np.sqrt(np.mean(errors**2)))

    def rounding(self, fit: Fit) -> float:
        """Returns the sum of squares that the command's error may cause."""
        error = self.gain(fit) * self.command_error
        power = float(self.weights @ self.weights)
        return power * error**2 + 1e-20 * float(np.sum((self.weights * self.y) ** 2))

    @cached_property
    def is_stepwise(self) -> bool:
        """Whether the command jumps from row to row and is held in between."""
        moves = np.diff(self.command) != 0
        alone = moves & ~np.r_[False, moves[:-1]] & ~np.r_[moves[1:], False]
        return bool(alone.sum() > moves.sum() / 2)

    @cached_property
    def least_lag(self) -> float:
        """The least time constant that a fit may find, s."""
        return self.row_step / 50

    @cached_property
    def most_lag(self) -> float:
        """The largest time constant that a fit may find, s."""
        return self.half / 2

    def delayed(self, fit: Fit, signal: Array | None = None) -> Array:
        """Returns the lagged and delayed command at the fitted rows."""
        z = lagged(self.on_grid, self.step, fit.lag) if signal is None else signal
        delays = fit.delay + fit.drift * (self.t - self.middle)
        return self.read(z, self.t - delays)

    def read(self, signal: Array, times: Array) -> Array:
        """Returns a signal on the grid at times in s, by Keys' cubic convolution.

        Source: R. G. Keys, IEEE Trans. Acoust. Speech Signal Process. 29 (1981).
        """
        place = np.clip((times - self.grid[0]) / self.step, 0.0, len(self.grid) - 1.0)
        i = np.clip(place.astype(int), 1, len(self.grid) - 3)
        f = place - i
        before, here, after, last = (signal[i + k] for k in (-1, 0, 1, 2))
        slope = (after - before) / 2
        bend = before - 2.5 * here + 2 * after - last / 2
        twist = (last - before) / 2 + 1.5 * (here - after)
        values: Array = here + f * (slope + f * (bend + f * twist))
        return values

    def columns(self, fit: Fit) -> Array:
        """Returns the columns whose combination is the response: 1, z, free motions."""
        motions = free_motions(self.t - self.t[0], fit.lag)
        return np.column_stack([np.ones(len(self.t)), self.delayed(fit), motions])

    def residuals(self, fit: Fit) -> Array:
        """Returns what no combination of the columns explains, times the weights."""
        basis, _ = np.linalg.qr(self.columns(fit) * self.weights[:, np.newaxis])
        y = self.y * self.weights
        residuals: Array = y - basis @ (basis.T @ y)
        return residuals

    def combination(self, fit: Fit) -> Array:
        """Returns the factors of the columns: offset, gain, and of the motions."""
        weights = self.weights[:, np.newaxis]
        columns = self.columns(fit) * weights
        best: Array
        best, *_ = np.linalg.lstsq(columns, self.y * self.weights, rcond=1e-10)
        return best

    def gain(self, fit: Fit) -> float:
        """Returns the gain b of a fit."""
        return float(self.combination(fit)[1])

    def left(self, fit: Fit) -> Array:
        """Returns the residuals without weights."""
        return self.y - self.columns(fit) @ self.combination(fit)

    def refine(
        self, start: Fit, delay: float | None = None, num_trials: int = 8
    ) -> Fit:
        """Returns the best fit near another one, with a lag of the same order.

        Args:
            start: The fit at which the search starts.
            delay: The dead time in s that is held fixed with the drift; None: both are
                fitted.
            num_trials: The most steps of the search.
        """
        from scipy.optimize import least_squares

        order = start.lag.order
        bounds = [(math.log(self.least_lag), math.log(self.most_lag))][:order]
        bounds += [(math.log(_LEAST_DAMPING), math.log(_MOST_DAMPING))][: order - 1]
        if delay is None:
            # Times are scaled by the step of the grid.
            bounds += [(-0.9 * self.half / self.step, 0.9 * self.half / self.step)]
            bounds += [(0.0, self.maximum / self.step)]
        elif order == 0:
            fit = start._replace(delay=delay)
            return fit._replace(squares=float(np.sum(self.residuals(fit) ** 2)))
        ratios = [start.lag.time, start.lag.damping][:order]
        x0 = [math.log(max(x, self.least_lag)) for x in ratios]
        if delay is None:
            x0 += [start.drift * self.half / self.step, start.delay / self.step]
        low, high = np.transpose(bounds)
        margin = 1e-6 * (high - low)

        def fit_of(x: Array) -> Fit:
            lag = Lag(order, *np.exp(x[:order]))
            if delay is not None:
                return Fit(delay, start.drift, lag, 0.0)
            drift = float(x[-2]) * self.step / self.half
            return Fit(float(x[-1]) * self.step, drift, lag, 0.0)

        result = least_squares(
            lambda x: self.residuals(fit_of(x)),
            np.clip(x0, low + margin, high - margin),
            bounds=(low, high),
            x_scale=[*[0.1] * order, *[1.0] * (len(x0) - order)],
            max_nfev=num_trials,
            ftol=1e-8,
            xtol=1e-8,
        )
        return fit_of(result.x)._replace(squares=float(2 * result.cost))


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


def _search(problem: DeadTimeProblem, orders: Sequence[int]) -> _Coarse:
    """Returns the sum of squares of all dead times on a grid, for a family of lags."""
    from scipy.signal import fftconvolve

    span = 2 * problem.half
    stride = -(-len(problem.grid) // _MOST_COARSE)
    count = len(problem.grid) // stride
    step = problem.step * stride
    # Means of neighbours: what is dropped otherwise would be folded into the rest.
    part = slice(0, count * stride)
    times = problem.grid[part].reshape(count, stride).mean(axis=1)
    u = problem.on_grid[part].reshape(count, stride).mean(axis=1)
    y = np.interp(times, problem.time, problem.response)
    most = min(math.ceil(problem.maximum / step), count - 2)
    kept = y[most:] - y[most:].mean()
    num = len(kept)
    taus = np.geomspace(2 * step, max(span / 8, 4 * step), _NUM_TIMES)
    lags = [Lag()] * (0 in orders)
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
    scale = len(problem.y) / num
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
        search: Dead times in s, and the root mean square error of the best fit of the
            first search with each (2, K).
    """

    order: int
    fits: dict[int, LagFit]
    num_independent: float
    num_pairs: float
    explained: float
    search: Array

    @property
    def fit(self) -> Fit:
        """The chosen fit."""
        return self.fits[self.order].fit

    @property
    def intervals(self) -> list[Interval]:
        """The dead times that no allowed order refutes, s, ascending and disjoint."""
        delay = self.fit.delay
        every = [x for fit in self.fits.values() for x in fit.intervals]
        return _merged([*every, (delay, delay)], 0.0)


def find_dead_time(
    problem: DeadTimeProblem, orders: Sequence[int] = (0, 1, 2)
) -> DeadTime:
    """Fits the dead time together with a lag of each allowed order.

    Args:
        problem: The record.
        orders: The orders of the lag that are allowed, ascending.
    """
    from scipy.stats import f

    coarse = _search(problem, orders)
    best: dict[int, Fit] = {}
    for order in orders:
        least, lags = coarse.best(order)
        k = int(np.argmin(least))
        starts = [Fit(float(coarse.delays[k]), 0.0, lags[k], 0.0)]
        # The fit with a lag of a lower order is a start, too.
        if order - 1 in best:
            lower = best[order - 1]
            damping = 5.0 if order == 2 else 1.0
            time = max(lower.lag.time, problem.row_step) / (2 * damping)
            starts.append(lower._replace(lag=Lag(order, time, damping)))
        found = [problem.refine(start, num_trials=40) for start in starts]
        best[order] = min(found, key=lambda fit: fit.squares)
    richest = best[orders[-1]]
    residuals = problem.residuals(richest)
    independent = independent_count(residuals)
    floor = problem.rounding(richest)

    def criterion(order: int) -> float:
        """Returns the Bayesian information criterion, up to a constant."""
        squares = best[order].squares + floor
        return independent * math.log(max(squares, 1e-300)) + order * math.log(
            independent
        )

    degrees = max(independent - 4 - orders[-1], 2.0)
    limit = richest.squares * (1 + f.ppf(_CONFIDENCE, 1, degrees) / degrees) + floor
    variance = float(np.var(problem.y))
    chosen = min(orders, key=criterion)
    left = float(np.mean(problem.left(best[chosen]) ** 2))
    explained = 1 - left / max(variance, 1e-300)
    return DeadTime(
        order=chosen,
        fits={
            order: LagFit(fit, _not_refuted(problem, coarse, fit, limit))
            for order, fit in best.items()
        },
        num_independent=independent,
        num_pairs=common_count(problem.delayed(best[chosen]), problem.y),
        explained=explained if variance > 0 else 0.0,
        search=np.stack(
            [coarse.delays, np.sqrt(coarse.squares.min(axis=0) / len(problem.y))]
        ),
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
    problem: DeadTimeProblem, coarse: _Coarse, best: Fit, limit: float
) -> list[Interval]:
    """Returns the dead times whose least squares, with a lag of an order, stay low.

    Args:
        best: The best fit with a lag of that order.
        limit: The largest sum of squares that is not refuted.
    """
    intervals = []
    if best.squares <= limit:
        intervals.append(_around(problem, best, limit))
    least, lags = coarse.best(best.lag.order)
    falls = np.r_[True, least[1:] <= least[:-1]]
    rises = np.r_[least[:-1] <= least[1:], True]
    minima = sorted(np.flatnonzero(falls & rises), key=lambda k: least[k])
    for k in minima[:_MOST_MINIMA]:
        start = Fit(float(coarse.delays[k]), best.drift, lags[k], 0.0)
        if _lies_in(start.delay, intervals, coarse.delays[1]):
            continue
        fit = problem.refine(start, num_trials=20)
        if fit.squares <= limit and not _lies_in(fit.delay, intervals, problem.step):
            intervals.append(_around(problem, fit, limit))
    return _joined(problem, best, _merged(intervals, problem.row_step), limit)


def _joined(
    problem: DeadTimeProblem, best: Fit, intervals: list[Interval], limit: float
) -> list[Interval]:
    """Joins neighbours if the dead time between them is not refuted, either."""
    joined = intervals[:1]
    for low, high in intervals[1:]:
        middle = (joined[-1][1] + low) / 2
        if problem.refine(best, middle).squares <= limit:
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


def _around(problem: DeadTimeProblem, best: Fit, limit: float) -> Interval:
    """Returns the dead times about a fit whose least squares stay below a limit."""
    ends = []
    for sign, bound in ((-1, 0.0), (1, problem.maximum)):
        inner = best
        distance = problem.step / 2
        is_last = False
        while not is_last:
            delay = best.delay + sign * distance
            is_last = sign * (delay - bound) >= 0
            outer = problem.refine(inner, bound if is_last else delay)
            if outer.squares > limit:
                break
            inner = outer
            distance *= 3
        if inner is not outer:
            ends.append(_edge(problem, best.squares, inner, outer, limit))
        else:
            ends.append(bound)
    return ends[0], ends[1]


def _edge(
    problem: DeadTimeProblem, least: float, inner: Fit, outer: Fit, limit: float
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
        return distance(problem.refine(inner, delay).squares)

    tolerance = 1e-3 * abs(outer.delay - inner.delay)
    return float(brentq(distance_at, inner.delay, outer.delay, xtol=tolerance))

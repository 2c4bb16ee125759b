"""A command and a response, prepared for fits of a dead time with a lag.

    y(t) = a + b z(t - T - d (t - t_m)),   z: a lag's response to the command u      (1)

The dead time T, its drift d and the lag are fitted by least squares, with t_m the
middle of the record. The gain b, the offset a and the lag's motion from before the
record are linear and are eliminated (variable projection: G. H. Golub and V. Pereyra,
SIAM J. Numer. Anal. 10, 1973).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.study.numerics.lagged_signal import Lag, free_motions, lagged

# The most rows that are fitted.
_MOST_ROWS = 10_000

# The command's grid has this number of points for each row, up to a most.
_POINTS_PER_ROW = 8
_MOST_POINTS = 200_000

# The damping ratios that a fit may find.
_LEAST_DAMPING = 0.02
_MOST_DAMPING = 20.0

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
class SignalPair:
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
        explained: Array = basis @ (basis.T @ y)
        return y - explained

    def combination(self, fit: Fit) -> Array:
        """Returns the factors of the columns: offset, gain, and of the motions."""
        weights = self.weights[:, np.newaxis]
        columns = self.columns(fit) * weights
        found = np.linalg.lstsq(columns, self.y * self.weights, rcond=1e-10)
        return np.asarray(found[0])

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

"""How a delay between two signals changes: over time and from row to row; losses.

All functions start from a fit of the mean dead time, see signal_pair, and look at what
it leaves. With z the delayed command, b the gain and e the residual of a row, a delay
that is d longer there has

    e = -b z' d + noise.                                                         (1)
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from teleop_drake.arrays import Array, Indices
from teleop_drake.numerics.dead_time import independent_count
from teleop_drake.numerics.lagged_signal import lagged
from teleop_drake.numerics.signal_pair import Fit, SignalPair

# A window whose delay has a larger standard error than this share of the time in which
# the command changes by its own size tells nothing.
_BLUR = 0.3

# The most Gauss-Newton steps for the delay of a window, and the steps of the search
# before them as a share of the time in which the command changes.
_NUM_STEPS = 8
_SEARCH_SHARE = 0.5

# A row counts as moving if the command changes by more than this number of quanta, or
# of standard deviations of the noise, from the row before.
_MOVES = 3.0


class Course(NamedTuple):
    """The delays of the windows of a record.

    Attributes:
        times: The middles of the windows, s (W).
        delays: The dead times, s (W); NaN where the command moves too little.
        errors: Their standard errors, s (W).
    """

    times: Array
    delays: Array
    errors: Array


def delay_course(pair: SignalPair, fit: Fit, num_windows: int) -> Course:
    """Returns the dead time in each of some windows of equal length."""
    z = lagged(pair.on_grid, pair.step, fit.lag)
    offset, gain, *_ = pair.combination(fit)
    noise = np.sqrt(np.mean(pair.left(fit) ** 2))
    edges = np.linspace(pair.t[0], pair.t[-1], num_windows + 1)
    first = np.unique(np.searchsorted(pair.t, edges[:-1]))
    window = np.searchsorted(first, np.arange(len(pair.t)), side="right") - 1
    base = fit.delay + fit.drift * (pair.t - pair.middle)
    slope = np.gradient(z, pair.step)
    speed = float(np.sqrt(np.mean(slope**2)))
    # The time in which the command changes by its own size.
    blur = float(np.std(z)) / speed if speed > 0 else pair.maximum

    def errors_at(shift: Array) -> Array:
        times = pair.t - base - shift[window]
        return pair.y - offset - gain * pair.read(z, times)

    shift = _search(errors_at, first, blur, pair.maximum)
    power = np.ones(len(first))
    for _ in range(_NUM_STEPS):
        times = pair.t - base - shift[window]
        slopes = gain * pair.read(slope, times)
        power = np.add.reduceat(slopes**2, first)
        step = -np.add.reduceat(errors_at(shift) * slopes, first)
        shift = shift + np.clip(step / np.maximum(power, 1e-300), -blur, blur)
    correlated = len(pair.y) / independent_count(errors_at(shift))
    errors = noise * np.sqrt(correlated / np.maximum(power, 1e-300))
    times = np.add.reduceat(pair.t, first) / np.diff(np.append(first, len(window)))
    delays = fit.delay + fit.drift * (times - pair.middle) + shift
    delays[(errors > _BLUR * blur) | (delays < 0)] = np.nan
    return Course(times, delays, errors)


def _search(
    errors_at: Callable[[Array], Array], first: Indices, blur: float, maximum: float
) -> Array:
    """Returns the shift of each window, among some, with the least squares."""
    step = _SEARCH_SHARE * blur
    count = min(int(maximum / step), 40)
    shifts = step * np.arange(-count, count + 1)
    squares = [
        np.add.reduceat(errors_at(np.full(len(first), x)) ** 2, first) for x in shifts
    ]
    return shifts[np.argmin(squares, axis=0)]


def drift_error(pair: SignalPair, fit: Fit, independent: float) -> float:
    """Returns the standard error of a fitted drift in s/s, from (1)."""
    z = lagged(pair.on_grid, pair.step, fit.lag)
    gain = pair.gain(fit)
    powers = pair.delayed(fit, gain * np.gradient(z, pair.step)) ** 2
    total = max(float(powers.sum()), 1e-300)
    mean = float(powers @ pair.t) / total
    moment = float(powers @ (pair.t - mean) ** 2)
    left = float(np.sum(pair.left(fit) ** 2))
    return float(np.sqrt(left / max(independent * moment, 1e-300)))


class Spread(NamedTuple):
    """How the delay varies from row to row.

    Attributes:
        spread: The standard deviation of the delay, s.
        error: Its standard error, s; at least what rounding of the signals causes.
        noise: The standard deviation of the noise, in the unit of the response.
        levels: The variance of the residual of each fitted row (N).
    """

    spread: float
    error: float
    noise: float
    levels: Array


def row_spread(pair: SignalPair, fit: Fit) -> Spread:
    """Returns how the delay varies from row to row, and the noise.

    By (1), the mean of e^2 is a line in (b z')^2 whose slope is the delay's variance
    and whose value at 0 is the variance of the noise. The line is fitted by weighted
    least squares, with the variance of e^2 for normal e.
    """
    z = lagged(pair.on_grid, pair.step, fit.lag)
    slopes = pair.delayed(fit, pair.gain(fit) * np.gradient(z, pair.step))
    powers = slopes**2
    squares = pair.left(fit) ** 2
    scale = float(powers.max(initial=0.0))
    if scale == 0:
        return Spread(0.0, np.inf, float(np.sqrt(squares.mean())), squares)
    columns = np.column_stack([np.ones(len(powers)), powers / scale])
    floor = 1e-9 * squares.mean() + 1e-300
    levels = np.full(len(powers), squares.mean() + floor)
    for _ in range(_NUM_STEPS):
        weighted = columns / levels[:, np.newaxis]
        (noise, slope), *_ = np.linalg.lstsq(weighted, squares / levels, rcond=None)
        noise = max(noise, 0.0)
        slope = max(slope, 0.0)
        levels = noise + slope * columns[:, 1] + floor
    inverse = np.linalg.pinv(weighted.T @ weighted)
    error = np.sqrt(2 * max(float(inverse[1, 1]), 0.0))
    spread = float(np.sqrt(slope / scale))
    more = float(np.sqrt((slope + error) / scale))
    # What rounding of the signals may look like.
    rounding = _rounding(pair, fit) / float(np.sqrt(powers.mean()))
    error = max(more - spread, rounding)
    return Spread(spread, error, float(np.sqrt(noise)), levels)


def _rounding(pair: SignalPair, fit: Fit) -> float:
    """Returns the standard deviation of the signals' errors between and at rows.

    The quantum of a signal is taken to be its least change from row to row.
    """
    gain = pair.gain(fit)
    quanta = [gain * _quantum(pair.command), _quantum(pair.response)]
    return float(
        np.hypot(np.linalg.norm(quanta) / np.sqrt(12), gain * pair.command_error)
    )


def _quantum(signal: Array) -> float:
    changes = np.abs(np.diff(signal))
    return float(changes[changes > 0].min(initial=np.inf))


def held_share(pair: SignalPair, fit: Fit) -> float | None:
    """Returns the share of packets that left the response unchanged: lost, or too late.

    The response must hold each packet until the next one, and more than half of the
    packets must arrive. Packets are counted while the command moves.

    Returns:
        The share; None if the response never holds a value, as with noise of its own.
    """
    t = pair.time[pair.time >= pair.t[0]]
    y = pair.response[-len(t) :]
    gain = pair.gain(fit)
    delays = fit.delay + fit.drift * (t - pair.middle)
    z = pair.read(pair.on_grid, t - delays)
    moves = np.abs(gain * np.diff(z))
    changes = np.diff(y)
    is_changed = changes != 0
    is_moving = moves > _MOVES * _quantum(y)
    # The times of changes, and the number of slow rows up to each.
    at = np.flatnonzero(is_changed & is_moving)
    slow = np.cumsum(~is_moving)[at]
    gaps = np.diff(t[at + 1])[np.diff(slow) == 0]
    if len(gaps) < 2:
        return None
    # Gaps without more rows than usual have lost nothing: their rows are uneven.
    rows = np.diff(at)[np.diff(slow) == 0]
    share = _missing_share(gaps) if np.any(rows > np.median(rows)) else 0.0
    noise = np.sqrt(np.mean(pair.left(fit) ** 2))
    if share == 0 and noise > np.median(moves[is_moving]):
        return None
    return share


def _missing_share(gaps: Array) -> float:
    """Returns the share of missing packets, from the times between those that came.

    With a share q missing, gaps are longer by 1/(1 - q) on average. Of the gaps, the
    share 1 - q is one period long, more or less, so that the period is the quantile of
    (1 - q)/2. Single gaps may vary by more than half a period.
    """
    share = 0.0
    for _ in range(_NUM_STEPS):
        period = np.quantile(gaps, (1 - share) / 2)
        share = min(max(1 - float(period / gaps.mean()), 0.0), 0.5)
    return share

"""How a delay between two signals changes: over time and from row to row; losses.

All functions start from a fit of the mean dead time, see signal_pair, and look at what
it leaves. With z the delayed command, b the gain and e the residual of a row, a delay
that is d longer there has

    e = -b z' d + noise.                                                         (1)
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.study.numerics.dead_time import independent_count
from teleop_drake.study.numerics.lagged_signal import lagged
from teleop_drake.study.numerics.signal_pair import Fit, SignalPair

# A window whose delay has a larger standard error than this share of the time in which
# the command changes by its own size tells nothing.
_BLUR = 0.3

# The most Gauss-Newton steps for the delay of a window, and the steps of the search
# before them as a share of the time in which the command changes.
_NUM_STEPS = 8
_SEARCH_SHARE = 0.5

# The sending time of a packet is told by a command that is faster than this share of
# its root mean square speed.
_SLOW = 0.1

# The share of gaps between packets, at most, that are shorter than one period; how far
# gaps may be from whole periods, in periods (random times: 0.29); the fewest gaps.
_ADJACENT = 0.1
_UNEVEN = 0.15
_FEWEST_PACKETS = 10


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


class Missing(NamedTuple):
    """Packets that a response does not show.

    Attributes:
        share: The share of all packets that left the response unchanged.
        hidden: The most of this share that is due to packets that came, and were
            replaced by the next one before a row showed them.
    """

    share: float
    hidden: float


def missing_packets(pair: SignalPair, fit: Fit) -> Missing | None:
    """Returns the packets that left the response unchanged: lost, late or replaced.

    The response must hold each packet until the next one, and packets must be sent at
    equal times. Each value of the response tells when its packet was sent, because it
    is the command of that instant. Packets are counted while the command moves.

    Two packets that come within a row spacing h of each other are seen as one if no row
    is between them. If the probability density of the time between them does not fall
    up to 2 h, packets that are hidden are at most half of the gaps of one row.

    Returns:
        The shares; None if the response does not consist of such packets, as with noise
        of its own.
    """
    t = pair.time[pair.time >= pair.t[0]]
    y = pair.response[-len(t) :]
    if pair.gain(fit) == 0:
        return None
    at = np.flatnonzero(np.diff(y)) + 1
    sent = _sending_times(pair, fit, t[at], y[at])
    gaps = np.diff(sent)
    is_known = np.isfinite(gaps)
    gaps = gaps[is_known]
    if len(gaps) < _FEWEST_PACKETS:
        return None
    period = np.quantile(gaps, _ADJACENT)
    for _ in range(_NUM_STEPS):
        counts = np.maximum(np.round(gaps / period), 1)
        period = gaps.sum() / counts.sum()
    if np.sqrt(np.mean((gaps / period - counts) ** 2)) > _UNEVEN:
        return None
    share = 1 - len(gaps) / counts.sum()
    rows = np.diff(at)[is_known]
    replaced = (1 - share) * np.mean(rows == 1) / 2
    return Missing(float(share), float(min(share, replaced)))


def _sending_times(pair: SignalPair, fit: Fit, t: Array, y: Array) -> Array:
    """Returns when the command had the values of a response, s.

    Args:
        t: Times of rows, s (K).
        y: The response there (K).

    Returns:
        The times nearest to the rows' times less the dead time; NaN where the command
        moves too slowly to tell (K).
    """
    offset, gain, *_ = pair.combination(fit)
    slope = np.gradient(pair.on_grid, pair.step)
    speed = np.sqrt(np.mean(slope**2))
    # The time in which the command changes by its own size.
    reach = _SEARCH_SHARE * np.std(pair.on_grid) / speed
    guess = t - fit.delay - fit.drift * (t - pair.middle)
    sent = guess
    for _ in range(_NUM_STEPS):
        error = pair.read(pair.on_grid, sent) - (y - offset) / gain
        rate = pair.read(slope, sent)
        step = error / np.where(np.abs(rate) > 0, rate, np.inf)
        sent = np.clip(sent - step, guess - reach, guess + reach)
    is_slow = np.abs(rate) < _SLOW * speed
    is_open = np.abs(step) > 1e-3 * pair.step
    return np.where(is_slow | is_open, np.nan, sent)

"""Stability margins of a loop that contains delays.

The loop is cut open between y and u. The open loop is a linear system with delays:

    [y, e] = G(s) [u, d],    d_i(t) = e_i(t - T_i)

With the response L(s) from u to y, the loop that is closed by u(t) = -k y(t - T) has
the characteristic equation det(I + k L(s) e^(-s T)) = 0. The actual loop has k = 1 and
T = 0. Its stability is found by collocation (characteristic_roots). If it is stable, a
root reaches the imaginary axis first

* as T grows from 0: where an eigenvalue l(j w) of L(j w) has the magnitude 1, see
  crossings;
* as k moves away from 1: where an eigenvalue is real and negative, and k = -1/l.

If it is unstable, the same crossings bound all intervals of T or of k in which it is
stable. Between two of them the number of unstable roots is constant.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from teleop_drake.loops.framework.arrays import (
    Array,
    ComplexArray,
    Flags,
    Indices,
    Interval,
)
from teleop_drake.loops.numerics.characteristic_roots import characteristic_roots
from teleop_drake.loops.numerics.crossings import (
    AXIS_TOLERANCE,
    Crossing,
    LoopLoci,
    crossings_between,
    eigenloci,
    locate,
    sweep_frequencies,
)
from teleop_drake.loops.numerics.margins import LARGEST_GAIN, Margins
from teleop_drake.loops.numerics.state_space import StateSpace, minimal_realization

# A root slower than this, relative to the norm of A, counts as at 0.
_NEUTRAL = 1e-6

# The coupling below which a mode counts as hidden; see minimal_realization(). It is
# above the rounding errors of exact slopes.
_HIDDEN = 1e-11

# The number of points of the circle about 0 on which a residue is computed, and its
# radius as a share of the slowest mode.
_NUM_CIRCLE_POINTS = 32
_CIRCLE_SHARE = 0.1

# The number of phases of a delay that are tried, and how often each delay is turned.
_NUM_PHASES = 64
_NUM_TURNS = 4

# The number of points of the sweep per turn of the phase by all delays, and its limit.
_POINTS_PER_TURN = 12
_MAX_POINTS = 100_000

# The sweep ends where the gain around every loop is less than this.
_LEAST_GAIN = 1e-2

# The relative imaginary part below which an eigenvalue counts as real.
_REAL = 1e-6

# That part at a frequency far below all modes. Also the largest relative change of an
# eigenvalue from one such frequency to another if its limit at 0 is finite.
_NEARLY = 1e-3

# The smallest and the largest number of rightmost roots among which the unstable ones
# are counted, and the largest number of crossings that are counted as the delay grows.
_FEWEST_ROOTS = 16
_MOST_ROOTS = 256
_MOST_CHANGES = 1000


def margins_of(loop: StateSpace, *, remedies: bool = True) -> Margins:
    """Returns the stability margins of a loop at a cut.

    Args:
        loop: L, from u to y of the same size, with its inner delays T_i > 0.
        remedies: Whether to search for what stabilises an unstable loop.
    """
    loop, hidden = without_hidden_modes(loop)
    closed = changed(loop)
    slow = slowest_resolved(closed)
    at_once = gain_at_once(loop.D, (-1.0,) * loop.num_open[0] + loop.delays)
    # The rightmost roots decide the stability.
    roots = np.append(hidden, characteristic_roots(closed))
    is_stable = not np.any(roots.real > slow)
    is_stable &= gain_at_once(closed.D, closed.delays) < 1
    # No change at the cut stabilises a hidden mode.
    if not is_stable and (not remedies or np.any(hidden.real > slow)):
        return Margins(is_stable=False, gain_at_once=at_once)
    grid = loop_frequencies(loop)
    crossings = crossings_between(loop, grid)
    if not is_stable:
        delays = _stable_delays(loop, crossings, slow) if at_once < 1 else []
        return Margins(
            is_stable=False,
            stable_gains=tuple(stable_gains(loop, grid, slow)),
            stable_delays=tuple(delays),
            gain_at_once=at_once,
        )
    bounds = [crossing for crossing in crossings if crossing.direction > 0]
    bounds.append(_at_zero_frequency(loop, np.abs(roots), slow))
    first = min(bounds, key=lambda crossing: crossing.delay)
    lags = [(crossing.phase_margin, crossing.frequency) for crossing in crossings]
    phases = [(min(lag, 2 * math.pi - lag), w) for lag, w in lags]
    phase, phase_frequency = min(phases, default=(math.inf, 0.0))
    below, above = _gains_between(loop, grid)
    return Margins(
        is_stable=True,
        delay=first.delay,
        frequency=first.frequency,
        phase=phase,
        phase_frequency=phase_frequency,
        gain=(below[0], above[0]),
        gain_frequencies=(below[1], above[1]),
        gain_at_once=at_once,
    )


def changed(loop: StateSpace, *, gain: float = 1.0, delay: float = 0.0) -> StateSpace:
    """Returns the loop that u(t) = -k y(t - T) closes.

    Args:
        loop: L.
        gain: k.
        delay: T in s, >= 0.
    """
    m = loop.num_open[0]
    matrix = loop.matrix.copy()
    matrix[:, loop.num_states :][:, :m] *= -gain
    result = replace(loop, matrix=matrix)
    if delay == 0:
        return result.closed(np.arange(m))
    return replace(result, delays=(delay,) * m + loop.delays)


def _is_stable(closed: StateSpace, slow: float) -> bool:
    """Returns whether a closed loop has no root right of the imaginary axis.

    Args:
        closed: The loop, all of whose signals are delayed.
        slow: The magnitude in 1/s up to which a root counts as at 0.
    """
    if gain_at_once(closed.D, closed.delays) >= 1:
        return False
    return not np.any(_is_right(characteristic_roots(closed), slow))


def _is_right(roots: ComplexArray, slow: float) -> Flags:
    """Returns whether roots are right of the imaginary axis, and not at 0."""
    return (roots.real > _NEUTRAL * np.abs(roots)) & (np.abs(roots) > slow)


def stable_gains(loop: StateSpace, grid: Array, slow: float) -> list[Interval]:
    """Returns the intervals of k in which the loop is stable; see Margins.

    Args:
        loop: L.
        grid: As for _gains_between().
        slow: See _is_stable().
    """
    values, falls, _ = _real_loci(loop, grid)
    positive = _stable_sizes(loop, 1 / values, falls, slow)
    if positive:
        return positive
    negative = _stable_sizes(-loop, -1 / values, -falls, slow)
    return [(-high, -low) for low, high in negative]


def _stable_sizes(
    loop: StateSpace, gains: Array, changes: Array, slow: float
) -> list[Interval]:
    """Returns the intervals of k > 0 in which the loop is stable.

    Args:
        loop: L.
        gains: All gains at which a root is on the axis (K).
        changes: 1 where a pair of roots then moves to the right as k grows, -1 where
            it moves to the left, 0 where a real root is at 0 (K).
        slow: See _is_stable().
    """
    inside = (gains > 1 / LARGEST_GAIN) & (gains < LARGEST_GAIN)
    order = np.argsort(gains[inside])
    ends = [0.0, *gains[inside][order].tolist(), math.inf]
    # The number of unstable roots in an interval is at least that at k = 1, changed by
    # the pairs in between, less a root for each that passes 0.
    pairs = np.append(0, np.cumsum(2 * changes[inside][order]))
    singles = np.append(0, np.cumsum(changes[inside][order] == 0))
    here = int(np.searchsorted(ends, 1.0)) - 1
    closed = changed(loop)
    least = pairs - pairs[here] - np.abs(singles - singles[here])
    if gain_at_once(closed.D, closed.delays) < 1:
        least = least + _num_unstable(closed, slow)
    else:
        # There are infinitely many unstable roots at k = 1.
        least = np.zeros(len(pairs))
    found = []
    for k in np.flatnonzero(least <= 0).tolist():
        low, high = ends[k : k + 2]
        middle = math.sqrt(max(low, 1 / LARGEST_GAIN) * min(high, LARGEST_GAIN))
        if _is_stable(changed(loop, gain=middle), slow):
            found.append((low, high))
    return found


def _stable_delays(
    loop: StateSpace, crossings: list[Crossing], slow: float
) -> list[Interval]:
    """Returns the intervals of T > 0 in which an unstable loop is stable.

    Not found are those that begin where a real root passes through a neutral one.

    Args:
        loop: L, with gain_at_once() < 1.
        crossings: All crossings of the unit circle.
        slow: See _is_stable().
    """
    rates = [x.frequency / (2 * math.pi) for x in crossings]
    growth = sum(x.direction * r for x, r in zip(crossings, rates, strict=True))
    if all(x.direction > 0 for x in crossings):
        return []
    # In the mean the number of unstable roots grows by twice `growth` in a second, and
    # differs from that by at most two for each crossing.
    longest = _MOST_CHANGES / sum(rates)
    if growth > 0:
        longest = min(longest, len(crossings) / growth)
    delays, counts = count_roots(_num_unstable(changed(loop), slow), longest, crossings)
    found = intervals_without_roots(delays, counts, longest)
    return [
        window
        for window in found
        if _is_stable(changed(loop, delay=sum(window) / 2), slow)
    ]


def count_roots(
    count: int, max_delay: float, crossings: list[Crossing]
) -> tuple[Array, Indices]:
    """Returns the number of unstable roots as a function of the delay.

    Args:
        count: The number without delay, not counting roots on the axis.
        max_delay: The largest delay in s.
        crossings: The crossings to be counted.

    Returns:
        Delays (K) in s, ascending from 0, and the number of unstable roots from each
        delay to the next one (K); the last number holds up to max_delay.
    """
    changes: list[tuple[float, int]] = []
    for crossing in crossings:
        # A real root passes once, a pair at every delay of crossings (2).
        is_pair = crossing.frequency > 0
        period = 2 * math.pi / crossing.frequency if is_pair else math.inf
        change = 2 * crossing.direction if is_pair else crossing.direction
        delay = crossing.delay
        if delay <= (AXIS_TOLERANCE * period if is_pair else 0.0):
            # The roots are on the axis at T = 0, and not counted as unstable there. The
            # next crossing follows a period later.
            count += max(change, 0)
            delay += period
        while delay < max_delay:
            changes.append((delay, change))
            delay += period
    changes.sort()
    delays = [0.0, *(delay for delay, _ in changes)]
    return np.array(delays), np.cumsum([count, *(change for _, change in changes)])


def intervals_without_roots(
    delays: Array, counts: Indices, max_delay: float
) -> list[Interval]:
    """Returns the intervals of delays in s in which no root is unstable.

    Args:
        delays: See count_roots().
        counts: See count_roots().
        max_delay: The end of the last interval in s.
    """
    ends = np.append(delays[1:], max_delay)
    lasts = ends > delays
    is_stable = counts[lasts] == 0
    # The indices at which intervals of stability begin and end, alternately.
    changes = np.flatnonzero(np.diff(is_stable, prepend=False, append=False))
    begins = delays[lasts][changes[::2]]
    finishes = ends[lasts][changes[1::2] - 1]
    return list(zip(begins.tolist(), finishes.tolist(), strict=True))


def _num_unstable(closed: StateSpace, slow: float) -> int:
    """Returns the number of roots right of the imaginary axis.

    Of infinitely many it returns some.

    Args:
        closed: See _is_stable().
        slow: See _is_stable().
    """
    count = _FEWEST_ROOTS
    while True:
        roots = characteristic_roots(closed, count=count)
        number = int(np.sum(_is_right(roots, slow)))
        if number < count or count > _MOST_ROOTS:
            return number
        count *= 2


def slowest_resolved(closed: StateSpace) -> float:
    """Returns the magnitude in 1/s up to which a root counts as at 0."""
    return _NEUTRAL * float(np.linalg.norm(closed.A))


def without_hidden_modes(system: StateSpace) -> tuple[StateSpace, ComplexArray]:
    """Returns a system without the modes that act on no signal, and these modes.

    Many states of a law may obey the same equation; the loop needs one of them.
    """
    minimal, hidden = minimal_realization(system.opened, _HIDDEN)
    return replace(minimal, delays=system.delays), hidden


def _at_zero_frequency(loop: StateSpace, sizes: Array, slow: float) -> Crossing:
    """Returns the crossing at which additional delay first destabilises at w = 0.

    Its delay is 0 if loops without dynamics then amplify, which makes infinitely many
    roots unstable at once, or that at which a real root passes through 0, or infinity.

    Args:
        loop: L.
        sizes: The magnitudes of the rightmost roots of the closed loop.
        slow: See slowest_resolved().
    """
    delay = math.inf
    m = loop.num_open[0]
    if gain_at_once(loop.D, (-1.0,) * m + loop.delays) >= 1:
        delay = 0.0
    elif np.any(sizes <= slow):
        slowest = float(sizes[sizes > slow].min(initial=1.0))

        def sensitivity(s: ComplexArray) -> ComplexArray:
            L = loop.response_at(s)
            return np.linalg.solve(np.eye(m) + L, -L).astype(complex)

        delay = delay_through_zero(sensitivity, slowest)
    return Crossing(frequency=0.0, delay=delay, direction=1)


def delay_through_zero(
    sensitivity: Callable[[ComplexArray], ComplexArray], slowest: float
) -> float:
    """Returns the additional delay in s at which a real root passes through 0.

    The loop has a neutral root, which stays at 0. With the sensitivity S at the cut,
    S = R/s + ... near 0, the other roots are those of

        det(I + S(s) (1 - e^(-s T))),    which is det(I + T R) at s = 0.

    The result is infinity if no root passes.

    Args:
        sensitivity: Returns S(s) (K, m, m) at points (K).
        slowest: The magnitude in 1/s of the slowest root that is not at 0.
    """
    # R by Cauchy's integral formula on a circle about 0.
    turns = (np.arange(_NUM_CIRCLE_POINTS) + 0.5) / _NUM_CIRCLE_POINTS
    s = _CIRCLE_SHARE * slowest * np.exp(2j * np.pi * turns)
    S = sensitivity(s)
    R = (S * s[:, np.newaxis, np.newaxis]).mean(axis=0)
    double = (S * s[:, np.newaxis, np.newaxis] ** 2).mean(axis=0)
    if np.abs(double).max() > _NEARLY * np.abs(s[0]) * np.abs(R).max():
        return math.inf
    gains = np.linalg.eigvals(R)
    size = np.abs(S * s[:, np.newaxis, np.newaxis]).max()
    passing = gains[(np.abs(gains.imag) <= _REAL * size) & (gains.real < -_REAL * size)]
    return float((-1 / passing.real).min(initial=math.inf))


def gain_at_once(direct: Array, times: Sequence[float]) -> float:
    """Returns the largest gain around loops of delays without dynamics between them.

    It is the largest spectral radius of D diag(e^(-j a)) for all phases a that are
    equal for signals of equal delay, or an upper bound of it below 1. If it is 1 or
    more, infinitely many roots are near or right of the imaginary axis, at these delays
    or at ones that hardly differ from them.

    Source: J. K. Hale and S. M. Verduyn Lunel, "Strong stabilization of neutral
    functional differential equations", IMA J. Math. Control Inf. 19 (2002).

    Args:
        direct: D from the outputs of the delays to their inputs (k, k).
        times: The delays, or other numbers that tell them apart (k).
    """
    bound = np.abs(np.linalg.eigvals(np.abs(direct))).max(initial=0.0)
    if bound < 1:
        return float(bound)
    distinct = sorted(set(times))
    place = np.array([distinct.index(time) for time in times])
    angles = 2 * np.pi * np.arange(_NUM_PHASES) / _NUM_PHASES
    largest = 0.0
    phases = np.zeros(len(distinct))
    # One phase after another is turned to where the radius is largest. The first one
    # stays, because a phase of all signals has no effect on the radius.
    for _ in range(_NUM_TURNS):
        for i in range(min(1, len(distinct) - 1), len(distinct)):
            tried = np.tile(phases, (_NUM_PHASES, 1))
            tried[:, i] += angles
            turned = direct * np.exp(-1j * tried[:, place])[:, np.newaxis]
            radii = np.abs(np.linalg.eigvals(turned)).max(axis=1)
            phases = tried[radii.argmax()]
            largest = max(largest, float(radii.max()))
    return largest


def loop_frequencies(loop: StateSpace) -> Array:
    """Returns ascending frequencies in rad/s that resolve the features of L(j w)."""
    # With the cut open, the delayed signals still form loops, whose modes are peaks.
    rest = np.arange(loop.num_open[0], len(loop.D))
    inner = loop.part(np.arange(loop.num_states), rest, rest)
    modes = characteristic_roots(replace(inner, delays=loop.delays))
    grid = sweep_frequencies(loop, modes)
    sizes = np.abs(loop.opened.finite_response(grid))
    # An upper bound of the gain around any loop of the signals, for all delays.
    largest = np.abs(np.linalg.eigvals(sizes)).max(axis=1, initial=0.0)
    is_heard = largest > _LEAST_GAIN
    grid = grid[: np.flatnonzero(is_heard).max(initial=0) + 2]
    turns = grid[-1] * sum(loop.delays) / (2 * math.pi)
    num_points = min(math.ceil(_POINTS_PER_TURN * turns), _MAX_POINTS)
    even = np.linspace(grid[0], grid[-1], num_points)
    return np.array(sorted({*grid, *even}))


def _gains_between(loop: StateSpace, grid: Array) -> tuple[Interval, Interval]:
    """Returns the gains next to 1, below and above, at which a root is on the axis.

    Each has the frequency of the root in rad/s. Without such a gain it is 0 or
    infinity.

    Args:
        loop: L.
        grid: Ascending frequencies in rad/s, from far below the slowest mode.
    """
    values, _, frequencies = _real_loci(loop, grid)
    is_positive = values > 0
    gains = (1 / values[is_positive]).tolist()
    roots = list(zip(gains, frequencies[is_positive].tolist(), strict=True))
    below = max((root for root in roots if root[0] < 1), default=(0.0, 0.0))
    above = min((root for root in roots if root[0] > 1), default=(math.inf, 0.0))
    return below, above


def _real_loci(loop: StateSpace, grid: Array) -> tuple[Array, Array, Array]:
    """Returns the real values 1/k of the loci at all gains k with a root on the axis.

    Args:
        loop: L.
        grid: As for _gains_between().

    Returns:
        1/k (K); 1 where a pair of roots then moves to the right as k grows, -1 where it
        moves to the left, 0 where a real root is at 0 (K); and the frequency of the
        roots in rad/s (K).
    """
    # The signal that comes back; its real eigenvalues p belong to k = 1/p.
    system = -loop
    # At the frequency 0 a locus ends on the real axis or at infinity. Finite ends other
    # than 0 belong to roots at 0.
    at_zero, slow = eigenloci(system, grid[0] * np.array([0.1, 1.0]))
    is_real = np.abs(at_zero.imag) < _NEARLY * np.abs(at_zero.real)
    is_finite = np.abs(at_zero - slow) < _NEARLY * np.abs(slow)
    values = at_zero[is_real & is_finite].real
    # A neutral root of the actual loop makes an end at 1, which is not counted.
    values = values[np.abs(values - 1) > _REAL]
    loci = eigenloci(system, grid)
    # Smaller real parts are rounding errors of 0.
    side = np.sign(loci.real) * (np.abs(loci.real) > _REAL * np.abs(loci[:, :1]))
    is_clear = (side[:-1] == side[1:]) & (side[1:] != 0)
    k, columns = np.nonzero(np.diff(np.signbit(loci.imag), axis=0) & is_clear)
    back = LoopLoci(system)
    w, found = locate(back, columns, lambda p: p.imag, grid[k], grid[k + 1])
    # The sign of the imaginary part also changes where two complex eigenvalues of equal
    # magnitude change places in the order. These are left out.
    is_real = (np.abs(found.imag) < _REAL * np.abs(found)) & (found.real != 0)
    # From k p(s) = 1 follows sign Re ds/dk = -sign d(Im p)/dw.
    changes = np.where(loci.imag[k, columns] > 0, 1, -1)[is_real]
    still = np.zeros(len(values))
    return (
        np.append(values, found[is_real].real),
        np.append(still, changes),
        np.append(still, w[is_real]),
    )

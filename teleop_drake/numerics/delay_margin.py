"""Stability of a feedback loop against its delay, by sweeping the frequency.

The loop is cut at the delay. What remains is a linear system L, and the closed loop
has the characteristic equation

    det(I + L(s) e^(-s T)) = 0.                                                  (1)

The delay is exact, not a Pade approximation. A root can change sides only over the
imaginary axis, at s = j w, where |e^(-j w T)| = 1: so an eigenvalue l(j w) of
L(j w) (an eigenlocus) has |l| = 1 there, whatever the delay. These w are few. Each
belongs to the delays

    T_k = (arg l - pi + 2 pi k)/w,   k = 0, 1, ...                               (2)

and at all of them the root crosses in the same direction: differentiating (1) gives
sign Re ds/dT = -sign d|l|/dw. Where |l| falls through 1 a pair becomes unstable,
where it rises a pair returns. With the number of unstable roots at T = 0, from an
eigenvalue problem, the number at every T follows by counting: windows of stability
may close and open again.

Sources: K. L. Cooke and Z. Grossman, "Discrete delay, distributed delay and stability
switches", J. Math. Anal. Appl. 86 (1982); K. Walton and J. E. Marshall, "Direct method
for TDS stability analysis", IEE Proc. D 134 (1987); J. Chen, G. Gu and C. N. Nett,
"A new method for computing delay margins for stability of linear delay systems",
Syst. Control Lett. 26 (1995); K. Gu, V. L. Kharitonov and J. Chen, "Stability of
Time-Delay Systems", Birkhauser (2003).

What does not show in L (see minimal_realization) is none of this file's business.

Neutral roots. At s = 0 the delay has no effect, so a root at 0 is one for every delay:
a set of equilibria, such as all the places at which a tool can rest. The loop neither
leaves nor returns to one of them. They are counted by neutral_root_count and by nothing
else here. Another, real root can pass through 0 then, though: with k neutral roots, (1)
as a polynomial times s^k g(s, T), it does where g(0, T), a polynomial in T, is zero.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.arrays import Array, ComplexArray, Indices
from teleop_drake.numerics.state_space import StateSpace
from teleop_drake.validation import Refuse

# Relative accuracy of what counts as on the imaginary axis.
_AXIS_TOLERANCE = 1e-8

# A mode this slow, relative to the norm of A, is at 0: several there, as one Jordan
# block, are found no more accurately.
_SLOW = 1e-6

# A magnitude this close to 1 may be so by rounding.
_MAGNITUDE_TOLERANCE = 1e-10

# Points of the circle about 0 on which derivatives at s = 0 are taken, its radius as a
# share of the slowest mode that is not neutral, and the largest radius times delay.
_NUM_CIRCLE_POINTS = 64
_CIRCLE_SHARE = 0.1
_LARGEST_TURN = 10.0

# A coefficient of g(0, T) smaller than this, relative to the largest, is 0, and so is
# the imaginary part of one of its roots smaller than this, relative to the root.
_NEGLIGIBLE_COEFFICIENT = 1e-9
_NEGLIGIBLE_IMAGINARY = 1e-6

# Points of the first sweep, and around each pole.
_NUM_SWEEP_POINTS = 2000
_NUM_POLE_POINTS = 80

# Points of each finer sweep around one of them, and how many sweeps find an extremum.
_NUM_INNER_POINTS = 17
_NUM_EXTREMUM_SWEEPS = 12

# An extremum of log |l| farther than this from 0 is no crossing in disguise.
_NEAR_CROSSING = 0.5


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """A frequency at which roots cross the imaginary axis.

    Attributes:
        frequency: w >= 0 in rad/s, a gain crossover of an eigenlocus. 0: a real root
            passes the neutral ones.
        delay: The smallest delay >= 0 at which they do, in s; the others follow in
            steps of 2 pi/w, if w > 0.
        direction: +1: to the right, towards instability; -1: to the left.
    """

    frequency: float
    delay: float
    direction: int

    @property
    def phase_margin(self) -> float:
        """Phase in rad, 0 to 2 pi, that the delay takes until the roots cross."""
        return self.frequency * self.delay


class Response(Protocol):
    """What has a frequency response: a StateSpace, also with delays in it."""

    def frequency_response(self, frequencies: Array) -> ComplexArray:
        """Returns L(j w) (K, m, m)."""


def eigenloci(loop: Response, frequencies: Array) -> ComplexArray:
    """Returns the eigenvalues of L(j w) by descending magnitude (K, m).

    Args:
        loop: L, with as many inputs as outputs (m).
        frequencies: w in rad/s (K).
    """
    response = loop.frequency_response(frequencies)
    values = np.linalg.eigvals(response).astype(complex)
    order = np.argsort(-np.abs(values), axis=1, kind="stable")
    return np.take_along_axis(values, order, axis=1)


def closed_loop_matrix(loop: StateSpace) -> Array:
    """Returns A of the closed loop without delay: A - B (I + D)^-1 C.

    Raises:
        ValueError: If I + D is singular: the loop is not well posed without delay.
    """
    feedthrough = np.eye(len(loop.D)) + loop.D
    if len(loop.D) and np.linalg.cond(feedthrough) > 1e12:
        Refuse("loop.D", loop.D, "such that I + D is not singular")
    return loop.A - loop.B @ np.linalg.solve(feedthrough, loop.C)


def sweep_frequencies(loop: StateSpace, more_poles: ArrayLike = ()) -> Array:
    """Returns ascending frequencies in rad/s on which L(j w) shows all it does.

    They lie logarithmically, and close together around each pole near the axis, from
    far below the slowest mode to where |L(j w)| has come within reach of D.

    Args:
        more_poles: Others near which the frequencies are to lie close together.
    """
    poles = np.concatenate([np.linalg.eigvals(loop.A), np.asarray(more_poles)])
    closed_loop_modes = np.linalg.eigvals(closed_loop_matrix(loop))
    modes = np.abs(np.concatenate([poles, closed_loop_modes]))
    high = _highest_frequency(loop)
    slow_modes = modes[modes > 1e-9 * high]
    slowest = min(float(slow_modes.min(initial=high)), high)
    low = 1e-4 * slowest
    frequencies = [np.geomspace(low, high, _NUM_SWEEP_POINTS)]
    for pole in poles[poles.imag > low]:
        # The peak of a pole is as wide as the pole is far from the axis.
        width = max(abs(pole.real), 1e-9 * abs(pole))
        offsets = np.geomspace(width / 8, abs(pole), _NUM_POLE_POINTS)
        frequencies.append(pole.imag + offsets)
        frequencies.append(pole.imag - offsets)
    # np.unique() imports all of numpy.ma.
    result = np.sort(np.concatenate(frequencies))
    is_new = np.diff(result, prepend=-np.inf) > 0
    is_inside = (result >= low) & (result <= high)
    return result[is_new & is_inside]


def _highest_frequency(loop: StateSpace) -> float:
    """Returns the frequency in rad/s from which on |L(j w)| < 1, if |D| < 1.

    It follows from |C (j w - A)^-1 B| <= |B| |C|/(w - |A|).
    """
    gain = float(np.linalg.norm(loop.B) * np.linalg.norm(loop.C))
    feedthrough = float(np.linalg.norm(loop.D, 2)) if loop.D.size else 0.0
    left_over = max(1 - feedthrough, 0.01)
    return 1.01 * (float(np.linalg.norm(loop.A)) + gain / left_over + 1e-3)


def find_crossings(loop: StateSpace) -> list[Crossing]:
    """Returns all frequencies at which roots of (1) cross, ascending.

    Where |l| only touches 1, no root changes sides and none is reported.
    """
    if loop.num_states == 0 or len(loop.D) == 0:
        return []
    crossings = _passages_of_the_origin(loop)
    crossings += crossings_between(loop, sweep_frequencies(loop))
    return sorted(crossings, key=lambda crossing: crossing.frequency)


def crossings_between(loop: Response, grid: Array) -> list[Crossing]:
    """Returns where the eigenloci of a response cross the unit circle.

    Args:
        grid: Ascending frequencies in rad/s, dense enough for all that it does.
    """
    gains = _gains(loop, grid)
    return [
        crossing
        for locus in range(gains.shape[1])
        for crossing in _crossings_of_locus(loop, grid, gains[:, locus], locus)
    ]


def _crossings_of_locus(
    loop: Response, grid: Array, gains: Array, locus: int
) -> list[Crossing]:
    """Returns where an eigenlocus crosses the unit circle.

    Args:
        grid: Frequencies in rad/s (K).
        gains: log |l| of the eigenlocus there (K).
        locus: Its number among the eigenloci.
    """
    w, g = _add_extrema(loop, grid, gains, locus)
    # A neutral root is where |l| tends to 1 for w to 0: no crossing.
    is_sure = np.abs(g) > _MAGNITUDE_TOLERANCE
    w = w[is_sure]
    is_above = g[is_sure] > 0
    crossings = []
    for k in np.flatnonzero(is_above[:-1] != is_above[1:]):
        starts_above = bool(is_above[k])
        frequency = _find_crossing(loop, locus, w[k], w[k + 1], starts_above)
        crossing = Crossing(
            frequency=frequency,
            delay=_phase_to_cross(loop, locus, frequency) / frequency,
            direction=1 if starts_above else -1,
        )
        crossings.append(crossing)
    return crossings


def _find_crossing(
    loop: Response, locus: int, low: float, high: float, starts_above: bool
) -> float:
    """Returns where |l| passes 1 between two frequencies, in rad/s, to the last digit.

    Args:
        starts_above: Whether |l| > 1 at the lower frequency; at the higher one it is on
            the other side.
    """
    while low < np.nextafter(high, 0):
        w = np.linspace(low, high, _NUM_INNER_POINTS)
        is_above = _gains(loop, w)[:, locus] > 0
        # Rounding must not move the ends to the other side.
        is_above[0] = starts_above
        is_above[-1] = not starts_above
        first_changed = int(np.argmax(is_above != starts_above))
        low = w[first_changed - 1]
        high = w[first_changed]
    return float(high)


def _phase_to_cross(loop: Response, locus: int, frequency: float) -> float:
    """Returns the phase in rad, 0 to 2 pi, by which a delay turns l(j w) to -1."""
    value = complex(eigenloci(loop, np.array([frequency]))[0, locus])
    phase = float(np.angle(value) + np.pi) % (2 * np.pi)
    # Rounding must not make a whole turn of none.
    is_whole_turn = phase > 2 * np.pi * (1 - _AXIS_TOLERANCE)
    return 0.0 if is_whole_turn else phase


def neutral_root_count(loop: StateSpace) -> int:
    """Returns the number of roots at s = 0, the same for every delay."""
    if loop.num_states == 0:
        return 0
    sizes = np.linalg.svd(closed_loop_matrix(loop), compute_uv=False)
    return int(np.sum(sizes <= _AXIS_TOLERANCE * np.linalg.norm(loop.A)))


def is_delay_robust(loop: StateSpace) -> bool:
    """Returns whether an arbitrarily small delay leaves all roots where they were.

    That is so if the spectral radius of D is less than 1; without direct feedthrough
    it is 0. With more, infinitely many roots lie right of the axis, or tend to it, for
    every delay > 0.

    Source: D. Henry, "Linear autonomous neutral functional differential equations",
    J. Differ. Equ. 15 (1974).
    """
    if not loop.D.size:
        return True
    return bool(np.max(np.abs(np.linalg.eigvals(loop.D))) < 1 - _AXIS_TOLERANCE)


def unstable_roots(
    loop: StateSpace,
    max_delay: float,
    crossings: list[Crossing],
    slow: float = 0.0,
) -> tuple[Array, Indices]:
    """Returns how many roots of (1) are unstable, as a function of the delay.

    Args:
        loop: L, minimal, such that is_delay_robust(loop).
        max_delay: Up to which delay in s.
        crossings: Those of find_crossings(loop) that count.
        slow: Below which size in 1/s a root is not told from one at 0.

    Returns:
        Delays (K) in s, ascending from 0, and the number of unstable roots from each to
        the next, the last one to max_delay (K).
    """
    count = _unstable_without_delay(loop, slow)
    changes: list[tuple[float, int]] = []
    for crossing in crossings:
        if crossing.frequency == 0:
            # A real root passes, once.
            if crossing.delay <= 0:
                count += crossing.direction > 0
            elif crossing.delay < max_delay:
                changes.append((crossing.delay, crossing.direction))
            continue
        # A pair passes, at every delay that turns the phase as far.
        period = 2 * math.pi / crossing.frequency
        delay = crossing.delay
        if delay < _AXIS_TOLERANCE * period:
            # The pair is on the axis without delay.
            count += 2 * (crossing.direction > 0)
            delay += period
        while delay < max_delay:
            changes.append((delay, 2 * crossing.direction))
            delay += period
    delays = [0.0]
    counts = [count]
    for delay, change in sorted(changes):
        delays.append(delay)
        counts.append(counts[-1] + change)
    return np.array(delays), np.array(counts)


def _unstable_without_delay(loop: StateSpace, slow: float) -> int:
    """Returns how many roots of the loop without delay are right of the axis.

    Roots on the axis do not count, and those at 0 are on it.

    Args:
        slow: Below which size in 1/s a root is not told from one at 0.
    """
    size = float(np.linalg.norm(loop.A))
    roots = np.linalg.eigvals(closed_loop_matrix(loop))
    roots = roots[np.abs(roots) > max(slow, _SLOW * size)]
    scale = np.maximum(np.abs(roots), 1e-3 * size)
    return int(np.sum(roots.real > _AXIS_TOLERANCE * scale))


def stable_delays(
    loop: StateSpace,
    max_delay: float,
    crossings: list[Crossing],
    slow: float = 0.0,
) -> list[tuple[float, float]]:
    """Returns every interval of delays in which the loop is stable.

    Neutral roots apart, all roots lie left of the imaginary axis there.

    Args:
        max_delay: Up to which delay in s; an interval that ends there goes on.
        crossings: Those of find_crossings(loop) that count.
        slow: Below which size in 1/s a root is not told from one at 0.
    """
    if not is_delay_robust(loop):
        return []
    delays, counts = unstable_roots(loop, max_delay, crossings, slow)
    ends = [*delays[1:], max_delay]
    intervals: list[tuple[float, float]] = []
    for begin, end, count in zip(delays, ends, counts, strict=True):
        if count != 0 or end <= begin:
            continue
        if intervals and intervals[-1][1] == begin:
            begin = intervals.pop()[0]
        intervals.append((float(begin), float(end)))
    return intervals


def delay_margin(
    loop: StateSpace, crossings: list[Crossing], slow: float = 0.0
) -> Crossing | None:
    """Returns the crossing at which growing delay first makes the loop unstable.

    Its `delay` is the delay margin, its `phase_margin` the phase margin. None if the
    loop is not stable without delay, or with every delay.

    Args:
        crossings: Those of find_crossings(loop) that count.
        slow: Below which size in 1/s a root is not told from one at 0.
    """
    outward = [crossing for crossing in crossings if crossing.direction > 0]
    if not outward:
        return None
    first = min(outward, key=lambda crossing: crossing.delay)
    intervals = stable_delays(loop, first.delay, crossings, slow)
    return first if intervals == [(0.0, first.delay)] else None


def _passages_of_the_origin(loop: StateSpace) -> list[Crossing]:
    """Returns the delays >= 0 at which a real root passes through neutral ones."""
    order = neutral_root_count(loop)
    if order == 0:
        return []
    g = _ReducedDeterminant(loop, order)
    polynomial = g.at_zero()
    slope_by_delay = np.polyder(polynomial)
    passages = []
    num_without_delay = 0
    for root in np.roots(polynomial):
        is_real = abs(root.imag) <= _NEGLIGIBLE_IMAGINARY * abs(root)
        if not is_real or root.real < 0:
            continue
        if root.real < _AXIS_TOLERANCE:
            num_without_delay += 1
            continue
        delay = g.unit * float(root.real)
        # Near 0, g = g_s s + g_T (T - delay): the root moves at -g_T/g_s.
        g_T = float(np.polyval(slope_by_delay, root.real))
        g_s = g.taylor(delay, num_terms=2)[1]
        direction = -1 if g_T * g_s > 0 else 1
        passages.append(Crossing(frequency=0.0, delay=delay, direction=direction))
    if num_without_delay:
        # These roots leave 0 as the delay does. A small delay shows their side.
        small = 0.01 * g.unit
        ascending = g.taylor(small, num_terms=num_without_delay + 1)
        for s in np.roots(ascending[::-1]):
            direction = 1 if s.real > 0 else -1
            passages.append(Crossing(frequency=0.0, delay=0.0, direction=direction))
    return passages


class _ReducedDeterminant:
    """The function g(s, T) = det(s, T)/s^k of a loop with k neutral roots.

    With z = e^(-s T), det(s, T) is that of

        [s I - A    -B z  ]
        [   C     I + D z ]

    and so (1) as a polynomial in s and z.

    Attributes:
        unit: A delay in s, that of the slowest mode that is not neutral.

    Args:
        loop: L, with k >= 1 neutral roots.
        order: k.
    """

    def __init__(self, loop: StateSpace, order: int):
        self._loop = loop
        self._order = order
        modes = np.abs(np.linalg.eigvals(closed_loop_matrix(loop)))
        modes = modes[modes > _SLOW * np.linalg.norm(loop.A)]
        self._radius = _CIRCLE_SHARE * float(modes.min(initial=1.0))
        self.unit = 1 / max(self._radius, 1e-6)

    def taylor(self, delay: float, *, num_terms: int) -> Array:
        """Returns the first coefficients of g by ascending powers of s.

        By Cauchy's integral formula, on a circle about 0.

        Args:
            delay: T in s.
        """
        turns = np.arange(_NUM_CIRCLE_POINTS) / _NUM_CIRCLE_POINTS
        radius = min(self._radius, _LARGEST_TURN / max(delay, 1e-9))
        s = radius * np.exp(2j * np.pi * turns)
        g = np.linalg.det(self._matrix(s, delay)) / s**self._order
        return np.array([np.mean(g / s**k).real for k in range(num_terms)])

    def at_zero(self) -> Array:
        """Returns g(0, T) as a polynomial in T/unit, highest power first (k + 1).

        A polynomial of degree k goes through its values at k + 1 delays.
        """
        nodes = np.arange(self._order + 1)
        values = [self.taylor(self.unit * x, num_terms=1)[0] for x in nodes]
        polynomial = np.polyfit(nodes, np.array(values), self._order)
        sizes = np.abs(polynomial)
        polynomial[sizes < _NEGLIGIBLE_COEFFICIENT * sizes.max()] = 0.0
        return polynomial

    def _matrix(self, s: ComplexArray, delay: float) -> ComplexArray:
        """Returns the matrix at each s, (K, n + m, n + m)."""
        loop = self._loop
        n = loop.num_states
        m = len(loop.D)
        s_I = s[:, np.newaxis, np.newaxis] * np.eye(n)
        z = np.exp(-s * delay)[:, np.newaxis, np.newaxis]
        matrix = np.zeros((len(s), n + m, n + m), dtype=complex)
        matrix[:, :n, :n] = s_I - loop.A
        matrix[:, :n, n:] = -loop.B * z
        matrix[:, n:, :n] = loop.C
        matrix[:, n:, n:] = np.eye(m) + loop.D * z
        return matrix


def _gains(loop: Response, frequencies: Array) -> Array:
    """Returns log |l| of all eigenloci (K, m)."""
    return np.log(np.maximum(np.abs(eigenloci(loop, frequencies)), 1e-300))


def _add_extrema(loop: Response, w: Array, g: Array, locus: int) -> tuple[Array, Array]:
    """Adds the extrema at which g = log |l| changes sign between two points.

    Args:
        w: Frequencies in rad/s, ascending (K).
        g: log |l| of the eigenlocus there (K).
        locus: Its number among the eigenloci.

    Returns:
        Frequencies, ascending, and log |l| there.
    """
    added_w = []
    added_g = []
    for k in _closest_points(g):
        sign = 1.0 if g[k] > 0 else -1.0
        frequency, value = _least_gain(loop, locus, w[k - 1], w[k + 1], sign)
        if sign * value < 0:
            added_w.append(frequency)
            added_g.append(value)
    all_w = np.concatenate([w, added_w])
    all_g = np.concatenate([g, added_g])
    order = np.argsort(all_w)
    return all_w[order], all_g[order]


def _closest_points(g: Array) -> Indices:
    """Returns the inner points at which g comes closest to 0 without a crossing."""
    before = g[:-2]
    here = g[1:-1]
    after = g[2:]
    size = np.abs(here)
    is_least = (size <= np.abs(before)) & (size <= np.abs(after))
    is_above = here > 0
    is_on_one_side = (is_above == (before > 0)) & (is_above == (after > 0))
    # Where |l| is 1, as next to a neutral root, rounding makes extrema of its own.
    is_sure = size > _MAGNITUDE_TOLERANCE
    is_near = size < _NEAR_CROSSING
    return np.flatnonzero(is_least & is_on_one_side & is_sure & is_near) + 1


def _least_gain(
    loop: Response, locus: int, low: float, high: float, sign: float
) -> tuple[float, float]:
    """Returns where sign * log |l| is least between two frequencies, and log |l|."""
    for _ in range(_NUM_EXTREMUM_SWEEPS):
        w = np.geomspace(low, high, _NUM_INNER_POINTS)
        values = _gains(loop, w)[:, locus]
        # Not one of the ends: the extremum is between its two neighbours.
        least = int(np.clip(np.argmin(sign * values), 1, len(w) - 2))
        low = w[least - 1]
        high = w[least + 1]
    return float(w[least]), float(values[least])

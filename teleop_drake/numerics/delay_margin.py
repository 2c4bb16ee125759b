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

import numpy as np

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

# Points of the circle on which derivatives at s = 0 are taken.
_NUM_CIRCLE_POINTS = 64

# Points of the first sweep, and around each pole.
_NUM_SWEEP_POINTS = 2000
_NUM_POLE_POINTS = 80

# Points of each finer sweep around one of them.
_NUM_INNER_POINTS = 17


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


def eigenloci(loop: StateSpace, frequencies: Array) -> ComplexArray:
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


def sweep_frequencies(loop: StateSpace) -> Array:
    """Returns ascending frequencies in rad/s on which L(j w) shows all it does.

    They lie logarithmically, and close together around each pole near the axis, from
    far below the slowest mode to where |L(j w)| has come within reach of D.
    """
    poles = np.linalg.eigvals(loop.A)
    modes = np.abs(np.concatenate([poles, np.linalg.eigvals(closed_loop_matrix(loop))]))
    gain = float(np.linalg.norm(loop.B) * np.linalg.norm(loop.C))
    feedthrough = float(np.linalg.norm(loop.D, 2)) if loop.D.size else 0.0
    # |C (j w - A)^-1 B| <= gain/(w - |A|): from here on |L| < 1, if |D| < 1.
    high = 1.01 * (
        float(np.linalg.norm(loop.A)) + gain / max(1 - feedthrough, 0.01) + 1e-3
    )
    slow = modes[modes > 1e-9 * high]
    low = 1e-4 * min(float(slow.min(initial=high)), high)
    frequencies = [np.geomspace(low, high, _NUM_SWEEP_POINTS)]
    for pole in poles[poles.imag > low]:
        width = max(abs(pole.real), 1e-9 * abs(pole)) / 8
        offsets = np.geomspace(width, abs(pole), _NUM_POLE_POINTS)
        frequencies += [pole.imag + offsets, pole.imag - offsets]
    # np.unique() imports all of numpy.ma.
    result = np.sort(np.concatenate(frequencies))
    is_new = np.diff(result, prepend=-np.inf) > 0
    return result[is_new & (result >= low) & (result <= high)]


def find_crossings(loop: StateSpace) -> list[Crossing]:
    """Returns all frequencies at which roots of (1) cross, ascending.

    Where |l| only touches 1, no root changes sides and none is reported.
    """
    if loop.num_states == 0 or len(loop.D) == 0:
        return []
    crossings = _passages_of_the_origin(loop)
    grid = sweep_frequencies(loop)
    for i, gains in enumerate(_gains(loop, grid).T):
        w, g = _add_extrema(loop, grid, gains, i)
        # A neutral root is where |l| tends to 1 for w to 0: no crossing.
        is_sure = np.abs(g) > _MAGNITUDE_TOLERANCE
        w, g = w[is_sure], g[is_sure]
        for k in np.flatnonzero((g[:-1] > 0) != (g[1:] > 0)):
            inner = w[k : k + 2]
            while inner[0] < np.nextafter(inner[-1], 0):
                inner = np.linspace(inner[0], inner[-1], _NUM_INNER_POINTS)
                is_above = _gains(loop, inner)[:, i] > 0
                is_above[[0, -1]] = g[k : k + 2] > 0
                first = int(np.argmax(is_above != is_above[0]))
                inner = inner[first - 1 : first + 1]
            frequency = float(inner[-1])
            value = complex(eigenloci(loop, inner[-1:])[0, i])
            phase = float(np.angle(value) + np.pi) % (2 * np.pi)
            # Rounding must not make a whole turn of none.
            if phase > 2 * np.pi * (1 - _AXIS_TOLERANCE):
                phase = 0.0
            crossings.append(
                Crossing(
                    frequency=frequency,
                    delay=phase / frequency,
                    direction=1 if g[k] > 0 else -1,
                )
            )
    return sorted(crossings, key=lambda crossing: crossing.frequency)


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
    roots = np.linalg.eigvals(closed_loop_matrix(loop))
    size = float(np.linalg.norm(loop.A))
    roots = roots[np.abs(roots) > max(slow, _SLOW * size)]
    # Roots on the axis do not count, and those at 0 are on it.
    scale = np.maximum(np.abs(roots), 1e-3 * size)
    count = int(np.sum(roots.real > _AXIS_TOLERANCE * scale))
    changes: list[tuple[float, int]] = []
    for crossing in crossings:
        if crossing.frequency == 0:
            if crossing.delay <= 0:
                count += crossing.direction > 0
            elif crossing.delay < max_delay:
                changes.append((crossing.delay, crossing.direction))
            continue
        period = 2 * math.pi / crossing.frequency
        delay = crossing.delay
        if delay < _AXIS_TOLERANCE * period:
            # The pair is on the axis without delay.
            count += 2 * (crossing.direction > 0)
            delay += period
        while delay < max_delay:
            changes.append((delay, 2 * crossing.direction))
            delay += period
    delays, counts = [0.0], [count]
    for delay, change in sorted(changes):
        delays.append(delay)
        counts.append(counts[-1] + change)
    return np.array(delays), np.array(counts)


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
    n, m = loop.num_states, len(loop.D)
    modes = np.abs(np.linalg.eigvals(closed_loop_matrix(loop)))
    modes = modes[modes > _SLOW * np.linalg.norm(loop.A)]
    radius = 0.1 * float(modes.min(initial=1.0))
    circle = np.exp(2j * np.pi * np.arange(_NUM_CIRCLE_POINTS) / _NUM_CIRCLE_POINTS)

    def coefficients(delay: float, count: int = 2) -> Array:
        """Returns the first Taylor coefficients at s = 0 of g = det/s^order."""
        s = min(radius, 10 / max(delay, 1e-9)) * circle
        matrix = np.zeros((len(s), n + m, n + m), dtype=complex)
        z = np.exp(-s * delay)[:, None, None]
        matrix[:, :n, :n] = s[:, None, None] * np.eye(n) - loop.A
        matrix[:, :n, n:] = -loop.B * z
        matrix[:, n:, :n] = loop.C
        matrix[:, n:, n:] = np.eye(m) + loop.D * z
        g = np.linalg.det(matrix) / s**order
        return np.array([np.mean(g / s**k).real for k in range(count)])

    # g(0, T) is a polynomial in T of degree `order` at most.
    unit = 1 / max(radius, 1e-6)
    nodes = unit * np.arange(order + 1)
    values = np.array([coefficients(delay)[0] for delay in nodes])
    polynomial = np.polyfit(nodes / unit, values, order)
    polynomial[np.abs(polynomial) < 1e-9 * np.abs(polynomial).max()] = 0.0
    passages = []
    num_without_delay = 0
    for root in np.roots(polynomial):
        if abs(root.imag) > 1e-6 * abs(root) or root.real < 0:
            continue
        delay = unit * float(root.real)
        if delay < _AXIS_TOLERANCE * unit:
            num_without_delay += 1
            continue
        slope = float(np.polyval(np.polyder(polynomial), root.real))
        # The root is at -g(0, T)/g_s.
        direction = -1 if slope * coefficients(delay)[1] > 0 else 1
        passages.append(Crossing(frequency=0.0, delay=delay, direction=direction))
    if num_without_delay:
        # They leave 0 as the delay leaves it; so where are they with a small one?
        nearby = coefficients(0.01 * unit, num_without_delay + 1)
        for s in np.roots(nearby[::-1]):
            direction = 1 if s.real > 0 else -1
            passages.append(Crossing(frequency=0.0, delay=0.0, direction=direction))
    return passages


def _gains(loop: StateSpace, frequencies: Array) -> Array:
    """Returns log |l| of all eigenloci (K, m)."""
    return np.log(np.maximum(np.abs(eigenloci(loop, frequencies)), 1e-300))


def _add_extrema(loop: StateSpace, w: Array, g: Array, i: int) -> tuple[Array, Array]:
    """Adds the extrema at which g = log |l_i| changes sign between two points."""
    size = np.abs(g)
    is_closest = (
        (size[1:-1] <= np.minimum(size[:-2], size[2:]))
        & ((g[1:-1] > 0) == (g[:-2] > 0))
        & ((g[1:-1] > 0) == (g[2:] > 0))
        & (size[1:-1] < 0.5)
        # Where |l| is 1, as next to a neutral root, rounding makes extrema of its own.
        & (size[1:-1] > _MAGNITUDE_TOLERANCE)
    )
    for k in np.flatnonzero(is_closest) + 1:
        sign = 1.0 if g[k] > 0 else -1.0
        low, high = w[k - 1], w[k + 1]
        for _ in range(12):
            inner = np.geomspace(low, high, _NUM_INNER_POINTS)
            values = _gains(loop, inner)[:, i]
            least = int(np.clip(np.argmin(sign * values), 1, len(inner) - 2))
            low, high = inner[least - 1], inner[least + 1]
        if sign * values[least] < 0:
            w, g = np.append(w, inner[least]), np.append(g, values[least])
    order = np.argsort(w)
    return w[order], g[order]

"""Stability of a feedback loop against its delay, by sweeping the frequency.

The loop is cut at the delay. The open loop is a linear system L, and the closed loop
has the characteristic equation

    det(I + L(s) e^(-s T)) = 0.                                                  (1)

The delay is exact, not a Pade approximation. loops.numerics.crossings tells where roots
cross the imaginary axis, and at which delays (2). The number of unstable roots
at T = 0 follows from an eigenvalue problem, and the number at every other T by
counting. As T grows, the loop may lose stability and regain it.

Sources: K. L. Cooke and Z. Grossman, "Discrete delay, distributed delay and stability
switches", J. Math. Anal. Appl. 86 (1982); K. Walton and J. E. Marshall, "Direct method
for TDS stability analysis", IEE Proc. D 134 (1987); J. Chen, G. Gu and C. N. Nett,
"A new method for computing delay margins for stability of linear delay systems",
Syst. Control Lett. 26 (1995); K. Gu, V. L. Kharitonov and J. Chen, "Stability of
Time-Delay Systems", Birkhauser (2003).

Modes that do not appear in L are not considered here (see minimal_realization).

Neutral roots. At s = 0 the delay has no effect, so a root at 0 is a root for every
delay. It stands for a set of equilibria, such as all the places at which a tool can
rest: the loop neither leaves such a place nor returns to it. Only neutral_root_count
counts these roots. Another, real root may pass through 0. With k neutral roots, the
left side of (1) times det(s I - A) is s^k g(s, T), and a root passes through 0 where
g(0, T), a polynomial in T, is zero.
"""

from functools import partial

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Indices, Interval
from teleop_drake.loops.numerics.crossings import (
    AXIS_TOLERANCE,
    Crossing,
    closed_loop_matrix,
    crossings_between,
    sweep_frequencies,
)
from teleop_drake.loops.numerics.delayed_loop import (
    count_roots,
    intervals_without_roots,
)
from teleop_drake.loops.numerics.state_space import StateSpace

# A mode slower than this, relative to the norm of A, counts as at 0. Several modes at 0
# that form a Jordan block are not computed more accurately.
_SLOW = 1e-6

# Derivatives at s = 0 are computed on a circle about 0. It has this number of points,
# this radius as a share of the slowest mode that is not neutral, and at most this
# product of radius and delay.
_NUM_CIRCLE_POINTS = 64
_CIRCLE_SHARE = 0.1
_LARGEST_TURN = 10.0

# A coefficient of g(0, T) counts as 0 below the first share, of the largest one. The
# imaginary part of a root of it counts as 0 below the second share, of the root.
_NEGLIGIBLE_COEFFICIENT = 1e-9
_NEGLIGIBLE_IMAGINARY = 1e-6


def find_crossings(loop: StateSpace) -> list[Crossing]:
    """Returns all crossings of the imaginary axis by roots of (1), by frequency.

    Where |l| only touches 1, no root changes sides, and no crossing is reported.
    """
    if loop.num_states == 0 or len(loop.D) == 0:
        return []
    crossings = _passages_of_the_origin(loop)
    crossings += crossings_between(loop, sweep_frequencies(loop))
    return sorted(crossings, key=lambda crossing: crossing.frequency)


def neutral_root_count(loop: StateSpace) -> int:
    """Returns the number of roots at s = 0, the same for every delay."""
    tolerance = AXIS_TOLERANCE * float(np.linalg.norm(loop.A))
    rank = np.linalg.matrix_rank(closed_loop_matrix(loop), tol=tolerance)
    return loop.num_states - int(rank)


def is_delay_robust(loop: StateSpace) -> bool:
    """Returns whether a small enough delay adds no root near or right of the axis.

    The condition is that the spectral radius of D is less than 1. Without direct
    feedthrough the radius is 0. If it is 1 or more, infinitely many roots lie right of
    the imaginary axis, or tend to it, for every delay > 0.

    Source: D. Henry, "Linear autonomous neutral functional differential equations",
    J. Differ. Equ. 15 (1974).
    """
    radius = np.abs(np.linalg.eigvals(loop.D)).max(initial=0.0)
    return bool(radius < 1 - AXIS_TOLERANCE)


def unstable_roots(
    loop: StateSpace,
    max_delay: float,
    crossings: list[Crossing],
    slow: float = 0.0,
) -> tuple[Array, Indices]:
    """Returns the number of unstable roots of (1) as a function of the delay.

    Args:
        loop: L, minimal, such that is_delay_robust(loop).
        max_delay: The largest delay in s.
        crossings: The crossings of find_crossings(loop) to be counted.
        slow: The magnitude in 1/s below which a root counts as at 0.

    Returns:
        Delays (K) in s, ascending from 0, and the number of unstable roots from each
        delay to the next one (K); the last number holds up to max_delay.
    """
    return count_roots(_unstable_without_delay(loop, slow), max_delay, crossings)


def _unstable_without_delay(loop: StateSpace, slow: float) -> int:
    """Returns the number of roots right of the imaginary axis without delay.

    Roots on the axis are not counted.

    Args:
        loop: L.
        slow: The magnitude in 1/s below which a root counts as at 0, on the axis.
    """
    size = float(np.linalg.norm(loop.A))
    roots = np.linalg.eigvals(closed_loop_matrix(loop))
    roots = roots[np.abs(roots) > max(slow, _SLOW * size)]
    scale = np.maximum(np.abs(roots), 1e-3 * size)
    return int(np.sum(roots.real > AXIS_TOLERANCE * scale))


def stable_delays(
    loop: StateSpace,
    max_delay: float,
    crossings: list[Crossing],
    slow: float = 0.0,
) -> list[Interval]:
    """Returns all intervals of delays in s in which the loop is stable.

    There all roots except the neutral ones lie left of the imaginary axis.

    Args:
        loop: L, minimal.
        max_delay: The largest delay in s. An interval that ends there may continue
            beyond it.
        crossings: The crossings of find_crossings(loop) to be counted.
        slow: The magnitude in 1/s below which a root counts as at 0.
    """
    if not is_delay_robust(loop):
        return []
    delays, counts = unstable_roots(loop, max_delay, crossings, slow)
    return intervals_without_roots(delays, counts, max_delay)


def delay_margin(
    loop: StateSpace, crossings: list[Crossing], slow: float = 0.0
) -> Crossing | None:
    """Returns the crossing at which growing delay first makes the loop unstable.

    Its `delay` is the delay margin, its `phase_margin` the phase margin. The result is
    None if the loop is unstable without delay or stable with every delay.

    Args:
        loop: L, minimal.
        crossings: The crossings of find_crossings(loop) to be counted.
        slow: The magnitude in 1/s below which a root counts as at 0.
    """
    if not is_delay_robust(loop) or unstable_roots(loop, 0.0, crossings, slow)[1][-1]:
        return None
    outward = [crossing for crossing in crossings if crossing.direction > 0]
    return min(outward, key=lambda crossing: crossing.delay, default=None)


def _passages_of_the_origin(loop: StateSpace) -> list[Crossing]:
    """Returns the crossings at which a real root passes through the neutral roots.

    With k neutral roots the characteristic determinant is s^k g(s, T), and g(0, T) = 0
    at the delays T >= 0 of these crossings.
    """
    order = neutral_root_count(loop)
    if order == 0:
        return []
    modes = np.abs(np.linalg.eigvals(closed_loop_matrix(loop)))
    modes = modes[modes > _SLOW * np.linalg.norm(loop.A)]
    radius = _CIRCLE_SHARE * float(modes.min(initial=1.0))
    taylor = partial(_reduced_taylor, loop, order, radius)
    # g(0, T) is a polynomial of degree k in T, which k + 1 values determine. Its unit
    # of time follows from the slowest mode that is not neutral.
    unit = 1 / max(radius, 1e-6)
    nodes = np.arange(order + 1)
    polynomial = np.polyfit(nodes, [taylor(unit * x)[0] for x in nodes], order)
    sizes = np.abs(polynomial)
    polynomial[sizes < _NEGLIGIBLE_COEFFICIENT * sizes.max()] = 0.0
    roots = np.roots(polynomial)
    is_real = np.abs(roots.imag) <= _NEGLIGIBLE_IMAGINARY * np.abs(roots)
    times = roots.real[is_real & (roots.real >= 0)]
    # The number of roots that pass at each delay. Several may pass at T = 0.
    is_at_once = times < AXIS_TOLERANCE
    numbers = {unit * float(time): 1 for time in times[~is_at_once]}
    numbers[0.0] = int(is_at_once.sum())
    passages = []
    for delay, number in numbers.items():
        # The direction is the side on which the roots near 0 lie at a slightly longer
        # delay.
        ascending = taylor(delay + 0.01 * unit)[: number + 1]
        for s in np.roots(ascending[::-1]):
            direction = 1 if s.real > 0 else -1
            passages.append(Crossing(frequency=0.0, delay=delay, direction=direction))
    return passages


def _reduced_taylor(loop: StateSpace, order: int, radius: float, delay: float) -> Array:
    """Returns the first coefficients of g(s, T) by ascending powers of s (k + 1).

    s^k g(s, T) is the determinant of the loop's characteristic matrix, a polynomial in
    s and e^(-s T). The coefficients follow from Cauchy's integral formula on a circle
    about 0.

    Args:
        loop: L, with k >= 1 neutral roots.
        order: k.
        radius: The largest radius of the circle in 1/s; for long delays it is less.
        delay: T in s.
    """
    turns = np.arange(_NUM_CIRCLE_POINTS) / _NUM_CIRCLE_POINTS
    s = min(radius, _LARGEST_TURN / max(delay, 1e-9)) * np.exp(2j * np.pi * turns)
    g = np.linalg.det(loop.fed_back(delay).characteristic_matrix(s)) / s**order
    powers = s ** np.arange(order + 1)[:, np.newaxis]
    return (g / powers).mean(axis=1).real

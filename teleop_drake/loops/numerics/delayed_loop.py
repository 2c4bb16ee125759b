"""Stability margins of a loop that contains delays.

The loop is cut open between y and u. The open loop is a linear system with delays:

    [y, e] = G(s) [u, d],    d_i(t) = e_i(t - T_i)

With the response L(s) from u to y, the loop that is closed by u(t) = -k y(t - T) has
the characteristic equation det(I + k L(s) e^(-s T)) = 0. The actual loop has k = 1 and
T = 0. Its stability is found by collocation (characteristic_roots). If it is stable, a
root reaches the imaginary axis first

* as T grows from 0: where an eigenvalue l(j w) of L(j w) has the magnitude 1, see
  delay_margin;
* as k moves away from 1: where an eigenvalue is real and negative, and k = -1/l.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teleop_drake.loops.framework.arrays import Array, ComplexArray
from teleop_drake.loops.numerics.characteristic_roots import characteristic_roots
from teleop_drake.loops.numerics.crossings import (
    Crossing,
    LoopLoci,
    crossings_between,
    eigenloci,
    locate,
    sweep_frequencies,
)
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


@dataclass(frozen=True, kw_only=True)
class Margins:
    """The stability margins of a loop at a cut, for all signals of the cut alike.

    Attributes:
        is_stable: Whether the loop is stable without additional delay, phase or gain;
            neutral roots at 0 are allowed. If it is unstable, the margins are 0, and 1
            for the gain.
        delay: The smallest additional delay in s that makes the loop unstable; infinity
            if the loop is stable with every delay.
        frequency: The frequency of the oscillation at this delay, rad/s; 0 if no delay
            makes the loop unstable.
        phase: The smallest additional phase in rad, of either sign, that makes the loop
            unstable; infinity if the loop is stable with every phase.
        gain: The limits of the additional gain, one below and one above 1, between
            which the loop is stable; 0 and infinity if there is no limit from 1/100 to
            100.
    """

    is_stable: bool
    delay: float = 0.0
    frequency: float = 0.0
    phase: float = 0.0
    gain: tuple[float, float] = (1.0, 1.0)


def margins_of(loop: StateSpace) -> Margins:
    """Returns the stability margins of a loop at a cut.

    Args:
        loop: L, from u to y of the same size, with its inner delays T_i > 0.
    """
    loop, hidden = without_hidden_modes(loop)
    m = loop.num_open[0]
    closed = (-loop).closed(np.arange(m))
    slow = slowest_resolved(closed)
    # The rightmost roots decide the stability.
    roots = np.append(hidden, characteristic_roots(closed))
    if np.any(roots.real > slow) or gain_at_once(closed.D, closed.delays) >= 1:
        return Margins(is_stable=False)
    grid = _sweep(loop)
    crossings = crossings_between(loop, grid)
    bounds = [crossing for crossing in crossings if crossing.direction > 0]
    bounds.append(_at_zero_frequency(loop, np.abs(roots), slow))
    first = min(bounds, key=lambda crossing: crossing.delay)
    lags = [crossing.phase_margin for crossing in crossings]
    return Margins(
        is_stable=True,
        delay=first.delay,
        frequency=first.frequency,
        phase=min((min(x, 2 * math.pi - x) for x in lags), default=math.inf),
        gain=_gains_between(loop, grid),
    )


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


def _sweep(loop: StateSpace) -> Array:
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


def _gains_between(loop: StateSpace, grid: Array) -> tuple[float, float]:
    """Returns the gains next to 1, below and above, at which a root is on the axis.

    Without such a gain the result is 0 or infinity.

    Args:
        loop: L.
        grid: Ascending frequencies in rad/s, from far below the slowest mode.
    """
    # The signal that comes back; its positive eigenvalues p belong to k = 1/p.
    system = -loop
    # At the frequency 0 a locus ends on the real axis or at infinity. Finite, positive
    # ends belong to roots at 0.
    at_zero, slow = eigenloci(system, grid[0] * np.array([0.1, 1.0]))
    is_real = np.abs(at_zero.imag) < _NEARLY * at_zero.real
    is_finite = np.abs(at_zero - slow) < _NEARLY * np.abs(slow)
    values = at_zero[is_real & is_finite].real
    # A neutral root of the actual loop makes an end at 1, which is not counted.
    values = values[np.abs(values - 1) > _REAL]
    loci = eigenloci(system, grid)
    # Smaller real parts are rounding errors of 0.
    is_right = loci.real > _REAL * np.abs(loci[:, :1])
    has_changed = np.diff(np.signbit(loci.imag), axis=0) & is_right[:-1] & is_right[1:]
    k, columns = np.nonzero(has_changed)
    back = LoopLoci(system)
    _, found = locate(back, columns, lambda p: p.imag, grid[k], grid[k + 1])
    # The sign of the imaginary part also changes where two complex eigenvalues of equal
    # magnitude change places in the order. These are left out.
    is_real = np.abs(found.imag) < _REAL * np.abs(found)
    values = np.append(values, found[is_real & (found.real > 0)].real)
    gains = 1 / values
    below = gains[gains < 1].max(initial=0.0)
    return float(below), float(gains[gains > 1].min(initial=math.inf))

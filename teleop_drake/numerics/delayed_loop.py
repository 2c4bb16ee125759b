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
from dataclasses import dataclass, replace

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.numerics.characteristic_roots import characteristic_roots
from teleop_drake.numerics.crossings import (
    Crossing,
    crossings_between,
    eigenloci,
    locate,
    sweep_frequencies,
)
from teleop_drake.numerics.state_space import StateSpace

# A root slower than this, relative to the norm of A, counts as at 0.
_NEUTRAL = 1e-6

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
    # A loop of direct feedthrough with a gain of 1 or more would have infinitely many
    # roots near or right of the imaginary axis.
    gains_at_once = np.linalg.eigvals(np.abs(loop.D))
    if np.abs(gains_at_once).max(initial=0.0) >= 1:
        return Margins(is_stable=False)
    closed = (-loop).closed(np.arange(loop.num_open[0]))
    slow = _NEUTRAL * float(np.linalg.norm(closed.A))
    # The two rightmost roots decide the stability.
    roots = characteristic_roots(closed, count=2)
    if np.any((np.abs(roots) > slow) & (roots.real > slow)):
        return Margins(is_stable=False)
    grid = _sweep(loop)
    crossings = crossings_between(loop, grid)
    first = min(
        (crossing for crossing in crossings if crossing.direction > 0),
        key=lambda crossing: crossing.delay,
        default=Crossing(frequency=0.0, delay=math.inf, direction=1),
    )
    lags = [crossing.phase_margin for crossing in crossings]
    return Margins(
        is_stable=True,
        delay=first.delay,
        frequency=first.frequency,
        phase=min((min(x, 2 * math.pi - x) for x in lags), default=math.inf),
        gain=_gains_between(loop, grid),
    )


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
    for locus in range(loci.shape[1]):
        k = np.flatnonzero(has_changed[:, locus])
        _, found = locate(
            system, locus, lambda p: np.signbit(p.imag), grid[k], grid[k + 1]
        )
        # The sign of the imaginary part also changes where two complex eigenvalues of
        # equal magnitude change places in the order. These are left out.
        is_real = np.abs(found.imag) < _REAL * np.abs(found)
        values = np.append(values, found[is_real & (found.real > 0)].real)
    gains = 1 / values
    below = gains[gains < 1].max(initial=0.0)
    return float(below), float(gains[gains > 1].min(initial=math.inf))

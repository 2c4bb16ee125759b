"""The margins of a loop that has delays in it.

The loop is cut open between y and u. What remains is a linear system with delays:

    [y, e] = G(s) [u, d],    d_i(t) = e_i(t - T_i)

With the response P(s) from u to y, the loop that is closed by u = k y(t - T) has the
characteristic equation det(I - k P(s) e^(-s T)) = 0. Without a gain k and a delay T
more it is the loop itself: k = 1, T = 0. Whether that is stable is found by collocation
(characteristic_roots). If it is, a root reaches the imaginary axis first

* as T grows from 0: where an eigenvalue p(j w) of P(j w) has the magnitude 1, see
  delay_margin;
* as k moves away from 1: where an eigenvalue is real and positive, and k = 1/p.
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

# A root this slow, relative to the norm of A, cannot be told from one at 0.
_NEUTRAL = 1e-6

# Points of the sweep for each turn of the phase by all delays, and how many at most.
_POINTS_PER_TURN = 12
_MAX_POINTS = 100_000

# Where all that goes around is weaker than this, nothing is looked for.
_LEAST_GAIN = 1e-2

# How real an eigenvalue has to be.
_REAL = 1e-6

# What it may differ by from its value at the frequency 0, far below all modes.
_NEARLY = 1e-3


@dataclass(frozen=True, kw_only=True)
class Margins:
    """What a loop tolerates at the place where it is cut open, in all its signals.

    Attributes:
        is_stable: Whether the loop is stable as it is, neutral roots at 0 apart. If
            not, it has no margins: they are 0, and 1 for the gain.
        delay: The additional delay in s from which on the loop is unstable; infinity:
            it is stable with every delay.
        frequency: Of the oscillation at this delay, rad/s; 0: there is none.
        phase: The least additional phase in rad, of either sign, with which the loop is
            unstable; infinity: it is stable with every phase.
        gain: The additional gains between which the loop is stable, one below and one
            above 1; 0 and infinity: there is no such limit from 1/100 to 100.
    """

    is_stable: bool
    delay: float = 0.0
    frequency: float = 0.0
    phase: float = 0.0
    gain: tuple[float, float] = (1.0, 1.0)


def margins_of(system: StateSpace) -> Margins:
    """Returns what a loop tolerates where it is cut open.

    Args:
        system: From u to y, of the same size, with the delays T_i > 0 in it.
    """
    # Without dynamics around the loop, infinitely many roots lie near the axis.
    gains_at_once = np.linalg.eigvals(np.abs(system.D))
    if np.abs(gains_at_once).max(initial=0.0) >= 1:
        return Margins(is_stable=False)
    closed = system.closed(np.arange(system.num_open[0]))
    slow = _NEUTRAL * float(np.linalg.norm(closed.A))
    # The rightmost roots are the first to be right of the axis.
    roots = characteristic_roots(closed, count=2)
    if np.any((np.abs(roots) > slow) & (roots.real > slow)):
        return Margins(is_stable=False)
    # With the sign that delay_margin takes: det(I + L(s) e^(-s T)) = 0.
    loop = -system
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
        gain=_gains_between(system, grid),
    )


def _sweep(loop: StateSpace) -> Array:
    """Returns ascending frequencies in rad/s that show all that L(j w) does."""
    # Loops of the delays alone have modes of their own.
    rest = np.arange(loop.num_open[0], len(loop.D))
    inner = loop.part(np.arange(loop.num_states), rest, rest)
    modes = characteristic_roots(replace(inner, delays=loop.delays))
    grid = sweep_frequencies(loop, modes)
    sizes = np.abs(loop.opened.frequency_response(grid))
    # What no delays let go around any loop of the signals with more.
    largest = np.abs(np.linalg.eigvals(sizes)).max(axis=1, initial=0.0)
    is_heard = largest > _LEAST_GAIN
    grid = grid[: np.flatnonzero(is_heard).max(initial=0) + 2]
    turns = grid[-1] * sum(loop.delays) / (2 * math.pi)
    num_points = min(math.ceil(_POINTS_PER_TURN * turns), _MAX_POINTS)
    even = np.linspace(grid[0], grid[-1], num_points)
    return np.array(sorted({*grid, *even}))


def _gains_between(system: StateSpace, grid: Array) -> tuple[float, float]:
    """Returns the gains next to 1 at which a root is on the axis, or 0, infinity.

    Args:
        grid: Frequencies in rad/s, from far below the slowest mode.
    """
    # The loci end on the real axis at the frequency 0, unless they come from there at
    # infinity.
    at_zero, slow = eigenloci(system, grid[0] * np.array([0.1, 1.0]))
    is_real = np.abs(at_zero.imag) < _NEARLY * at_zero.real
    is_finite = np.abs(at_zero - slow) < _NEARLY * np.abs(slow)
    values = at_zero[is_real & is_finite].real
    # A neutral root stays where it is only with the gain 1.
    values = values[np.abs(values - 1) > _REAL]
    loci = eigenloci(system, grid)
    # Smaller ones are the rounding errors of 0.
    is_right = loci.real > _REAL * np.abs(loci[:, :1])
    has_changed = np.diff(np.signbit(loci.imag), axis=0) & is_right[:-1] & is_right[1:]
    for locus in range(loci.shape[1]):
        k = np.flatnonzero(has_changed[:, locus])
        _, found = locate(
            system, locus, lambda p: np.signbit(p.imag), grid[k], grid[k + 1]
        )
        # Where two eigenvalues of the same size change places, neither is real.
        is_real = np.abs(found.imag) < _REAL * np.abs(found)
        values = np.append(values, found[is_real & (found.real > 0)].real)
    gains = 1 / values
    below = gains[gains < 1].max(initial=0.0)
    return float(below), float(gains[gains > 1].min(initial=math.inf))

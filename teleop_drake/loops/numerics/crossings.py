"""The frequencies at which the eigenloci of a loop cross the unit circle.

The loop is cut open and closed again by a delay T. With the open loop L, it has the
characteristic equation

    det(I + L(s) e^(-s T)) = 0.                                                  (1)

A root can change sides only through the imaginary axis, at s = j w, where
|e^(-j w T)| = 1. There an eigenvalue l(j w) of L(j w) (an eigenlocus) has |l| = 1,
whatever the delay. Only a few w meet this condition. Each belongs to the delays

    T_k = (arg l - pi + 2 pi k)/w,   k = 0, 1, ...                               (2)

At all of these delays the root crosses in the same direction: differentiating (1) gives
sign Re ds/dT = -sign d|l|/dw. Where |l| falls through 1, a pair of roots becomes
unstable; where |l| rises through 1, a pair becomes stable.

The frequency is swept, densely around each pole, and each crossing is located to
rounding.

Source: K. L. Cooke and Z. Grossman, "Discrete delay, distributed delay and stability
switches", J. Math. Anal. Appl. 86 (1982).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize.elementwise import find_root

from teleop_drake.loops.framework.arrays import Array, ComplexArray, Indices
from teleop_drake.loops.numerics.state_space import StateSpace

AXIS_TOLERANCE = 1e-8
"""The relative distance within which a root counts as on the imaginary axis."""

# Magnitudes |l| whose logarithms differ by less than this count as equal.
_EQUAL = 1e-8

# Frequencies closer than this, relative to themselves, may differ by rounding only.
_SAME_FREQUENCY = 1e-8

# |log|l|| below this may be a rounding error of 0.
_MAGNITUDE_TOLERANCE = 1e-10

# The number of points of the first sweep, and of those on each side of each pole.
_NUM_SWEEP_POINTS = 2000
_NUM_POLE_POINTS = 80

# Around an extremum of |l| the sweep is refined: the number of points of each
# refinement, ends included, and the number of refinements.
_NUM_INNER_POINTS = 17
_NUM_EXTREMUM_SWEEPS = 12

# Only extrema of log |l| closer to 0 than this are refined: a finer sweep may find two
# crossings there.
_NEAR_CROSSING = 0.5

# A parabola through an extremum has to come closer to 0 than the middle point by this
# factor, for the sweep to be refined there.
_SHARE_OF_EXTREMUM = 0.5

# The refinement ends at this relative distance of frequencies. The magnitude, being
# flat there, is then known to the square of this number.
_FINEST = 1e-7


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """A frequency at which roots cross the imaginary axis.

    Attributes:
        frequency: w >= 0 in rad/s, a gain crossover of an eigenlocus; 0 if a real root
            passes through the neutral roots at s = 0.
        delay: The smallest delay >= 0 in s at which roots cross here. For w > 0 the
            other delays follow in steps of 2 pi/w.
        direction: +1 if the roots move to the right, towards instability; -1 if they
            move to the left.
    """

    frequency: float
    delay: float
    direction: int

    @property
    def phase_margin(self) -> float:
        """The phase lag in rad, 0 to 2 pi, of the delay at the crossing."""
        return self.frequency * self.delay


def eigenloci(loop: StateSpace, frequencies: Array) -> ComplexArray:
    """Returns the eigenvalues of L(j w) by descending magnitude (K, m).

    On a pole of L they are those just beside it.

    Args:
        loop: L, with m inputs and m outputs.
        frequencies: w in rad/s (K).
    """
    response = loop.finite_response(frequencies)
    return by_size(np.linalg.eigvals(response).astype(complex))


def by_size(values: ComplexArray) -> ComplexArray:
    """Returns eigenvalues by descending magnitude (K, m), the upper of a pair first.

    Without a rule for pairs, whose magnitudes differ by rounding only, both would be
    taken for one where a magnitude of 1 is located.

    Args:
        values: Eigenvalues at some frequencies (K, m).
    """
    order = np.argsort(-np.abs(values), axis=1, kind="stable")
    values = np.take_along_axis(values, order, axis=1)
    # Neighbours of equal size have the same rank.
    with np.errstate(invalid="ignore"):  # Infinite values are equal.
        falls = np.diff(_log_size(values), axis=1) < -_EQUAL
    ranks = np.cumsum(np.pad(falls, ((0, 0), (1, 0))), axis=1)
    order = np.lexsort((-values.imag, ranks), axis=1)
    return np.take_along_axis(values, order, axis=1)


def closed_loop_matrix(loop: StateSpace) -> Array:
    """Returns A of the loop that u = -y closes, with all delays inside set to 0.

    Its characteristic equation is det(I + L(s)) = 0.

    Raises:
        ValueError: If the loop is not well posed without delay.
    """
    return (-loop).opened.closed(np.arange(len(loop.D))).A


def sweep_frequencies(loop: StateSpace, more_poles: ArrayLike = ()) -> Array:
    """Returns ascending frequencies in rad/s that resolve the features of L(j w).

    They are spaced logarithmically, and closely around each pole near the imaginary
    axis. They reach from far below the slowest mode to where L(j w) is close to D.

    Args:
        loop: L.
        more_poles: Further points in 1/s around which the frequencies are dense.
    """
    poles = np.concatenate([np.linalg.eigvals(loop.A), np.asarray(more_poles)])
    closed_loop_modes = np.linalg.eigvals(closed_loop_matrix(loop))
    modes = np.abs(np.concatenate([poles, closed_loop_modes]))
    high = _highest_frequency(loop)
    slow_modes = modes[modes > 1e-9 * high]
    slowest = min(float(slow_modes.min(initial=high)), high)
    low = 1e-4 * slowest
    # The width of a pole's peak is the pole's distance from the imaginary axis.
    near = poles[poles.imag > low]
    widths = np.maximum(np.abs(near.real), 1e-9 * np.abs(near))
    offsets = np.geomspace(widths / 8, np.abs(near), _NUM_POLE_POINTS)
    around = np.concatenate([near.imag + offsets, near.imag - offsets]).ravel()
    even = np.geomspace(low, high, _NUM_SWEEP_POINTS)
    # np.unique() imports all of numpy.ma.
    result = np.array(sorted({*even.tolist(), *around.tolist()}))
    return result[(result >= low) & (result <= high)]


def _highest_frequency(loop: StateSpace) -> float:
    """Returns a frequency in rad/s above which |L(j w)| < 1, if |D| < 1.

    It follows from |C (j w - A)^-1 B| <= |B| |C|/(w - |A|).
    """
    gain = float(np.linalg.norm(loop.B) * np.linalg.norm(loop.C))
    feedthrough = float(np.linalg.norm(loop.D, 2)) if loop.D.size else 0.0
    left_over = max(1 - feedthrough, 0.01)
    return 1.01 * (float(np.linalg.norm(loop.A)) + gain / left_over + 1e-3)


class Loci(Protocol):
    """Eigenvalues of one or more loops as functions of the frequency."""

    def over(self, frequencies: Array) -> ComplexArray:
        """Returns all m eigenvalues (K, m), those of a loop by descending magnitude.

        Args:
            frequencies: w in rad/s (K).
        """

    def at(self, frequencies: Array, columns: Indices) -> ComplexArray:
        """Returns an eigenvalue for each frequency (k).

        Args:
            frequencies: w in rad/s (k).
            columns: The column of each of the eigenvalues in over() (k).
        """


@dataclass(frozen=True, eq=False)
class LoopLoci:
    """The eigenloci of a loop L; see Loci."""

    loop: StateSpace

    def over(self, frequencies: Array) -> ComplexArray:
        """Returns the eigenloci (K, m)."""
        return eigenloci(self.loop, frequencies)

    def at(self, frequencies: Array, columns: Indices) -> ComplexArray:
        """Returns one of the eigenloci for each frequency (k)."""
        return self.over(frequencies)[np.arange(len(columns)), columns]


def crossings_between(loop: StateSpace, grid: Array) -> list[Crossing]:
    """Returns the crossings of the unit circle by the eigenloci of L(j w).

    Args:
        loop: L.
        grid: Ascending frequencies in rad/s that resolve the features of L(j w).
    """
    return [crossing for _, crossing in crossings_of(LoopLoci(loop), grid)]


def crossings_of(loci: Loci, grid: Array) -> list[tuple[int, Crossing]]:
    """Returns the crossings of the unit circle, each with the column of its locus.

    Args:
        loci: The eigenloci of one or more loops.
        grid: Ascending frequencies in rad/s that resolve their features.
    """
    gains = _log_size(loci.over(grid))
    intervals = _passed(gains, grid)
    intervals += _passed_within(loci, *_close_extrema(gains, grid))
    if not intervals:
        return []
    columns, low, high = map(np.array, zip(*intervals, strict=True))
    frequencies, values = locate(loci, columns, _log_size, low, high)
    falls = _log_size(loci.at(low, columns)) > 0
    found = zip(
        columns.tolist(), frequencies.tolist(), values.tolist(), falls, strict=True
    )
    return [
        (
            column,
            Crossing(
                frequency=frequency,
                delay=_phase_to_cross(value) / frequency,
                direction=1 if is_falling else -1,
            ),
        )
        for column, frequency, value, is_falling in found
    ]


_Interval = tuple[int, float, float]
"""A column of the loci, and two frequencies in rad/s between which it passes 1."""


def _passed(gains: Array, grid: Array) -> list[_Interval]:
    """Returns the intervals of a grid in which loci pass the unit circle.

    Args:
        gains: log |l| (K, m).
        grid: Ascending frequencies in rad/s (K).
    """
    intervals = []
    for column, gain in enumerate(gains.T):
        # With a neutral root |l| tends to 1 as w tends to 0. That is no crossing.
        sure = np.flatnonzero(np.abs(gain) > _MAGNITUDE_TOLERANCE)
        for k in np.flatnonzero(np.diff(gain[sure] > 0)):
            interval = (column, float(grid[sure[k]]), float(grid[sure[k + 1]]))
            intervals.append(interval)
    return intervals


def _close_extrema(gains: Array, grid: Array) -> tuple[Indices, Array, Array]:
    """Returns intervals in which a locus may pass the unit circle twice.

    A parabola through three points of log |l|, of which the second is closest to 0,
    comes much closer to 0 or passes it.

    Args:
        gains: log |l| (K, m).
        grid: Ascending frequencies in rad/s (K).

    Returns:
        The columns of the loci (k), and both ends of the intervals in rad/s (k).
    """
    size = np.abs(gains)
    here = size[1:-1]
    is_least = here <= np.minimum(size[:-2], size[2:])
    has_passed = np.diff(gains > 0, axis=0)
    is_on_one_side = ~(has_passed[:-1] | has_passed[1:])
    # Where |l| is 1, as next to a neutral root, rounding errors look like extrema.
    is_near = (here > _MAGNITUDE_TOLERANCE) & (here < _NEAR_CROSSING)
    k, columns = np.nonzero(is_least & is_on_one_side & is_near)
    before, middle, after = (size[k + i, columns] for i in range(3))
    lowest = _lowest_of_parabola(
        before, middle, after, grid[k], grid[k + 1], grid[k + 2]
    )
    is_close = lowest < _SHARE_OF_EXTREMUM * middle
    return columns[is_close], grid[k[is_close]], grid[k[is_close] + 2]


def _lowest_of_parabola(
    y0: Array, y1: Array, y2: Array, x0: Array, x1: Array, x2: Array
) -> Array:
    """Returns the least value of each parabola through three points, x ascending."""
    left = (y1 - y0) / (x1 - x0)
    right = (y2 - y1) / (x2 - x1)
    curvature = np.maximum((right - left) / (x2 - x0), 1e-300)
    slope = left + curvature * (x1 - x0)
    # y1 + slope (x - x1) + curvature (x - x1)^2, with the slope at x1.
    return y1 - slope**2 / (4 * curvature)


def _passed_within(
    loci: Loci, columns: Indices, low: Array, high: Array
) -> list[_Interval]:
    """Returns intervals in which loci pass the unit circle, inside of given ones.

    The given ones are swept more and more finely.

    Args:
        loci: The eigenloci.
        columns: The column of each interval (k).
        low: Lower ends of the intervals in rad/s (k).
        high: Upper ends (k).
    """
    intervals = []
    for _ in range(_NUM_EXTREMUM_SWEEPS):
        if not len(columns):
            break
        w = np.geomspace(low, high, _NUM_INNER_POINTS)
        every = np.tile(columns, (_NUM_INNER_POINTS, 1))
        gains = _log_size(loci.at(w.ravel(), every.ravel())).reshape(w.shape)
        is_passed = np.zeros(len(columns), dtype=bool)
        for i, column in enumerate(columns.tolist()):
            found = _passed(gains[:, i : i + 1], w[:, i])
            is_passed[i] = bool(found)
            intervals += [(column, *ends) for _, *ends in found]
        # The points on both sides of the extremum.
        k = 1 + np.abs(gains[1:-1]).argmin(axis=0)
        each = np.arange(len(columns))
        low = w[k - 1, each]
        high = w[k + 1, each]
        is_sure = np.abs(gains[k, each]) > _MAGNITUDE_TOLERANCE
        goes_on = ~is_passed & is_sure & (high > (1 + _FINEST) * low)
        columns, low, high = columns[goes_on], low[goes_on], high[goes_on]
    return intervals


def locate(
    loci: Loci,
    columns: ArrayLike,
    measure: Callable[[ComplexArray], Array],
    low: ArrayLike,
    high: ArrayLike,
) -> tuple[Array, ComplexArray]:
    """Returns frequencies (k) at which a measure passes 0, and the eigenvalues there.

    Eigenvalues of equal magnitude, as those of two axes that are coupled by a rotation,
    pass together. Rounding decides which of them comes first, and differs from one
    frequency to the next. So all of them are read at one frequency, where each column
    has its own.

    Args:
        loci: The eigenloci.
        columns: The column of the eigenlocus in each interval (k).
        measure: A function of eigenvalues, whose sign differs between the two ends of
            each interval.
        low: Lower ends of the intervals in rad/s (k).
        high: Upper ends (k).
    """
    which = np.asarray(columns, dtype=int)
    if not which.size:
        return np.empty(0), np.empty(0, complex)
    found = find_root(
        lambda w, column: measure(loci.at(w, column)), (low, high), args=(which,)
    ).x
    order = np.argsort(found)
    is_new = np.append(True, np.diff(found[order]) > _SAME_FREQUENCY * found[order][1:])
    group = np.empty(len(order), dtype=int)
    group[order] = np.cumsum(is_new) - 1
    frequencies = found[order][is_new]
    return frequencies[group], loci.over(frequencies)[group, which]


def _log_size(values: ComplexArray) -> Array:
    """Returns log |l| of eigenvalues, which is positive outside of the unit circle."""
    return np.log(np.maximum(np.abs(values), 1e-300))


def _phase_to_cross(value: complex) -> float:
    """Returns the phase lag in rad, 0 to 2 pi, that turns a value to -1."""
    phase = float(np.angle(value) + np.pi) % (2 * np.pi)
    # A lag of 0 must not become 2 pi by rounding.
    is_whole_turn = phase > 2 * np.pi * (1 - AXIS_TOLERANCE)
    return 0.0 if is_whole_turn else phase

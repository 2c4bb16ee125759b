"""The frequencies at which the eigenloci of a loop cross the unit circle.

An eigenlocus is an eigenvalue l(j w) of the open loop's frequency response L(j w); see
delay_margin. The frequency is swept, densely around each pole, and each crossing is
located to rounding.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teleop_drake.arrays import Array, ComplexArray, Indices
from teleop_drake.numerics.bisection import find_roots
from teleop_drake.numerics.state_space import StateSpace

AXIS_TOLERANCE = 1e-8
"""The relative distance within which a root counts as on the imaginary axis."""

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
    values = np.linalg.eigvals(response).astype(complex)
    order = np.argsort(-np.abs(values), axis=1, kind="stable")
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
    w, gains = _refine(loci, grid)
    low = []
    high = []
    columns = []
    for column, gain in enumerate(gains.T):
        # With a neutral root |l| tends to 1 as w tends to 0. That is no crossing.
        sure = np.flatnonzero(np.abs(gain) > _MAGNITUDE_TOLERANCE)
        k = np.flatnonzero(np.diff(gain[sure] > 0))
        low += w[sure[k]].tolist()
        high += w[sure[k + 1]].tolist()
        columns += [column] * len(k)
    frequencies, values = locate(loci, columns, _log_size, low, high)
    falls = _log_size(loci.at(np.array(low), np.array(columns, dtype=int))) > 0
    return [
        (
            column,
            Crossing(
                frequency=frequency,
                delay=_phase_to_cross(value) / frequency,
                direction=1 if is_falling else -1,
            ),
        )
        for column, frequency, value, is_falling in zip(
            columns, frequencies.tolist(), values.tolist(), falls, strict=True
        )
    ]


def locate(
    loci: Loci,
    columns: ArrayLike,
    measure: Callable[[ComplexArray], Array],
    low: ArrayLike,
    high: ArrayLike,
) -> tuple[Array, ComplexArray]:
    """Returns frequencies (k) at which a measure passes 0, and the eigenvalues there.

    Args:
        loci: The eigenloci.
        columns: The column of the eigenlocus in each interval (k).
        measure: A function of eigenvalues, whose sign differs between the two ends of
            each interval.
        low: Lower ends of the intervals in rad/s (k).
        high: Upper ends (k).
    """
    which = np.asarray(columns, dtype=int)
    found = find_roots(lambda w: measure(loci.at(w, which)), low, high)
    return found, loci.at(found, which)


def _log_size(values: ComplexArray) -> Array:
    """Returns log |l| of eigenvalues, which is positive outside of the unit circle."""
    return np.log(np.maximum(np.abs(values), 1e-300))


def _phase_to_cross(value: complex) -> float:
    """Returns the phase lag in rad, 0 to 2 pi, that turns a value to -1."""
    phase = float(np.angle(value) + np.pi) % (2 * np.pi)
    # A lag of 0 must not become 2 pi by rounding.
    is_whole_turn = phase > 2 * np.pi * (1 - AXIS_TOLERANCE)
    return 0.0 if is_whole_turn else phase


def _refine(loci: Loci, w: Array) -> tuple[Array, Array]:
    """Returns a refined sweep (K) that resolves close crossings, and log |l| (K, m).

    A locus may cross 1 twice between two frequencies. Its extrema near 1 are therefore
    swept more and more finely.

    Args:
        loci: The eigenloci.
        w: Ascending frequencies in rad/s, to which others are added.
    """
    gains = _log_size(loci.over(w))
    for _ in range(_NUM_EXTREMUM_SWEEPS):
        closest = np.flatnonzero(_are_closest(gains).any(axis=1))
        closest = closest[w[closest + 2] > (1 + _FINEST) * w[closest]]
        if len(closest) == 0:
            break
        low = w[closest]
        high = w[closest + 2]
        added = np.geomspace(low, high, _NUM_INNER_POINTS)[1:-1].ravel()
        w = np.concatenate([w, added])
        gains = np.concatenate([gains, _log_size(loci.over(added))])
        order = np.argsort(w, kind="stable")
        w = w[order]
        gains = gains[order]
    return w, gains


def _are_closest(gains: Array) -> NDArray[np.bool_]:
    """Returns whether each locus is closest to 1 without a crossing (K - 2, m).

    Args:
        gains: log |l| of m loci at K points (K, m); the result leaves out the first and
            the last point.
    """
    size = np.abs(gains)
    here = size[1:-1]
    is_least = here <= np.minimum(size[:-2], size[2:])
    has_passed = np.diff(gains > 0, axis=0)
    is_on_one_side = ~(has_passed[:-1] | has_passed[1:])
    # Where |l| is 1, as next to a neutral root, rounding errors look like extrema.
    is_near = (here > _MAGNITUDE_TOLERANCE) & (here < _NEAR_CROSSING)
    return is_least & is_on_one_side & is_near

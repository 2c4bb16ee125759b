"""The frequencies at which the eigenloci of a loop cross the unit circle.

An eigenlocus is an eigenvalue l(j w) of the frequency response L(j w) of a loop that is
cut open; see delay_margin. The frequency is swept, densely around each pole, and each
crossing is located to the last digit.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teleop_drake.arrays import Array, ComplexArray
from teleop_drake.numerics.bisection import bisect
from teleop_drake.numerics.state_space import StateSpace

AXIS_TOLERANCE = 1e-8
"""Relative accuracy of what counts as on the imaginary axis."""

# A magnitude this close to 1 may be so by rounding.
_MAGNITUDE_TOLERANCE = 1e-10

# Points of the first sweep, and around each pole.
_NUM_SWEEP_POINTS = 2000
_NUM_POLE_POINTS = 80

# Points of each finer sweep around one of them, and how many sweeps find an extremum.
_NUM_INNER_POINTS = 17
_NUM_EXTREMUM_SWEEPS = 12

# An extremum of log |l| farther than this from 0 is no crossing in disguise.
_NEAR_CROSSING = 0.5

# Extrema are located to this share of their frequencies: the magnitude to its square.
_FINEST = 1e-7


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
    """Returns A of the loop det(I + L(s)) = 0, with delays in it, if any, of 0.

    Raises:
        ValueError: If the loop is not well posed without delay.
    """
    return (-loop).opened.closed(np.arange(len(loop.D))).A


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
    # The peak of a pole is as wide as the pole is far from the axis.
    near = poles[poles.imag > low]
    widths = np.maximum(np.abs(near.real), 1e-9 * np.abs(near))
    offsets = np.geomspace(widths / 8, np.abs(near), _NUM_POLE_POINTS)
    around = np.concatenate([near.imag + offsets, near.imag - offsets]).ravel()
    even = np.geomspace(low, high, _NUM_SWEEP_POINTS)
    # np.unique() imports all of numpy.ma.
    result = np.array(sorted({*even.tolist(), *around.tolist()}))
    return result[(result >= low) & (result <= high)]


def _highest_frequency(loop: StateSpace) -> float:
    """Returns the frequency in rad/s from which on |L(j w)| < 1, if |D| < 1.

    It follows from |C (j w - A)^-1 B| <= |B| |C|/(w - |A|).
    """
    gain = float(np.linalg.norm(loop.B) * np.linalg.norm(loop.C))
    feedthrough = float(np.linalg.norm(loop.D, 2)) if loop.D.size else 0.0
    left_over = max(1 - feedthrough, 0.01)
    return 1.01 * (float(np.linalg.norm(loop.A)) + gain / left_over + 1e-3)


def crossings_between(loop: StateSpace, grid: Array) -> list[Crossing]:
    """Returns where the eigenloci of a response cross the unit circle.

    Args:
        grid: Ascending frequencies in rad/s, dense enough for all that it does.
    """
    w, gains = _refine(loop, grid)
    crossings = []
    for locus in range(gains.shape[1]):
        # A neutral root is where |l| tends to 1 for w to 0: no crossing.
        sure = np.flatnonzero(np.abs(gains[:, locus]) > _MAGNITUDE_TOLERANCE)
        is_above = gains[sure, locus] > 0
        k = np.flatnonzero(np.diff(is_above))
        found = locate(
            loop, locus, lambda values: np.abs(values) > 1, w[sure[k]], w[sure[k + 1]]
        )
        for falls, frequency, value in zip(is_above[k], *found, strict=True):
            crossing = Crossing(
                frequency=float(frequency),
                delay=_phase_to_cross(value) / float(frequency),
                direction=1 if falls else -1,
            )
            crossings.append(crossing)
    return crossings


def locate(
    loop: StateSpace,
    locus: int,
    condition: Callable[[ComplexArray], NDArray[np.bool_]],
    low: Array,
    high: Array,
) -> tuple[Array, ComplexArray]:
    """Returns frequencies (k) at which a condition changes, and the eigenvalues there.

    Args:
        locus: Which of the eigenvalues it is about, by descending magnitude.
        condition: Of eigenvalues; it differs at the two ends of each interval.
        low: Lower ends of the intervals in rad/s (k).
        high: Upper ends (k).
    """

    def values_at(frequencies: Array) -> ComplexArray:
        return eigenloci(loop, frequencies)[:, locus].reshape(frequencies.shape)

    at_low = condition(values_at(low))
    found = bisect(lambda w: condition(values_at(w)) == at_low, low, high)
    return found, values_at(found)


def _phase_to_cross(value: complex) -> float:
    """Returns the phase in rad, 0 to 2 pi, by which a delay turns a value to -1."""
    phase = float(np.angle(value) + np.pi) % (2 * np.pi)
    # Rounding must not make a whole turn of none.
    is_whole_turn = phase > 2 * np.pi * (1 - AXIS_TOLERANCE)
    return 0.0 if is_whole_turn else phase


def _gains(loop: StateSpace, frequencies: Array) -> Array:
    """Returns log |l| of all eigenloci (K, m)."""
    return np.log(np.maximum(np.abs(eigenloci(loop, frequencies)), 1e-300))


def _refine(loop: StateSpace, w: Array) -> tuple[Array, Array]:
    """Returns frequencies (K) that show where loci only just cross 1, and _gains().

    Args:
        w: Ascending frequencies in rad/s, of which others are added in between.
    """
    gains = _gains(loop, w)
    for _ in range(_NUM_EXTREMUM_SWEEPS):
        closest = np.flatnonzero(_are_closest(gains).any(axis=1))
        closest = closest[w[closest + 2] > (1 + _FINEST) * w[closest]]
        if len(closest) == 0:
            break
        low = w[closest]
        high = w[closest + 2]
        added = np.geomspace(low, high, _NUM_INNER_POINTS)[1:-1].ravel()
        w = np.concatenate([w, added])
        gains = np.concatenate([gains, _gains(loop, added)])
        order = np.argsort(w, kind="stable")
        w = w[order]
        gains = gains[order]
    return w, gains


def _are_closest(gains: Array) -> NDArray[np.bool_]:
    """Returns where each locus comes closest to 1 without a crossing (K - 2, m).

    Args:
        gains: log |l| at K points; the first and the last one are none of them.
    """
    size = np.abs(gains)
    here = size[1:-1]
    is_least = here <= np.minimum(size[:-2], size[2:])
    has_passed = np.diff(gains > 0, axis=0)
    is_on_one_side = ~(has_passed[:-1] | has_passed[1:])
    # Where |l| is 1, as next to a neutral root, rounding makes extrema of its own.
    is_near = (here > _MAGNITUDE_TOLERANCE) & (here < _NEAR_CROSSING)
    return is_least & is_on_one_side & is_near

"""The frequencies at which the eigenloci of a loop cross the unit circle.

An eigenlocus is an eigenvalue l(j w) of the frequency response L(j w) of a loop that is
cut open; see delay_margin. The frequency is swept, densely around each pole, and each
crossing is located to the last digit.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.arrays import Array, ComplexArray, Indices
from teleop_drake.numerics.bisection import halve
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


def crossings_between(loop: StateSpace, grid: Array) -> list[Crossing]:
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
    loop: StateSpace, grid: Array, gains: Array, locus: int
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
        frequency = _find_crossing(loop, locus, float(w[k]), float(w[k + 1]))
        crossing = Crossing(
            frequency=frequency,
            delay=_phase_to_cross(loop, locus, frequency) / frequency,
            direction=1 if is_above[k] else -1,
        )
        crossings.append(crossing)
    return crossings


def _find_crossing(loop: StateSpace, locus: int, low: float, high: float) -> float:
    """Returns where |l| passes 1 between two frequencies, in rad/s, to the last digit.

    It is on different sides of 1 at the two.
    """

    def is_above(frequency: float) -> bool:
        return bool(_gains(loop, np.array([frequency]))[0, locus] > 0)

    starts_above = is_above(low)
    return halve(lambda frequency: is_above(frequency) == starts_above, low, high)[1]


def _phase_to_cross(loop: StateSpace, locus: int, frequency: float) -> float:
    """Returns the phase in rad, 0 to 2 pi, by which a delay turns l(j w) to -1."""
    value = complex(eigenloci(loop, np.array([frequency]))[0, locus])
    phase = float(np.angle(value) + np.pi) % (2 * np.pi)
    # Rounding must not make a whole turn of none.
    is_whole_turn = phase > 2 * np.pi * (1 - AXIS_TOLERANCE)
    return 0.0 if is_whole_turn else phase


def _gains(loop: StateSpace, frequencies: Array) -> Array:
    """Returns log |l| of all eigenloci (K, m)."""
    return np.log(np.maximum(np.abs(eigenloci(loop, frequencies)), 1e-300))


def _add_extrema(
    loop: StateSpace, w: Array, g: Array, locus: int
) -> tuple[Array, Array]:
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
    loop: StateSpace, locus: int, low: float, high: float, sign: float
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

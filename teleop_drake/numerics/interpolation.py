"""Essentially non-oscillatory (ENO) interpolation of sampled signals.

A polynomial through the samples of an integrator's own steps is as accurate as the
steps themselves, as long as it does not reach across a non-smooth point or a jump. ENO
interpolation grows the stencil of each interval towards the side on which the
divided differences are smaller, and so away from a non-smooth point. A jump is two
samples with the same time, and no stencil reaches across it.

Between a jump and a non-smooth point there may be too few samples for a stencil of the
full order. Then the stencil does reach across the point. A polynomial is therefore
trusted only as far as its Newton series converges: the series ends where its terms fall
no longer. Where they are not small there, the samples do not show what lies between two
of them. The polynomial is then drawn towards the chord until it stays between their
values.

Sources: A. Harten, B. Engquist, S. Osher, S. R. Chakravarthy, "Uniformly high order
accurate essentially non-oscillatory schemes, III", J. Comput. Phys. 71 (1987); for
drawing a polynomial towards values that are safe X. Zhang, C.-W. Shu, "On
maximum-principle-satisfying high order schemes for scalar conservation laws",
J. Comput. Phys. 229 (2010).
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from teleop_drake.machine_code.compiled import CompileLoops
from teleop_drake.numerics.newton_polynomials import (
    CONVERGED,
    NUM_STENCIL_POINTS,
    newton_polynomials,
)

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Table = Array | Sequence[Sequence[Sequence[float]]]

# How many samples on either side of an interval its polynomial may use.
_REACH = NUM_STENCIL_POINTS - 2
_WINDOW = 2 * _REACH + 2

# A step as small as this share of the largest value is no jump.
_ROUNDING = 1e-9


def limited_polynomial(times: Array, values: Array, i: int) -> Array:
    """Returns the ENO polynomials of k signals on [times[i], times[i + 1]].

    They have the Newton form c0 + (t - n0) (c1 + (t - n1) (c2 + ...)), of which each
    has as many terms as can be trusted; see limit_series().

    Args:
        times: (N,) non-decreasing sample times; two equal ones mark a jump. On an
            interval of length 0 the polynomial is the value before the jump.
        values: (N, k) samples.
        i: Index of the interval.

    Returns:
        [n, c], (2, NUM_STENCIL_POINTS, k), the nodes n and the coefficients c; terms
        that a polynomial does not have are zero.
    """
    polynomials = np.zeros((2, NUM_STENCIL_POINTS, values.shape[1]))
    _fit(
        np.ascontiguousarray(times, dtype=float),
        np.ascontiguousarray(values, dtype=float),
        i,
        np.empty(_WINDOW, np.int64),
        np.empty(_WINDOW),
        polynomials,
    )
    return polynomials


def fit_polynomials(
    times: Array,
    values: Array,
    i: int,
    window: Indices,
    numbers: Array,
    polynomials: Array,
) -> None:
    """Writes what limited_polynomial() returns.

    These functions are loops over single numbers, so that typed_code can compile them.

    Args:
        times: See limited_polynomial().
        values: The same.
        i: The same.
        window: Place for indices (2 NUM_STENCIL_POINTS - 2).
        numbers: Place for numbers (the same).
        polynomials: Zeros at first.
    """
    if times[i] == times[i + 1]:
        for j in range(values.shape[1]):
            polynomials[1, 0, j] = values[i, j]
        return
    first = fill_window(times, i, window)
    num_samples = fill_rest(times, i, window) - first
    for j in range(values.shape[1]):
        samples = window[first : first + num_samples]
        fit_series(times, values, i, j, samples, numbers, polynomials)
        limit_series(times, values, i, j, num_samples, numbers, polynomials)


def fill_window(times: Array, i: int, window: Indices) -> int:
    """Selects the samples from which the polynomial of interval i may be built.

    They lie between the jumps on either side, and not closer together than a quarter
    of the interval: polynomials through denser samples would amplify rounding errors.

    Args:
        times: Non-decreasing sample times; two equal ones mark a jump.
        i: Index of the interval [times[i], times[i + 1]], of length > 0.
        window: Where the ascending indices of the samples go, that of i in the middle;
            here those up to i.

    Returns:
        Where in the window the first one is.
    """
    spacing = (times[i + 1] - times[i]) / 4
    first = _REACH
    window[first] = i
    nearest = times[i]
    j = i - 1
    while j >= 0 and first > 0 and times[j] < times[j + 1]:
        if nearest - times[j] >= spacing:
            first -= 1
            window[first] = j
            nearest = times[j]
        j -= 1
    return first


def fill_rest(times: Array, i: int, window: Indices) -> int:
    """Does the same from i + 1 on; returns where in the window they end."""
    spacing = (times[i + 1] - times[i]) / 4
    end = _REACH + 2
    window[end - 1] = i + 1
    nearest = times[i + 1]
    j = i + 2
    while j < len(times) and end < len(window) and times[j - 1] < times[j]:
        if times[j] - nearest >= spacing:
            window[end] = j
            end += 1
            nearest = times[j]
        j += 1
    return end


def fit_series(
    times: Array,
    values: Array,
    i: int,
    j: int,
    samples: Indices,
    differences: Array,
    polynomials: Array,
) -> None:
    """Writes the ENO polynomial of signal j, in full.

    Args:
        times: See limited_polynomial().
        values: The same.
        i: The same, of an interval of length > 0.
        j: Index of the signal.
        samples: Indices of the samples that may be used.
        differences: Place for a number for each of them.
        polynomials: The result.
    """
    num_samples = len(samples)
    left = 0
    for m in range(num_samples):
        differences[m] = values[samples[m], j]
        if samples[m] == i:
            left = m
    polynomials[0, 0, j] = times[i]
    polynomials[1, 0, j] = values[i, j]
    for order in range(1, min(num_samples, NUM_STENCIL_POINTS)):
        for m in range(num_samples - order):
            gap = times[samples[m + order]] - times[samples[m]]
            differences[m] = (differences[m + 1] - differences[m]) / gap
        # The first one makes the line through both ends of the interval.
        if (
            left > 0
            and order > 1
            and (
                left + order == num_samples
                or abs(differences[left - 1]) < abs(differences[left])
            )
        ):
            left -= 1
            polynomials[0, order, j] = times[samples[left]]
        else:
            polynomials[0, order, j] = times[samples[left + order]]
        polynomials[1, order, j] = differences[left]


def limit_series(
    times: Array,
    values: Array,
    i: int,
    j: int,
    num_samples: int,
    terms: Array,
    polynomials: Array,
) -> None:
    """Leaves of the polynomial of signal j as much as can be trusted.

    With T_m a bound of the m-th term on the interval, the series ends with M where
    max(T_(M-1), T_M) falls no longer (two terms, because one may vanish by symmetry).
    Unless that is small against the largest term, the terms from the second order on
    are scaled by

        |values[i + 1] - values[i]| / (4 sum T_m)

    where that is less than 1: then the polynomial stays between the two values.

    Args:
        times: See limited_polynomial().
        values: The same.
        i: The same, of an interval of length > 0.
        j: Index of the signal.
        num_samples: How many could be used.
        terms: Place for a number for each term.
        polynomials: Of fit_series().
    """
    begin, end = times[i], times[i + 1]
    num_terms = min(num_samples, NUM_STENCIL_POINTS)
    # |(t - begin) (t - end)| and every further factor are largest at an end or in the
    # middle.
    factor = (end - begin) * (end - begin) / 4
    for m in range(2, NUM_STENCIL_POINTS):
        terms[m] = abs(polynomials[1, m, j]) * factor
        node = polynomials[0, m, j]
        factor *= max(abs(begin - node), abs(end - node))
    last = min(3, num_terms - 1)
    remainder = max(terms[2], terms[3])
    for m in range(4, num_terms):
        pair = max(terms[m - 1], terms[m])
        if not pair <= remainder:
            break
        last = m
        remainder = pair
    largest, total = 0.0, 0.0
    for m in range(2, last + 1):
        largest = max(largest, terms[m])
        total += terms[m]
    for m in range(last + 1, NUM_STENCIL_POINTS):
        polynomials[1, m, j] = 0.0
    if remainder > CONVERGED * largest:
        deviation = 4 * total
        change = abs(values[i + 1, j] - values[i, j])
        if change < deviation:
            for m in range(2, last + 1):
                polynomials[1, m, j] *= change / deviation


_fit = CompileLoops(fit_polynomials)


def evaluate_newton(polynomials: Table, t: float) -> Array:
    """Returns the values (k) of polynomials at t.

    Args:
        polynomials: As limited_polynomial() returns them, an array or nested lists.
        t: A time.
    """
    nodes, coefficients = polynomials[0], polynomials[1]
    result = np.empty(len(nodes[0]))
    for j in range(len(result)):
        value = coefficients[-1][j]
        for m in range(len(nodes) - 2, -1, -1):
            value = coefficients[m][j] + (t - nodes[m][j]) * value
        result[j] = value
    return result


class IntervalPolynomial:
    """The ENO polynomial of a vector signal on [times[i], times[i + 1]].

    Args:
        times: (N,) non-decreasing sample times; two equal ones mark a jump.
        values: (N, k) samples.
        i: Index of the interval.
    """

    def __init__(self, times: Array, values: Array, i: int):
        # Python is faster with lists.
        self._polynomials: Table = limited_polynomial(times, values, i).tolist()

    def eval(self, t: float) -> Array:
        """Returns the signal (k) at a time.

        Args:
            t: The time.
        """
        return evaluate_newton(self._polynomials, t)


def find_crossing(
    times: Array, values: Array, i: int, is_beyond: Callable[[Array], bool]
) -> float:
    """Returns when a vector signal crosses a boundary, by bisection.

    Args:
        times: (N,) non-decreasing sample times; two equal ones mark a jump.
        values: (N, k) samples.
        i: Index of the interval with the crossing.
        is_beyond: Whether a value is on the side of sample i + 1.
    """
    begin, end = float(times[i]), float(times[i + 1])
    if begin == end:
        return end
    polynomial = IntervalPolynomial(times, values, i)
    while begin < (middle := (begin + end) / 2) < end:
        if is_beyond(polynomial.eval(middle)):
            end = middle
        else:
            begin = middle
    return end


def interpolate(
    times: np.ndarray,
    values: np.ndarray,
    query_times: np.ndarray,
    *,
    is_cautious: bool = True,
) -> np.ndarray:
    """Interpolates a recorded signal.

    Two equal times at which no value jumps end a polynomial only if there are samples
    enough on both sides. A recording has such a pair wherever any of its signals jumps:
    at each packet, for example.

    Args:
        times: (N,) non-decreasing sample times; equal neighbours mark a jump.
        values: (N, k) samples.
        query_times: (M,) non-decreasing times; clamped to the recorded span. At a
            jump the value before it is returned.
        is_cautious: Whether a polynomial that cannot be trusted is drawn towards the
            chord; else it is a parabola.

    Returns:
        (M, k) interpolated values.
    """
    times, values = _without_still_pairs(times, values)
    query_times = np.clip(query_times, times[0], times[-1])
    interval = np.clip(np.searchsorted(times, query_times) - 1, 0, len(times) - 2)
    used, polynomial = np.unique(interval, return_inverse=True)
    nodes, coefficients = newton_polynomials(times, values, used, is_cautious)
    result = np.zeros((len(query_times), values.shape[1]))
    for n, c in zip(nodes[::-1], coefficients[::-1], strict=True):
        result = c[polynomial] + (query_times[:, np.newaxis] - n[polynomial]) * result
    return result


def _without_still_pairs(times: Array, values: Array) -> tuple[Array, Array]:
    """Returns the samples; of a pair without a jump, beside few samples, only one."""
    first = np.flatnonzero(times[1:] == times[:-1])
    if len(first) == 0:
        return times, values
    sizes = np.diff(np.concatenate([[-1], first, [len(times) - 1]]))
    has_few = np.minimum(sizes[:-1], sizes[1:]) < NUM_STENCIL_POINTS
    step = np.abs(values[first + 1] - values[first])
    is_still = (step <= _ROUNDING * np.abs(values).max(axis=0)).all(axis=1)
    is_kept = np.ones(len(times), bool)
    is_kept[first[has_few & is_still]] = False
    return times[is_kept], values[is_kept]

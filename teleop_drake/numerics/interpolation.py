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

from teleop_drake.machine_code.compiled import compiled, is_python
from teleop_drake.numerics.newton_polynomials import (
    CONVERGED,
    NUM_STENCIL_POINTS,
    newton_polynomials,
)

Array = NDArray[np.float64]
Table = Array | Sequence[Sequence[Sequence[float]]]


def stencil_window(times: Array, i: int) -> tuple[NDArray[np.int64], int]:
    """Selects the samples from which the polynomial of interval i may be built.

    They lie between the jumps on either side, and not closer together than a quarter
    of the interval: polynomials through denser samples would amplify rounding errors.

    Args:
        times: Non-decreasing sample times; two equal ones mark a jump.
        i: Index of the interval [times[i], times[i + 1]], of length > 0.

    Returns:
        The ascending indices of the samples, and the place of i among them.
    """
    spacing = (times[i + 1] - times[i]) / 4
    reach = NUM_STENCIL_POINTS - 2
    indices = np.empty(2 * reach + 2, np.int64)
    first = reach
    nearest = times[i]
    j = i - 1
    while j >= 0 and first > 0 and times[j] < times[j + 1]:
        if nearest - times[j] >= spacing:
            first -= 1
            indices[first] = j
            nearest = times[j]
        j -= 1
    indices[reach], indices[reach + 1] = i, i + 1
    end = reach + 2
    nearest = times[i + 1]
    j = i + 2
    while j < len(times) and end < len(indices) and times[j - 1] < times[j]:
        if times[j] - nearest >= spacing:
            indices[end] = j
            end += 1
            nearest = times[j]
        j += 1
    return indices[first:end], reach - first


def newton_polynomial(times: Array, values: Array, i: int) -> Array:
    """Returns the ENO polynomials of k signals on [times[i], times[i + 1]].

    They have the Newton form c0 + (t - n0) (c1 + (t - n1) (c2 + ...)).

    Args:
        times: (N,) non-decreasing sample times; two equal ones mark a jump.
        values: (N, k) samples.
        i: Index of the interval, of length > 0.

    Returns:
        [n, c], (2, NUM_STENCIL_POINTS, k), the nodes n and the coefficients c; terms
        that a polynomial does not have are zero.
    """
    window, i = stencil_window(times, i)
    times, values = times[window], values[window]
    N, k = values.shape
    polynomials = np.zeros((2, NUM_STENCIL_POINTS, k))
    nodes, coefficients = polynomials[0], polynomials[1]
    nodes[0], coefficients[0] = times[i], values[i]
    left = np.full(k, i)
    differences = values
    for order in range(1, min(N, NUM_STENCIL_POINTS)):
        gaps = times[order:] - times[:-order]
        differences = (differences[1:] - differences[:-1]) / gaps[:, np.newaxis]
        for j in range(k):
            # The first one makes the line through both ends of the interval.
            can_grow_left = left[j] > 0 and order > 1
            if can_grow_left and (
                left[j] + order == N
                or abs(differences[left[j] - 1, j]) < abs(differences[left[j], j])
            ):
                left[j] -= 1
                nodes[order, j] = times[left[j]]
            else:
                nodes[order, j] = times[left[j] + order]
            coefficients[order, j] = differences[left[j], j]
    return polynomials


def limited_polynomial(times: Array, values: Array, i: int) -> Array:
    """Returns newton_polynomial(), of each signal as much as can be trusted.

    With T_m a bound of the m-th term on the interval, the series ends with M where
    max(T_(M-1), T_M) falls no longer (two terms, because one may vanish by symmetry).
    Unless that is small against the largest term, the terms from the second order on
    are scaled by

        |values[i + 1] - values[i]| / (4 sum T_m)

    where that is less than 1: then the polynomial stays between the two values. On an
    interval of length 0 it is the value before the jump.

    Args:
        times: (N,) non-decreasing sample times; two equal ones mark a jump.
        values: (N, k) samples.
        i: Index of the interval.

    Returns:
        [n, c], (2, NUM_STENCIL_POINTS, k), the nodes n and the coefficients c.
    """
    k = values.shape[1]
    if times[i] == times[i + 1]:
        constant = np.zeros((2, NUM_STENCIL_POINTS, k))
        constant[1, 0] = values[i]
        return constant
    polynomials = newton_polynomial(times, values, i)
    nodes, coefficients = polynomials[0], polynomials[1]
    begin, end = times[i], times[i + 1]
    num_terms = min(stencil_window(times, i)[0].size, NUM_STENCIL_POINTS)
    terms = np.zeros(NUM_STENCIL_POINTS)
    for j in range(k):
        # |(t - begin) (t - end)| and every further factor are largest at an end or
        # in the middle.
        factor = (end - begin) * (end - begin) / 4
        for m in range(2, NUM_STENCIL_POINTS):
            terms[m] = abs(coefficients[m, j]) * factor
            factor *= max(abs(begin - nodes[m, j]), abs(end - nodes[m, j]))
        last = min(3, num_terms - 1)
        remainder = terms[2:4].max()
        for m in range(4, num_terms):
            pair = max(terms[m - 1], terms[m])
            if not pair <= remainder:
                break
            last, remainder = m, pair
        coefficients[last + 1 :, j] = 0
        if remainder > CONVERGED * terms[: last + 1].max():
            deviation = 4 * terms[2 : last + 1].sum()
            change = abs(values[i + 1, j] - values[i, j])
            if change < deviation:
                coefficients[2 : last + 1, j] *= change / deviation
    return polynomials


def evaluate_newton(polynomials: Table, t: float) -> Array:
    """Returns the values (k) of polynomials at t.

    Args:
        polynomials: As newton_polynomial() returns them, an array or nested lists.
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
        polynomials = compiled(limited_polynomial)(times, values, i)
        self._evaluate = compiled(evaluate_newton)
        self._polynomials: Table = polynomials
        if is_python(self._evaluate):
            # Python itself is faster with lists.
            self._evaluate = evaluate_newton
            self._polynomials = polynomials.tolist()

    def eval(self, t: float) -> Array:
        """Returns the signal (k) at a time.

        Args:
            t: The time.
        """
        value: Array = self._evaluate(self._polynomials, t)
        return value


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
    times: np.ndarray, values: np.ndarray, query_times: np.ndarray
) -> np.ndarray:
    """Interpolates a recorded signal.

    Args:
        times: (N,) non-decreasing sample times; equal neighbours mark a jump.
        values: (N, k) samples.
        query_times: (M,) non-decreasing times; clamped to the recorded span. At a
            jump the value before it is returned.

    Returns:
        (M, k) interpolated values.
    """
    query_times = np.clip(query_times, times[0], times[-1])
    interval = np.clip(np.searchsorted(times, query_times) - 1, 0, len(times) - 2)
    used, polynomial = np.unique(interval, return_inverse=True)
    nodes, coefficients = newton_polynomials(times, values, used)
    result = np.zeros((len(query_times), values.shape[1]))
    for n, c in zip(nodes[::-1], coefficients[::-1], strict=True):
        result = c[polynomial] + (query_times[:, np.newaxis] - n[polynomial]) * result
    return result

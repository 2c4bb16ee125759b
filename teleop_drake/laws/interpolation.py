"""Essentially non-oscillatory (ENO) interpolation of sampled signals.

A polynomial through the samples of an integrator's own steps is as accurate as the
steps themselves, as long as it does not reach across a kink or a jump. ENO
interpolation grows the stencil of each interval towards the side on which the
divided differences are smaller, and so away from a kink; a jump is two samples with
the same time, and no stencil reaches across it.

Source: A. Harten, B. Engquist, S. Osher, S. R. Chakravarthy, "Uniformly high order
accurate essentially non-oscillatory schemes, III", J. Comput. Phys. 71 (1987).
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from teleop_drake.laws.compiled import compiled

# Eight points: the error of a smooth signal is O(step^8), well below that of the
# fifth-order integrator which made the samples.
NUM_STENCIL_POINTS = 8

Array = NDArray[np.float64]
Table = Array | Sequence[Sequence[float]]


def stencil_window(times: Sequence[float], i: int) -> tuple[list[int], int]:
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
    left: list[int] = []
    nearest = times[i]
    j = i - 1
    while j >= 0 and len(left) < NUM_STENCIL_POINTS - 2 and times[j] < times[j + 1]:
        if nearest - times[j] >= spacing:
            left.append(j)
            nearest = times[j]
        j -= 1
    right: list[int] = []
    nearest = times[i + 1]
    j = i + 2
    while (
        j < len(times)
        and len(right) < NUM_STENCIL_POINTS - 2
        and times[j - 1] < times[j]
    ):
        if times[j] - nearest >= spacing:
            right.append(j)
            nearest = times[j]
        j += 1
    return [*reversed(left), i, i + 1, *right], len(left)


def newton_polynomial(times: Array, values: Array, i: int) -> tuple[Array, Array]:
    """Returns the ENO polynomials of k signals on [times[i], times[i + 1]].

    They have the Newton form c0 + (t - n0) (c1 + (t - n1) (c2 + ...)).

    Args:
        times: (N,) sample times, all different (a smooth window, see stencil_window).
        values: (N, k) samples.
        i: Index of the interval.

    Returns:
        Nodes n and coefficients c, (m, k) each, m = min(N, NUM_STENCIL_POINTS).
    """
    N, k = values.shape
    nodes = np.empty((min(N, NUM_STENCIL_POINTS), k))
    coefficients = np.empty_like(nodes)
    nodes[0], coefficients[0] = times[i], values[i]
    left = np.full(k, i)
    differences = values
    for order in range(1, len(nodes)):
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
    return nodes, coefficients


def evaluate_newton(nodes: Table, coefficients: Table, t: float) -> Array:
    """Returns the values (k) of polynomials at t.

    Args:
        nodes: As newton_polynomial() returns them, an array or nested lists.
        coefficients: Likewise.
        t: A time.
    """
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
        times: Non-decreasing sample times.
        values: One sample (k) for each time.
        i: Index of the interval, of length > 0.
    """

    def __init__(self, times: Sequence[float], values: Table, i: int):
        indices, place = stencil_window(times, i)
        nodes, coefficients = compiled(newton_polynomial)(
            np.array([times[j] for j in indices]),
            np.array([values[j] for j in indices]),
            place,
        )
        self._evaluate = compiled(evaluate_newton)
        self._nodes: Table = nodes
        self._coefficients: Table = coefficients
        if self._evaluate is evaluate_newton:
            # Python itself is faster with lists.
            self._nodes, self._coefficients = nodes.tolist(), coefficients.tolist()

    def Eval(self, t: float) -> Array:
        """Returns the signal (k) at a time.

        Args:
            t: The time.
        """
        return self._evaluate(self._nodes, self._coefficients, t)


def find_crossing(
    times: Sequence[float],
    values: Table,
    i: int,
    is_beyond: Callable[[Array], bool],
) -> float:
    """Returns when a vector signal crosses a border, by bisection.

    Args:
        times: Non-decreasing sample times.
        values: One sample (k) for each time.
        i: Index of the interval with the crossing.
        is_beyond: Whether a value is on the side of sample i + 1.
    """
    begin, end = times[i], times[i + 1]
    if begin == end:
        return end
    polynomial = IntervalPolynomial(times, values, i)
    while begin < (middle := (begin + end) / 2) < end:
        if is_beyond(polynomial.Eval(middle)):
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
    result = np.empty((len(query_times), values.shape[1]))
    interval = np.clip(np.searchsorted(times, query_times) - 1, 0, len(times) - 2)
    time_list, query_list = times.tolist(), query_times.tolist()
    bounds = np.flatnonzero(np.diff(interval, prepend=-1, append=-1))
    for begin, end in pairwise(bounds):
        i = int(interval[begin])
        if time_list[i] == time_list[i + 1]:
            result[begin:end] = values[i]
            continue
        polynomial = IntervalPolynomial(time_list, values, i)
        for row in range(begin, end):
            result[row] = polynomial.Eval(query_list[row])
    return result

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
from typing import TypeVar

import numpy as np

# Eight points: the error of a smooth signal is O(step^8), well below that of the
# fifth-order integrator which made the samples.
NUM_STENCIL_POINTS = 8

Time = TypeVar("Time", float, np.ndarray)
Newton = tuple[tuple[float, ...], tuple[float, ...]]


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


def newton_polynomial(
    times: Sequence[float], values: Sequence[float], i: int
) -> Newton:
    """Returns the ENO polynomial of one signal on [times[i], times[i + 1]].

    Args:
        times: Sample times, all different (one smooth window, see stencil_window).
        values: One value for each time.
        i: Index of the interval.

    Returns:
        (nodes, coefficients) of the Newton form
        c0 + (t - n0) (c1 + (t - n1) (c2 + ...)).
    """
    nodes = [times[i], times[i + 1]]
    differences: Sequence[float] = [
        (values[j + 1] - values[j]) / (times[j + 1] - times[j])
        for j in range(len(times) - 1)
    ]
    coefficients = [values[i], differences[i]]
    left = i
    for order in range(2, min(NUM_STENCIL_POINTS, len(times))):
        differences = [
            (differences[j + 1] - differences[j]) / (times[j + order] - times[j])
            for j in range(len(times) - order)
        ]
        can_grow_right = left + order < len(times)
        if left > 0 and (
            not can_grow_right or abs(differences[left - 1]) < abs(differences[left])
        ):
            left -= 1
            nodes.append(times[left])
        else:
            nodes.append(times[left + order])
        coefficients.append(differences[left])
    return tuple(nodes), tuple(coefficients)


def evaluate_newton(polynomial: Newton, t: Time) -> Time:
    """Returns the value at t, or at each of an array of times.

    Args:
        polynomial: As newton_polynomial() returns it.
        t: A time or an array of times.
    """
    nodes, coefficients = polynomial
    value = 0.0 * t + coefficients[-1]
    for k in range(len(coefficients) - 2, -1, -1):
        value = coefficients[k] + (t - nodes[k]) * value
    return value


def interval_polynomials(
    times: Sequence[float], values: Sequence[Sequence[float]], i: int
) -> list[Newton]:
    """Returns the ENO polynomials of a vector signal on [times[i], times[i + 1]].

    Args:
        times: Non-decreasing sample times; two equal ones mark a jump.
        values: One sample (k) for each time.
        i: Index of the interval, of length > 0.

    Returns:
        One polynomial for each of the k components.
    """
    indices, place = stencil_window(times, i)
    window = [times[j] for j in indices]
    return [
        newton_polynomial(window, component, place)
        for component in zip(*[values[j] for j in indices], strict=True)
    ]


def find_crossing(
    times: Sequence[float],
    values: Sequence[Sequence[float]],
    i: int,
    is_beyond: Callable[[list[float]], bool],
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
    polynomials = interval_polynomials(times, values, i)
    while begin < (middle := (begin + end) / 2) < end:
        if is_beyond([evaluate_newton(p, middle) for p in polynomials]):
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
    time_list, value_list = times.tolist(), values.tolist()
    bounds = np.flatnonzero(np.diff(interval, prepend=-1, append=-1))
    for begin, end in pairwise(bounds):
        i = int(interval[begin])
        if time_list[i] == time_list[i + 1]:
            result[begin:end] = values[i]
            continue
        polynomials = interval_polynomials(time_list, value_list, i)
        for k, polynomial in enumerate(polynomials):
            result[begin:end, k] = evaluate_newton(polynomial, query_times[begin:end])
    return result

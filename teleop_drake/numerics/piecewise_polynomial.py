"""Vectors that are polynomials of time, piece after piece."""

import math

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.arrays import Array


def evaluate_pieces(time: float, breaks: Array, coefficients: Array) -> Array:
    """Returns the value at a time (n); zero before the first break and from the last.

    Args:
        breaks: (K + 1,) ascending; piece k reaches from breaks[k] to breaks[k + 1].
        coefficients: (K, d + 1, n); piece k is the sum of coefficients[k, i]
            (t - breaks[k])^i.
    """
    value = np.zeros(coefficients.shape[2])
    k = np.searchsorted(breaks, time, side="right") - 1
    if k < 0 or k >= coefficients.shape[0]:
        return value
    since = time - breaks[k]
    for i in range(coefficients.shape[1] - 1, -1, -1):
        value = value * since + coefficients[k, i]
    return value


def linear_pieces(times: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    """Returns breaks and coefficients of straight lines between values.

    Args:
        times: (K + 1,) ascending.
        values: (K + 1, n) at the times.
    """
    breaks = np.array(times, dtype=float)
    nodes = np.array(values, dtype=float)
    slopes = np.diff(nodes, axis=0) / np.diff(breaks)[:, np.newaxis]
    return breaks, np.stack([nodes[:-1], slopes], axis=1)


def minimum_jerk_pieces(times: ArrayLike, points: ArrayLike) -> tuple[Array, Array]:
    """Returns the path of least jerk through points: its breaks and coefficients.

    Of all paths from rest to rest that are at the points at the times, it has the least
    integral of the squared third derivative. It is a quintic polynomial between two
    points; its derivatives up to the fourth are continuous (Flash and Hogan, "The
    coordination of arm movements", J. Neuroscience 5, 1985).

    Args:
        times: (K + 1,) ascending.
        points: (K + 1, n).

    Returns:
        The breaks (K + 1,) and coefficients (K, 6, n) of the position.
    """
    from scipy.interpolate import make_interp_spline  # It takes half a second.

    breaks = np.array(times, dtype=float)
    nodes = np.array(points, dtype=float)
    # At rest, without acceleration, at both ends. Time is scaled, so that the powers of
    # a short or long piece do not spoil it.
    at_rest = [(order, np.zeros(nodes.shape[1])) for order in (1, 2)]
    scale = np.mean(np.diff(breaks))
    spline = make_interp_spline(breaks / scale, nodes, k=5, bc_type=(at_rest, at_rest))
    coefficients = [
        spline(breaks[:-1] / scale, order) / (math.factorial(order) * scale**order)
        for order in range(6)
    ]
    return breaks, np.stack(coefficients, axis=1)


def differentiate_pieces(coefficients: Array) -> Array:
    """Returns the coefficients (K, d, n) of the derivative.

    Args:
        coefficients: (K, d + 1, n).
    """
    orders = np.arange(1.0, coefficients.shape[1])
    return coefficients[:, 1:] * orders[np.newaxis, :, np.newaxis]


def largest_norm(breaks: Array, coefficients: Array) -> float:
    """Returns the largest Euclidean norm of the value.

    Args:
        breaks: (K + 1,), all finite.
        coefficients: (K, d + 1, n).
    """
    largest = 0.0
    for length, piece in zip(np.diff(breaks), coefficients, strict=True):
        square = np.polynomial.Polynomial([0.0])
        for axis in piece.T:
            square = square + np.polynomial.Polynomial(axis) ** 2
        roots = square.deriv().roots()
        candidates = np.clip([0.0, length, *roots.real], 0.0, length)
        largest = max(largest, float(square(candidates).max()))
    return float(np.sqrt(largest))

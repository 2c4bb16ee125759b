"""Vector-valued piecewise polynomials of time."""

import math

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array


def evaluate_pieces(time: float, breaks: Array, coefficients: Array) -> Array:
    """Returns the value at a time (n); zero before the first break and from the last.

    Args:
        time: The time t.
        breaks: The breaks (K + 1,), ascending; piece k reaches from breaks[k] to
            breaks[k + 1].
        coefficients: The coefficients (K, d + 1, n); piece k is the sum over i of
            coefficients[k, i] (t - breaks[k])^i.
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
    """Returns breaks (K + 1,) and coefficients (K, 2, n) of a linear interpolation.

    Args:
        times: The times of the values (K + 1,), ascending.
        values: The values (K + 1, n).
    """
    breaks = np.array(times, dtype=float)
    nodes = np.array(values, dtype=float)
    slopes = np.diff(nodes, axis=0) / np.diff(breaks)[:, np.newaxis]
    return breaks, np.stack([nodes[:-1], slopes], axis=1)


def minimum_jerk_pieces(times: ArrayLike, points: ArrayLike) -> tuple[Array, Array]:
    """Returns the path of least jerk through points at given times.

    Among all paths from rest to rest through these points it has the smallest integral
    of the squared third derivative. It is a quintic polynomial between two points, and
    its derivatives up to the fourth are continuous (Flash and Hogan, "The coordination
    of arm movements", J. Neuroscience 5, 1985).

    Args:
        times: The times of the points (K + 1,), ascending.
        points: The points (K + 1, n).

    Returns:
        The breaks (K + 1,) and coefficients (K, 6, n) of the position.
    """
    # The import takes half a second and is deferred until it is needed.
    from scipy.interpolate import make_interp_spline

    breaks = np.array(times, dtype=float)
    nodes = np.array(points, dtype=float)
    # Velocity and acceleration are 0 at both ends. Time is scaled, so that powers of
    # short or long times do not spoil the accuracy.
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
        coefficients: The coefficients of the polynomials (K, d + 1, n).
    """
    orders = np.arange(1.0, coefficients.shape[1])
    return coefficients[:, 1:] * orders[np.newaxis, :, np.newaxis]


def largest_norm(breaks: Array, coefficients: Array) -> float:
    """Returns the largest Euclidean norm of a piecewise polynomial.

    Args:
        breaks: The breaks (K + 1,), all finite.
        coefficients: The coefficients (K, d + 1, n).
    """
    # The maximum of each piece is at an end or at a stationary point of the square.
    largest = 0.0
    for length, piece in zip(np.diff(breaks), coefficients, strict=True):
        square = np.polynomial.Polynomial([0.0])
        for axis in piece.T:
            square = square + np.polynomial.Polynomial(axis) ** 2
        roots = square.deriv().roots()
        candidates = np.clip([0.0, length, *roots.real], 0.0, length)
        largest = max(largest, float(square(candidates).max()))
    return float(np.sqrt(largest))

"""Piecewise polynomials: values, the path of least jerk, and its closed form."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose

from teleop_drake.model.laws.piecewise_polynomial import (
    differentiate_pieces,
    evaluate_pieces,
    largest_norm,
    linear_pieces,
    minimum_jerk_pieces,
)


def test_values_between_before_and_after():
    breaks, lines = linear_pieces([1.0, 2.0, 4.0], [[0.0, 1.0], [2.0, 1.0], [2.0, 5.0]])
    values = {
        t: evaluate_pieces(t, breaks, lines).tolist() for t in (0.9, 1, 1.5, 2, 3)
    }
    assert values == {
        0.9: [0, 0],
        1: [0, 1],
        1.5: [1, 1],
        2: [2, 1],
        3: [2, 3],
    }
    assert evaluate_pieces(4.0, breaks, lines).tolist() == [0, 0]
    assert largest_norm(breaks, lines) == pytest.approx(np.hypot(2, 5))


def test_one_piece_is_the_polynomial_of_flash_and_hogan():
    breaks, path = minimum_jerk_pieces([0.0, 0.4], [[0.0], [0.3]])
    for s in np.linspace(0, 0.999, 7):
        expected = 0.3 * (10 * s**3 - 15 * s**4 + 6 * s**5)
        assert evaluate_pieces(0.4 * s, breaks, path)[0] == pytest.approx(expected)
    # The peak speed of the path is 15/8 of its mean speed.
    speed = largest_norm(breaks, differentiate_pieces(path))
    assert speed == pytest.approx(15 / 8 * 0.3 / 0.4)


def _SquaredJerk(breaks, coefficients):
    """Returns the integral of the squared third derivative."""
    total = 0.0
    for length, piece in zip(np.diff(breaks), coefficients, strict=True):
        for axis in piece.T:
            square = (Polynomial(axis).deriv(3) ** 2).integ()
            total += square(length)
    return total


def test_no_path_through_the_points_has_less_jerk():
    times = np.array([0.0, 0.5, 1.7, 2.0])
    points = np.array([[0.0, 0.0], [0.1, 0.3], [0.5, 0.1], [0.4, 0.0]])
    breaks, path = minimum_jerk_pieces(times, points)
    for k, point in enumerate(points[:-1]):
        assert_allclose(evaluate_pieces(times[k], breaks, path), point)
    least = _SquaredJerk(breaks, path)
    # A variation that vanishes at all points and is at rest at both ends:
    # t^3 (t - 0.5) (t - 1.7) (t - 2)^3, a polynomial of degree 8.
    bump = Polynomial.fromroots([0, 0, 0, 0.5, 1.7, 2, 2, 2])
    for share in (-1e-2, 1e-3):
        other = np.zeros((3, 9, 2))
        other[:, :6] = path
        for k in range(3):
            other[k, :, 0] += share * bump(Polynomial([times[k], 1.0])).coef
        change = _SquaredJerk(breaks, other) - least
        own = _SquaredJerk(breaks, other - np.pad(path, ((0, 0), (0, 3), (0, 0))))
        # The path is stationary: the change is that of the bump without the path, which
        # is of second order.
        assert change == pytest.approx(own, rel=1e-6)
        assert change > 0

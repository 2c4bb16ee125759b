"""Tests of numerics.differences."""

import numpy as np
import pytest

from teleop_drake.numerics.differences import differentiate


def test_jacobian_and_its_error():
    x0, steps = np.array([0.3, -0.7]), np.array([0.1, 0.05])

    def function(x):
        return np.array([np.sin(x[0]) * x[1], np.exp(x[1]), x[0] ** 3])

    jacobian, error, bend = differentiate(function, x0, steps)
    exact = [
        [np.cos(0.3) * -0.7, np.sin(0.3)],
        [0.0, np.exp(-0.7)],
        [3 * 0.3**2, 0.0],
    ]
    assert jacobian == pytest.approx(np.array(exact), abs=1e-12)
    assert np.all(np.abs(jacobian - exact) <= error + 1e-14)
    assert error.max() < 1e-9 and bend.max() < 1e-9


def test_bend_is_the_difference_of_both_slopes():
    _, _, bend = differentiate(np.abs, np.zeros(1), np.array([0.1]))
    assert bend[0, 0] == pytest.approx(2.0)


def test_nothing_to_differentiate_by():
    shapes = [
        part.shape for part in differentiate(lambda _: np.ones(3), np.ones(0), [])
    ]
    assert shapes == [(3, 0)] * 3

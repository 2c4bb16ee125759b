"""Tests of numerics.differences."""

import numpy as np
from numpy.testing import assert_allclose

from teleop_drake.loops.numerics.differences import differentiate


def test_jacobian():
    x0 = np.array([0.3, -0.7])
    steps = np.array([0.1, 0.05])

    def function(x):
        return np.array([np.sin(x[0]) * x[1], np.exp(x[1]), x[0] ** 3])

    exact = [
        [np.cos(0.3) * -0.7, np.sin(0.3)],
        [0.0, np.exp(-0.7)],
        [3 * 0.3**2, 0.0],
    ]
    jacobian = differentiate(function, x0, steps)
    assert_allclose(jacobian, exact, atol=1e-12)

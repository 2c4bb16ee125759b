"""State-space realisations against the rational function."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.model.laws.transfer_function import (
    all_pass_of_delay,
    low_frequency_resistance,
    realize_transfer_function,
)

POINTS = [1.0, -0.3, 2.0 + 1.0j, 40.0j, -7.0 + 0.1j]


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [
        ([25, 50], [1, 25, 0]),
        ([0, 0, 25, 50], [1, 25, 0]),
        ([3], [2, 1, 5, 7]),
        ([4, 3, 2, 1], [2, 5, 7, 11]),
        ([6], [4]),
        ([0], [1, 1]),
    ],
)
@pytest.mark.parametrize("num_axes", [1, 3])
def test_realisation_has_the_transfer_function(numerator, denominator, num_axes):
    A, B, C, D = realize_transfer_function(numerator, denominator, num_axes=num_axes)
    order = len(denominator) - 1
    assert A.shape == (num_axes * order, num_axes * order)
    for s in POINTS:
        H = C @ np.linalg.solve(s * np.eye(len(A)) - A, B) + D
        expected = np.polyval(numerator, s) / np.polyval(denominator, s)
        assert_allclose(H, expected * np.eye(num_axes), atol=1e-13)


def test_states_of_one_axis_stand_together():
    A, B, _, _ = realize_transfer_function([25, 50], [1, 25, 0], num_axes=2)
    assert_array_equal(A, [[0, 1, 0, 0], [0, -25, 0, 0], [0, 0, 0, 1], [0, 0, 0, -25]])
    assert_array_equal(B, [[0, 0], [1, 0], [0, 0], [0, 1]])


@pytest.mark.parametrize(
    ("numerator", "denominator", "num_axes", "message"),
    [
        ([1, 2, 3], [1, 2], 1, "numerator = .*must be of degree 1 at most"),
        ([1], [0, 1], 1, "denominator = .*whose first coefficient is not zero"),
        ([1], [], 1, "denominator = .*must be a vector"),
        ([[1]], [1], 1, "numerator = .*must be a vector"),
        ([1], [1, float("nan")], 1, "denominator = .*must be finite"),
        ([float("inf")], [1, 1], 1, "numerator = .*must be finite"),
        ([1], [1, 1], 0, "num_axes = 0: must be a finite number >= 1"),
    ],
)
def test_bad_arguments(numerator, denominator, num_axes, message):
    with pytest.raises(ValueError, match=message):
        realize_transfer_function(numerator, denominator, num_axes=num_axes)


def test_low_frequency_resistance():
    # 2/s + 23/(s + 25) = 2/s + 0.92 + O(s).
    assert low_frequency_resistance([25, 50], [1, 25, 0]) == pytest.approx(0.92)
    assert low_frequency_resistance([3, 8], [1, 4]) == pytest.approx(2.0)
    assert low_frequency_resistance([5.0], [1.0]) == 5.0
    assert low_frequency_resistance([2, 3, 4], [1, 0]) == pytest.approx(3.0)
    with pytest.raises(ValueError, match="denominator"):
        low_frequency_resistance([1.0], [0.0])


def test_all_pass_of_a_delay(subtests):
    A, B, C, D = all_pass_of_delay(0.3, order=6, num_axes=2)
    # The error of the Pade approximant grows with |s| delay; at 6 it is 0.11 %.
    for w, bound in ((0.5, 1e-14), (5.0, 1e-10), (15.0, 4e-5), (20.0, 1.2e-3)):
        with subtests.test(w=w):
            H = C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) + D
            error = np.abs(H - np.exp(-0.3j * w) * np.eye(2)).max()
            assert error < bound
            assert np.isclose(abs(H[0, 0]), 1.0)
    assert np.abs(A).max() < 30 / 0.3
    with pytest.raises(ValueError, match="order = 3: must be even"):
        all_pass_of_delay(0.3, order=3)

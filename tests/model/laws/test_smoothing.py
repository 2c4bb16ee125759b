"""The smoothed derivative of samples."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from teleop_drake.model.laws.smoothing import (
    SAMPLES_PER_CYCLE,
    kernel_width,
    smoothed_derivative,
)

PERIOD = 0.01
TIMES = PERIOD * np.arange(600)


def test_a_straight_line_has_its_slope_everywhere():
    values = np.column_stack([2.0 + 3.0 * TIMES, -TIMES])
    slopes = smoothed_derivative(values, PERIOD, 4.0)
    assert_allclose(slopes, np.tile([3.0, -1.0], (600, 1)), atol=1e-12)


@pytest.mark.parametrize("bandwidth", [1.0, 4.0, 1 / PERIOD / SAMPLES_PER_CYCLE])
@pytest.mark.parametrize("frequency", [0.5, 1.0, 4.0])
def test_the_gain_is_that_of_a_gaussian(frequency, bandwidth):
    """Of a sine the convolution with a Gaussian is the sine times its transform."""
    w = 2 * math.pi * frequency
    gain = math.exp(-math.log(2) / 2 * (frequency / bandwidth) ** 2)
    slopes = smoothed_derivative(np.sin(w * TIMES)[:, np.newaxis], PERIOD, bandwidth)
    middle = slice(200, 400)  # Far from both ends.
    expected = w * gain * np.cos(w * TIMES)
    error = np.abs(slopes[middle, 0] - expected[middle]).max()
    assert error < 1e-4 * w * gain + 2e-3 * w * (bandwidth > 10)


def test_the_gain_at_the_bandwidth():
    width = kernel_width(4.0)
    assert math.exp(-((2 * math.pi * 4.0 * width) ** 2) / 2) == pytest.approx(0.5**0.5)


def test_noise_is_smoothed():
    """The variance of white noise is the sum of the squares of the weights."""
    noise = np.random.default_rng(1).normal(size=(20000, 1))
    measured = smoothed_derivative(noise, PERIOD, 4.0)[100:-100].std()
    s = kernel_width(4.0)
    expected = math.sqrt(PERIOD / (4 * math.sqrt(math.pi) * s**3))
    assert measured == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_a_few_samples(count):
    values = np.arange(count, dtype=float)[:, np.newaxis]
    assert smoothed_derivative(values, 0.5, 0.1).ravel().tolist() == [2.0] * count

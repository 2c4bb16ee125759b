"""Tests of polynomials in arrays against those of one interval after another."""

import numpy as np

from teleop_drake.numerics.interpolation import limited_polynomial
from teleop_drake.numerics.newton_polynomials import newton_polynomials


def test_polynomials_in_arrays_are_those_of_each_interval():
    """Bit for bit: with jumps, with samples in clusters, and with nonsmooth points."""
    rng = np.random.default_rng(0)
    for num_samples in (2, 3, 9, 60, 400):
        steps = rng.choice([1e-9, 1e-3, 0.1, 0.25, 1.0], num_samples)
        steps *= 1 + 0.1 * rng.choice([0, 1]) * rng.normal(size=num_samples) ** 2
        steps[rng.random(num_samples) < 0.1] = 0
        times = np.cumsum(steps)
        values = np.stack([np.sin(times), np.abs(times - times.mean())], axis=1)
        values[rng.random(num_samples) < 0.2] += 0.1
        intervals = np.arange(num_samples - 1)
        together = newton_polynomials(times, values, intervals)
        for i in intervals:
            one = limited_polynomial(times, values, i)
            np.testing.assert_array_equal(together[:, :, i], one)

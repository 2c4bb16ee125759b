"""Derivatives of sampled signals, smoothed with a stated bandwidth."""

import math

import numpy as np

from teleop_drake.loops.framework.arrays import Array

SAMPLES_PER_CYCLE = 2 * math.pi / math.sqrt(math.log(2))
"""The least rate of samples, in multiples of the bandwidth: sigma is one step."""

# The kernel reaches so many of its widths to either side, where it is 1e-11.
_REACH = 7


def kernel_width(bandwidth: float) -> float:
    """Returns the width sigma in s of the Gaussian that has a bandwidth in Hz.

    At the bandwidth its gain, exp(-(2 pi f sigma)^2 / 2), is 1/sqrt(2).
    """
    return math.sqrt(math.log(2)) / (2 * math.pi * bandwidth)


def smoothed_derivative(values: Array, period: float, bandwidth: float) -> Array:
    """Returns the derivative of samples, convolved with a Gaussian (N, n).

    There is no delay: the Gaussian is symmetric. A straight line has exactly its slope.
    Beyond both ends the samples are continued by point reflection.

    Args:
        values: Samples at equal distances (N, n).
        period: Their distance, s.
        bandwidth: The frequency in Hz at which the gain is 1/sqrt(2), at most
            1/period/SAMPLES_PER_CYCLE.
    """
    width = kernel_width(bandwidth) / period
    reach = min(math.ceil(_REACH * width), len(values) - 1)
    k = np.arange(-reach, reach + 1.0)
    gaussian = np.exp(-0.5 * (k / width) ** 2)
    # The weights of a straight line add up to its slope.
    weights = k * gaussian / np.sum(k**2 * gaussian)
    before = 2 * values[0] - values[reach:0:-1]
    behind = 2 * values[-1] - values[-2 : -2 - reach : -1]
    extended = np.concatenate([before, values, behind])
    slopes = [np.convolve(axis, weights[::-1], "valid") for axis in extended.T]
    return np.stack(slopes, axis=1) / period

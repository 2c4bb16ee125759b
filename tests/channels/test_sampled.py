"""Tests of the packet delay."""

import math

import numpy as np
import pytest
from pydrake.systems.primitives import (
    DiscreteTimeDelay,
)
from sources import Ramp

from teleop_drake.channels.sampled import SampledDelay


@pytest.mark.parametrize(
    ("delay", "h"), [(0.1, 0.01), (0.1, 0.03), (0.1, 0.1), (0.123, 0.02), (1 / 3, 0.05)]
)
def test_packets_arrive_one_delay_after_they_were_sent(delay, h):
    ramp = Ramp(
        SampledDelay(delay=delay, sample_period=h, size=2, initial_value=[-1.0, -2.0])
    )
    for time in np.arange(0.00713, 1.0, 0.0137):
        newest = math.floor((time - delay) / h + 1e-9)
        expected = np.array([1.0, 2.0]) * (newest * h if newest >= 0 else -1.0)
        np.testing.assert_allclose(ramp.Output(time), expected, atol=1e-12)


@pytest.mark.parametrize(("delay", "h"), [(0.1, 0.01), (0.1, 0.05), (0.13, 0.05)])
def test_mean_delay_is_half_a_period_longer(delay, h):
    """(n + 1/2) h for delay = n h: the mean of t - delayed_signal(t) over periods."""
    ramp = Ramp(SampledDelay(delay=delay, sample_period=h, size=2))
    begin, end = delay + h, delay + 11 * h
    mean_time = (begin + end) / 2
    mean_signal = (-ramp.Integral(begin) + ramp.Integral(end)) / (end - begin)
    assert mean_time - mean_signal[0] == pytest.approx(delay + h / 2, abs=1e-9)


def test_agrees_with_drakes_discrete_time_delay():
    ours = Ramp(SampledDelay(delay=0.15, sample_period=0.05, size=2))
    drakes = Ramp(DiscreteTimeDelay(0.05, 3, 2))
    for time in np.arange(0.011, 1.0, 0.02):
        np.testing.assert_allclose(ours.Output(time), drakes.Output(time), atol=1e-12)

"""Tests of the packet delay."""

import math

import numpy as np
import pytest
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

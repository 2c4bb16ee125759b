"""Tests of the packet delay."""

import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
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


def test_zero_delay_is_a_pass_through():
    dut = SampledDelay(delay=0.0, sample_period=0.01, size=2)
    assert dut.HasDirectFeedthrough(0, 0)
    np.testing.assert_allclose(Ramp(dut).Output(0.777), [0.777, 1.554])


def test_no_feedthrough():
    dut = SampledDelay(delay=0.1, sample_period=0.01, size=2)
    assert not dut.HasDirectFeedthrough(0, 0)


def test_cloned_context_continues_identically():
    ramp = Ramp(SampledDelay(delay=0.13, sample_period=0.05, size=2))
    ramp.Output(0.5)
    clone = ramp.simulator.get_context().Clone()
    expected = ramp.Output(0.9)
    other = Simulator(ramp.simulator.get_system(), clone)
    other.AdvanceTo(0.9)
    port = ramp.dut.get_output_port()
    np.testing.assert_array_equal(
        port.Eval(ramp.dut.GetMyContextFromRoot(clone)), expected
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"delay": -1.0}, "delay = -1.0: must"),
        ({"delay": math.nan}, "delay = nan: must"),
        ({"sample_period": 0.2}, "sample_period = 0.2: must be at most the delay"),
        ({"sample_period": 0.0}, "sample_period = 0.0: must"),
        ({"sample_period": math.nan}, "sample_period = nan: must"),
        ({"size": 0}, "size = 0: must"),
        ({"initial_value": [0.0, 0.0]}, "initial_value = .*: must be 1 number"),
    ],
)
def test_bad_parameters(arguments, message):
    defaults = {"delay": 0.1, "sample_period": 0.01, "size": 1}
    with pytest.raises(ValueError, match=message):
        SampledDelay(**(defaults | arguments))


def test_nothing_jumps_without_delay():
    block = SampledDelay(delay=0.0, sample_period=0.01, size=1)
    assert block.NextJumpTime(block.CreateDefaultContext()) == math.inf

"""Sampled channels: packets at a fixed rate, each held until the next one."""

import math

import pytest

from teleop_drake.channels import SampledChannelConfig
from teleop_drake.channels.sampled import MAX_PACKETS, CheckSamplePeriod, SampledDelay
from teleop_drake.validation import ScenarioError


def test_held_samples_are_half_a_period_older():
    channel = SampledChannelConfig(delay=0.1, sample_period=0.02)
    result = channel.AsConstantDelay("return_channel", 20.0)
    assert result.delay == pytest.approx(0.11)
    assert "return_channel: packets are held for 0.02 s" in result.note


def test_without_delay_nothing_is_sampled():
    channel = SampledChannelConfig(delay=0.0, sample_period=0.02)
    channel.Check("return_channel", 20.0)
    nothing = channel.AsConstantDelay("return_channel", 20.0)
    assert nothing.delay == 0 and nothing.note is None
    assert channel.IsPassThrough()
    block = channel.MakeChannel(size=1, initial_value=[0.0])
    assert block.HasAnyDirectFeedthrough()


def test_the_solver_stops_at_packets_and_steps_as_it_likes():
    channel = SampledChannelConfig(delay=0.1, sample_period=0.02)
    assert channel.PacketPeriod() == 0.02
    assert channel.LongestStep(20.0) == math.inf
    assert not channel.IsPassThrough()
    block = channel.MakeChannel(size=1, initial_value=[0.0])
    assert isinstance(block, SampledDelay)
    assert not block.HasAnyDirectFeedthrough()


def test_packets_are_not_rarer_than_the_delay_is_long():
    channel = SampledChannelConfig(delay=0.1, sample_period=0.2)
    message = "return_channel.sample_period = 0.2: must be at most the delay, 0.1"
    with pytest.raises(ScenarioError, match=message):
        channel.Check("return_channel", 20.0)


def test_no_more_packets_are_under_way_than_memory_holds():
    CheckSamplePeriod("channel", 10.0 / MAX_PACKETS, 10.0)
    with pytest.raises(ScenarioError, match=r"channel.sample_period = 9e-05: must be"):
        CheckSamplePeriod("channel", 9.0 / MAX_PACKETS, 10.0)

"""Transport channels: an exact delay, or none."""

import math

from teleop_drake.channels import TransportChannelConfig
from teleop_drake.channels.base import ConstantDelay
from teleop_drake.channels.transport import TransportDelay


def test_it_is_its_own_constant_delay():
    channel = TransportChannelConfig(delay=0.1)
    expected = ConstantDelay(delay=0.1)
    assert channel.AsConstantDelay("return_channel", 20.0) == expected
    assert expected.note is None


def test_no_step_is_longer_than_the_delay():
    channel = TransportChannelConfig(delay=0.1)
    assert channel.LongestStep(20.0) == 0.1
    assert channel.PacketPeriod() == math.inf
    assert not channel.IsPassThrough()


def test_without_delay_it_passes_through():
    channel = TransportChannelConfig(delay=0.0)
    assert channel.IsPassThrough()
    assert channel.LongestStep(20.0) == math.inf
    block = channel.MakeChannel(size=2, initial_value=[1.0, 2.0])
    assert isinstance(block, TransportDelay)
    assert block.HasAnyDirectFeedthrough()


def test_the_initial_value_arrives_first():
    channel = TransportChannelConfig(delay=0.1)
    block = channel.MakeChannel(size=2, initial_value=[1.0, 2.0])
    context = block.CreateDefaultContext()
    output = block.GetOutputPort("delayed_signal").Eval(context)
    assert output.tolist() == [1.0, 2.0]

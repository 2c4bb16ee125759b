"""Variable channels: what a linear analysis and the solver are told."""

import math

import numpy as np
import pytest

from teleop_drake.channels import VariableChannelConfig
from teleop_drake.channels.delay_profile import Sinusoid
from teleop_drake.channels.variable import VariableDelay
from teleop_drake.validation import ScenarioError


def test_the_constant_delay_is_its_mean():
    """Half a period of a sine has the mean 2/pi; a drift adds half of what it has."""
    sinusoid = Sinusoid(amplitude=0.03, frequency=math.pi / 20)
    channel = VariableChannelConfig(delay=0.1, sinusoid=sinusoid, drift=0.001)
    result = channel.AsConstantDelay("return_channel", 20.0)
    assert result.delay == pytest.approx(0.1 + 0.03 * 2 / math.pi + 0.01, rel=1e-6)
    assert "return_channel: the delay varies from 0.1 to 0.14" in result.note


def test_no_step_is_longer_than_the_least_delay():
    channel = VariableChannelConfig(delay=0.1, sinusoid=Sinusoid(amplitude=0.04))
    channel.Check("channel", 20.0)
    assert channel.LongestStep(20.0) == pytest.approx(0.06)
    assert channel.PacketPeriod() == math.inf
    assert not channel.IsPassThrough()
    block = channel.MakeChannel(size=1, initial_value=[3.0], duration=20.0)
    assert isinstance(block, VariableDelay)
    assert block.longest_step == pytest.approx(0.06)
    output = block.GetOutputPort("delayed_signal").Eval(block.CreateDefaultContext())
    np.testing.assert_array_equal(output, [3.0])


def test_there_has_to_be_a_delay():
    with pytest.raises(ScenarioError, match=r"channel.delay = 0.0: must be such that"):
        VariableChannelConfig(delay=0.0).Check("channel", 20.0)

"""What the kinds whose delay varies have in common: the profile of their fields."""

import math

import pytest

from teleop_drake.channels import NetworkChannelConfig, VariableChannelConfig
from teleop_drake.channels.delay_profile import Sinusoid
from teleop_drake.validation import ScenarioError


@pytest.mark.parametrize("kind", ["variable", "network"])
def test_the_profile_is_that_of_the_fields(kind, tmp_path):
    channel = {
        "variable": VariableChannelConfig(delay=0.2),
        "network": NetworkChannelConfig(delay=0.2, sample_period=0.01),
    }[kind]
    assert channel.Profile(3.0)(1.5) == 0.2
    assert channel.LargestSlope(3.0) == 0.0
    channel.drift = 0.01
    channel.sinusoid = Sinusoid(amplitude=0.05, frequency=2.0, phase=1.0)
    trace = tmp_path / "trace.csv"
    trace.write_text("5,0.1\n6,0.2\n8,0.4\n")
    channel.trace = str(trace)
    expected = 0.2 + 0.015 + 0.05 * math.sin(4.0) + 0.25
    assert channel.Profile(3.0)(1.5) == pytest.approx(expected, abs=1e-13)
    assert channel.LargestSlope(3.0) == pytest.approx(0.01 + 0.1 + 0.1)
    with pytest.raises(ScenarioError, match="at least as long as the duration, 4 s"):
        channel.Profile(4.0, "return_channel")
    channel.sinusoid.amplitude = 0.5
    with pytest.raises(ScenarioError, match=r"^return_channel.delay = 0.2: must be"):
        channel.Profile(3.0, "return_channel")


def test_what_arrives_was_sent_a_delay_before():
    """t - T(t) of the arrivals t are the times of sending."""
    channel = VariableChannelConfig(delay=0.2)
    channel.sinusoid = Sinusoid(amplitude=0.05, frequency=2.0, phase=1.0)
    sent = [0.0, 0.7, 1.1, 2.5]
    arrivals = channel.Arrivals(sent, 3.0)
    T = channel.Profile(3.0)
    assert [t - T(t) for t in arrivals] == pytest.approx(sent, abs=1e-6)
    # After the end the delay stays as it is.
    assert channel.Arrivals([3.0], 3.0) == pytest.approx(3.0 + T(3.0))

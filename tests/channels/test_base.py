"""What a channel of one's own gets from the base, and what the base refuses."""

import math
from dataclasses import dataclass

import pytest
from pydrake.systems.primitives import PassThrough

from teleop_drake.channels.base import SHORTEST_TIME, ChannelConfig, ConstantDelay
from teleop_drake.validation import ScenarioError


@dataclass(kw_only=True, eq=False)
class Wire(ChannelConfig):
    kind = "wire"

    def MakeChannel(self, *, size, initial_value, duration=math.inf, stream=""):
        return PassThrough(size)


def test_nothing_is_asked_of_the_solver():
    wire = Wire(delay=0.3)
    wire.Check("forward_channel", 1.0)
    assert wire.LongestStep(1.0) == wire.PacketPeriod() == math.inf
    assert wire.LargestSlope(1.0) == 0.0
    assert not wire.IsPassThrough()
    assert not wire.draws_random_numbers and not wire.has_packet_statistics
    assert wire.AsConstantDelay("forward_channel", 1.0) == ConstantDelay(delay=0.3)


def test_what_is_sent_arrives_a_delay_later():
    assert Wire(delay=0.3).Arrivals([0.0, 1.5], 2.0).tolist() == [0.3, 1.8]


def test_it_has_to_make_a_block():
    with pytest.raises(TypeError, match="abstract"):
        ChannelConfig()


@pytest.mark.parametrize("delay", [0.0, SHORTEST_TIME, 10.0])
def test_delays_that_are_allowed(delay):
    Wire(delay=delay).Check("channel", 1.0)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"delay": -0.1},
            "channel.delay = -0.1: must be 0 or a finite number >= 1e-06",
        ),
        ({"delay": SHORTEST_TIME / 2}, "channel.delay = 5e-07: must be 0 or a finite"),
        ({"delay": math.inf}, "channel.delay = inf: must be 0 or a finite number"),
        ({"delay": math.nan}, "channel.delay = nan: must be 0 or a finite number"),
        ({"seed": -1}, "channel.seed = -1: must be a whole number >= 0"),
    ],
)
def test_what_is_refused(fields, message):
    with pytest.raises(ScenarioError, match=message):
        Wire(**fields).Check("channel", 1.0)

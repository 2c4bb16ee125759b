"""Configs of channels: what a linear analysis, the solver and pictures are told."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from pydrake.systems.primitives import PassThrough

from teleop_drake.loops.delays.base import MAX_PACKETS, SHORTEST_TIME
from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_options import Jitter, Loss, Receiver
from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.delays.variable import Sinusoid, VariableDelay
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.channels.base import ChannelConfig
from teleop_drake.model.channels.network import NetworkChannelConfig
from teleop_drake.model.channels.sampled import SampledChannelConfig
from teleop_drake.model.channels.transport import TransportChannelConfig
from teleop_drake.model.channels.variable import VariableChannelConfig

DURATION = 20.0


@dataclass(kw_only=True, eq=False)
class Wire(ChannelConfig):
    """A channel of one's own, which takes what the base says."""

    kind = "wire"

    def MakeChannel(self, *, size, initial_value, duration=math.inf, stream=""):
        return PassThrough(size)


def Network(**fields):
    return NetworkChannelConfig(**({"delay": 0.1, "sample_period": 0.02} | fields))


def Deep(**jitter):
    """With a buffer that is deep enough, so that the jitter does not matter."""
    receiver = Receiver(policy="playout", depth=0.05)
    return Network(sample_period=0.01, receiver=receiver, jitter=Jitter(**jitter))


WAVE = VariableChannelConfig(
    delay=0.1, sinusoid=Sinusoid(amplitude=0.03, frequency=math.pi / 20), drift=0.001
)
# By channel: the longest step, the time between packets, whether it passes through, the
# constant delay in its place, and of the note about that.
TOLD = [
    (Wire(delay=0.3), math.inf, math.inf, False, 0.3, None),
    (TransportChannelConfig(delay=0.1), 0.1, math.inf, False, 0.1, None),
    (TransportChannelConfig(delay=0.0), math.inf, math.inf, True, 0.0, None),
    # Half a period of a sine has the mean 2/pi; a drift adds half of what it has.
    (WAVE, 0.07, math.inf, False, 0.11 + 0.06 / math.pi, "varies from 0.1 to 0.14"),
    (SampledChannelConfig(delay=0.1, sample_period=0.02),
     math.inf, 0.02, False, 0.11, "held for 0.02 s"),
    (SampledChannelConfig(delay=0.0, sample_period=0.02),
     math.inf, 0.02, True, 0.0, None),
    (Network(), math.inf, 0.02, False, 0.11, "mean age"),
    (Network(delay=0.0), math.inf, 0.02, False, 0.01, "mean age"),
    (Deep(), math.inf, 0.01, False, 0.155, "mean age"),
    (Deep(kind="uniform", std=0.01), math.inf, 0.01, False, 0.155, "mean age"),
    # Of a stream with independent losses p the mean age is
    # d + h (1 + p)/(2 (1 - p)): the mean square over twice the mean of a geometric
    # interval.
    (Network(loss=Loss(kind="independent", probability=0.3)),
     math.inf, 0.02, False, 0.1 + 0.01 * 1.3 / 0.7, "mean age"),
]  # fmt: skip


@pytest.mark.parametrize(("config", "step", "period", "passes", "delay", "note"), TOLD)
def test_what_others_are_told(config, step, period, passes, delay, note):
    config.Check("return_channel", DURATION)
    assert config.LongestStep(DURATION) == pytest.approx(step)
    assert config.PacketPeriod() == period
    assert config.IsPassThrough() == passes
    is_network = isinstance(config, NetworkChannelConfig)
    assert config.draws_random_numbers == config.has_packet_statistics == is_network
    told = config.AsConstantDelay("return_channel", DURATION)
    assert told.delay == pytest.approx(delay, rel=5e-3 if is_network else 1e-6)
    assert told.note is None if note is None else note in told.note
    assert note is None or told.note.startswith("return_channel: ")


@pytest.mark.parametrize(
    ("config", "block_type"),
    [
        (TransportChannelConfig(delay=0.1), TransportDelay),
        (VariableChannelConfig(delay=0.1), VariableDelay),
        (SampledChannelConfig(delay=0.1, sample_period=0.02), SampledDelay),
        (Network(), NetworkDelay),
    ],
)
def test_the_block_delivers_the_initial_value_first(config, block_type):
    block = config.MakeChannel(size=2, initial_value=[1.0, 2.0], duration=DURATION)
    assert isinstance(block, block_type)
    assert not block.HasAnyDirectFeedthrough()
    context = block.CreateDefaultContext()
    output = block.GetOutputPort("delayed_signal").Eval(context)
    assert output.tolist() == [1.0, 2.0]
    config.delay = 0.0
    if config.IsPassThrough():
        block = config.MakeChannel(size=2, initial_value=[1.0, 2.0])
        assert block.HasAnyDirectFeedthrough()


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (Wire(delay=SHORTEST_TIME / 2), ".delay = 5e-07: must be 0 or a finite"),
        (Wire(delay=math.inf), ".delay = inf: must be 0 or a finite number"),
        (Wire(seed=-1), ".seed = -1: must be a whole number >= 0"),
        (VariableChannelConfig(delay=0.0), ".delay = 0.0: must be such that"),
        (SampledChannelConfig(delay=0.1, sample_period=0.2),
         ".sample_period = 0.2: must be at most the delay, 0.1"),
        (SampledChannelConfig(delay=9.0, sample_period=8.9 / MAX_PACKETS),
         ".sample_period = 8.9"),
    ],
)  # fmt: skip
def test_what_is_refused(config, message):
    with pytest.raises(ScenarioError) as error:
        config.Check("channel", DURATION)
    assert str(error.value).startswith(f"channel{message}")


@pytest.mark.parametrize(
    "config",
    [
        Wire(delay=SHORTEST_TIME),
        SampledChannelConfig(delay=9.0, sample_period=9.0 / MAX_PACKETS),
    ],
)
def test_what_is_just_allowed(config):
    config.Check("channel", DURATION)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"receiver": Receiver(policy="extrapolate")},
         r"return_channel.receiver.policy = 'extrapolate': must be newest"),
        ({"loss": Loss(kind="independent", probability=1.0)},
         "return_channel: must deliver a packet within the duration, 20 s"),
    ],
)  # fmt: skip
def test_what_is_no_constant_delay(fields, message):
    with pytest.raises(ScenarioError, match=message):
        Network(**fields).AsConstantDelay("return_channel", DURATION)


def test_arrivals():
    assert Wire(delay=0.3).Arrivals([0.0, 1.5], 2.0).tolist() == [0.3, 1.8]
    # t - T(t) of the arrivals t are the times of sending.
    sent = [0.0, 0.7, 1.1, 2.5]
    T = WAVE.Profile(3.0)
    arrivals = WAVE.Arrivals(sent, 3.0)
    assert [t - T(t) for t in arrivals] == pytest.approx(sent, abs=1e-6)
    # After the end the delay stays as it is.
    assert WAVE.Arrivals([3.0], 3.0) == pytest.approx(3.0 + T(3.0))


def test_arrivals_of_packets_are_those_of_the_stream():
    """Of those that are sent nearest to a time; what is lost never arrives."""
    jitter = Jitter(kind="uniform", std=0.01)
    channel = Network(jitter=jitter, loss=Loss(kind="independent", probability=0.3))
    forward, back, again = (
        channel.Network(DURATION, stream=name) for name in ("forward", "back", "back")
    )
    assert back.Arrivals(50).tolist() == again.Arrivals(50).tolist()
    assert back.Arrivals(50).tolist() != forward.Arrivals(50).tolist()
    numbers = [0, 3, 500, 999]
    arrivals = channel.Arrivals([k * 0.02 + 0.004 for k in numbers], DURATION, "back")
    assert arrivals.tolist() == [back.Arrival(k) for k in numbers]
    many = channel.Arrivals([k * 0.02 for k in range(900)], DURATION)
    assert 0.2 < np.isinf(many).mean() < 0.4


@pytest.mark.parametrize(
    "channel", [VariableChannelConfig(delay=0.2), Network(delay=0.2)]
)
def test_the_profile_is_that_of_the_fields(channel, tmp_path):
    assert channel.Profile(3.0)(1.5) == 0.2
    assert channel.LargestSlope(3.0) == 0.0
    channel.drift = 0.01
    channel.sinusoid = Sinusoid(amplitude=0.05, frequency=2.0, phase=1.0)
    trace = tmp_path / "trace.csv"
    trace.write_text("time_s,delay_s\n5,0.1\n6,0.2\n8,0.4\n")
    channel.trace = str(trace)
    expected = 0.2 + 0.015 + 0.05 * math.sin(4.0) + 0.25
    assert channel.Profile(3.0)(1.5) == pytest.approx(expected, abs=1e-13)
    assert channel.LargestSlope(3.0) == pytest.approx(0.01 + 0.1 + 0.1)
    with pytest.raises(ScenarioError, match="at least as long as the duration, 4 s"):
        channel.Profile(4.0, "return_channel")
    channel.sinusoid.amplitude = 0.5
    with pytest.raises(ScenarioError, match=r"^return_channel.delay = 0.2: must be"):
        channel.Profile(3.0, "return_channel")

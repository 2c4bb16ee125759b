"""Network channels: what a linear analysis and the solver are told."""

import math

import numpy as np
import pytest

from teleop_drake.channels.network import NetworkDelay
from teleop_drake.scenario import LoadScenario, ScenarioError

DURATION = 20.0


def Channel(**fields):
    channel = {"kind": "network", "delay": 0.1} | fields
    scenario = LoadScenario(
        "one_dof", {"return_channel": channel, "duration": DURATION}
    )
    return scenario.return_channel


def Delay(**fields):
    return Channel(**fields).AsConstantDelay("return_channel", DURATION)


def test_the_solver_stops_at_packets_and_steps_as_it_likes():
    channel = Channel(sample_period=0.02)
    assert channel.PacketPeriod() == 0.02
    assert channel.LongestStep(DURATION) == math.inf
    assert (
        not channel.IsPassThrough()
        and not Channel(sample_period=0.02, delay=0.0).IsPassThrough()
    )
    assert channel.draws_random_numbers and channel.has_packet_statistics


def test_the_block_has_the_network_of_its_stream():
    channel = Channel(sample_period=0.02, jitter={"kind": "uniform", "std": 0.01})
    blocks = [
        channel.MakeChannel(size=2, initial_value=[1.0, 2.0], duration=1.0, stream=name)
        for name in ("forward_channel", "return_channel")
    ]
    assert all(isinstance(block, NetworkDelay) for block in blocks)
    networks = [
        channel.Network(1.0, stream=name).Arrivals(50).tolist()
        for name in ("forward_channel", "return_channel", "return_channel")
    ]
    assert networks[0] != networks[1] == networks[2]


@pytest.mark.parametrize(
    ("receiver", "jitter", "expected"),
    [
        ({}, {}, 0.105),
        ({"policy": "playout", "depth": 0.05}, {}, 0.155),
        # Every packet is shown in time, so the jitter does not matter.
        (
            {"policy": "playout", "depth": 0.05},
            {"kind": "uniform", "std": 0.01},
            0.155,
        ),
    ],
)
def test_network_is_its_mean_age(receiver, jitter, expected):
    result = Delay(sample_period=0.01, receiver=receiver, jitter=jitter)
    assert result.delay == pytest.approx(expected, rel=1e-3)
    assert "mean age" in result.note


def test_loss_makes_older():
    """Of a stream with independent losses p the mean age is d + h (1 + p)/(2 (1 - p)):
    the mean square over twice the mean of a geometric interval."""
    p, h = 0.3, 0.01
    result = Delay(
        sample_period=h,
        loss={"kind": "independent", "probability": p},
    )
    expected = 0.1 + h / 2 * (1 + p) / (1 - p)
    assert result.delay == pytest.approx(expected, abs=5e-4)


@pytest.mark.parametrize(
    ("channel", "message"),
    [
        (
            {"receiver": {"policy": "extrapolate"}},
            r"return_channel.receiver.policy = 'extrapolate': must be newest",
        ),
        (
            {"loss": {"kind": "independent", "probability": 1.0}},
            "return_channel: must deliver a packet within the duration, 20 s",
        ),
    ],
)
def test_refuses(channel, message):
    with pytest.raises(ScenarioError, match=message):
        Delay(sample_period=0.01, **channel)


def test_arrivals_are_those_of_the_packets():
    """Of those that are sent nearest to a time; what is lost never arrives."""
    channel = Channel(
        sample_period=0.02,
        jitter={"kind": "uniform", "std": 0.01},
        loss={"kind": "independent", "probability": 0.3},
    )
    network = channel.Network(DURATION, stream="return_channel")
    numbers = [0, 3, 500, 999]
    arrivals = channel.Arrivals(
        [k * 0.02 + 0.004 for k in numbers], DURATION, "return_channel"
    )
    assert arrivals.tolist() == [network.Arrival(k) for k in numbers]
    many = channel.Arrivals([k * 0.02 for k in range(900)], DURATION)
    assert 0.2 < np.isinf(many).mean() < 0.4

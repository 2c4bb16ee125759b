"""Tests of network channels whose times between packets differ."""

import numpy as np
import pytest
import sources

from teleop_drake import simulate
from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Jitter, Loss, Receiver
from teleop_drake.loops.delays.packet_statistics import ComputePacketStatistics
from teleop_drake.loops.delays.variable import DelayProfile
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.channels.network import NetworkChannelConfig
from teleop_drake.model.scenario import LoadScenario

PERIODS = [0.03, 0.05, 0.082]
SENT = np.cumsum([0.0, *PERIODS * 10])
POLICIES = ["newest", "playout", "extrapolate"]


def Network(delay=0.07, **arguments):
    return PacketNetwork(
        profile=DelayProfile(delay=delay, duration=1.5),
        sample_period=np.mean(PERIODS),
        periods=np.array(PERIODS * 10),
        **arguments,
    )


def Expected(network, receiver, time):
    """Returns the output for the ramp (t, 2 t), by looking at every packet."""
    count = np.searchsorted(SENT, time + 1e-12)
    shown = [network.Shown(k, receiver) for k in range(count)]
    come = [k for k, at in enumerate(shown) if at <= time]
    if not come:
        return np.array([-1.0, -2.0])
    newest = max(come)
    has_slope = any(shown[k] < shown[newest] for k in range(newest))
    stamp = SENT[newest]
    if receiver.policy == "extrapolate" and has_slope:
        stamp += time - shown[newest]
    return stamp * np.array([1.0, 2.0])


def Ramp(network, receiver):
    block = NetworkDelay(
        network=network, receiver=receiver, size=2, initial_value=[-1.0, -2.0]
    )
    return sources.Ramp(block)


def test_packets_are_sent_at_the_times_of_the_list():
    network = Network()
    assert network.SentTimes(8) == pytest.approx(SENT[:8])
    assert network.Arrivals(8) == pytest.approx(SENT[:8] + 0.07)
    assert network.CountUntil(0.16) == 3
    assert network.CountUntil(0.163) == 4
    assert network.CountUntil(SENT[5]) == 5


@pytest.mark.parametrize("policy", POLICIES)
def test_output_against_a_look_at_every_packet(policy):
    receiver = Receiver(policy=policy, depth=0.04 * (policy == "playout"))
    network = Network(
        jitter=Jitter(kind="uniform", std=0.03),
        loss=Loss(kind="independent", probability=0.2),
        seed=2,
    )
    ramp = Ramp(network, receiver)
    for time in np.arange(0.00713, 1.4, 0.0137):
        expected = Expected(network, receiver, time)
        assert ramp.Output(time) == pytest.approx(expected, abs=1e-12)


def Scenario(policy="newest", **fields):
    channel = {
        "kind": "network",
        "delay": 0.04,
        "sample_period": 0.054,
        "jitter": {"kind": "uniform", "std": 0.02},
        "receiver": {"policy": policy},
        **fields,
    }
    return LoadScenario(
        "one_dof",
        {
            "forward_channel": channel,
            "duration": 0.7,
            "controller.kind": "direct_force",
        },
    )


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    "fields",
    [
        {"periods": PERIODS},
        {"period_jitter": {"kind": "uniform", "std": 0.014}, "seed": 3},
    ],
    ids=["sequence", "distribution"],
)
@pytest.mark.parametrize("policy", ["newest", "extrapolate"])
def test_both_engines_show_the_same(policy, fields):
    scenario = Scenario(policy, **fields)
    drake, compiled = (simulate(scenario, engine=x) for x in ("drake", "compiled"))
    times = np.arange(0.0013, 0.7, 0.0077)
    received = [
        run.Interpolate("forward_packet_received", times) for run in (drake, compiled)
    ]
    assert received[1] == pytest.approx(received[0], abs=1e-5)
    assert drake.channels == compiled.channels
    network = scenario.forward_channel.Network(0.7, stream="forward_channel")
    sent = network.SentTimes(network.CountUntil(0.7))
    assert drake.channels["forward_channel"].sent == len(sent)
    # What is received is what was sent at the time stamps.
    shown, stamps = network.ShownUntil(Receiver(), 0.7)
    latest = np.searchsorted(shown, times, side="right") - 1
    if policy == "newest":
        known = latest >= 0
        sent = compiled.Interpolate("forward_packet_sent", stamps[latest[known]])
        assert received[1][known] == pytest.approx(sent, abs=1e-6)


@pytest.mark.parametrize("kind", ["uniform", "gamma"])
def test_times_between_packets_have_their_distribution(kind):
    """12 to 30 Hz: 58.3 ms on average, and 25 ms to either side."""
    std = 0.025 / np.sqrt(3)
    config = NetworkChannelConfig(
        delay=0.1,
        sample_period=0.0583,
        period_jitter=Jitter(kind=kind, std=std, minimum=0.02 * (kind == "gamma")),
    )
    config.Check("forward_channel", 300.0)
    network = config.Network(300.0)
    sent = network.SentTimes(network.CountUntil(300.0))
    assert sent[0] == 0
    periods = np.diff(sent)
    assert len(periods) == pytest.approx(300 / 0.0583, rel=0.02)
    assert periods.mean() == pytest.approx(0.0583, rel=0.02)
    assert periods.std() == pytest.approx(std, rel=0.05)
    if kind == "uniform":
        assert periods.min() >= 0.0333 - 1e-4
        assert periods.max() <= 0.0833 + 1e-4
    # Another duration has the same packets.
    other = config.Network(20.0)
    assert other.SentTimes(300) == pytest.approx(sent[:300])


def test_age_of_uneven_periods_is_longer():
    """Its mean is d + E[h^2] / (2 E[h])."""
    config = NetworkChannelConfig(delay=0.1, sample_period=0.054, periods=PERIODS)
    duration = 60.1
    network = config.Network(duration)
    age = ComputePacketStatistics(network, Receiver(), duration).age_mean
    periods = np.array(PERIODS)
    expected = 0.1 + np.mean(periods**2) / (2 * np.mean(periods))
    assert age == pytest.approx(expected, abs=1e-4)


REFUSED = [
    ({"periods": [0.03, 0.05]}, "sample_period = 0.054: must be 0.04 (s), the mean"),
    ({"periods": [0.054, 0.0]}, "periods.1 = 0.0: must be a finite number >= 1e-06"),
    (
        {"periods": PERIODS, "period_jitter": {"kind": "uniform", "std": 0.01}},
        "period_jitter.kind = 'uniform': must be none with periods",
    ),
    ({"period_jitter": {"kind": "uniform", "std": 0.04}}, "period_jitter.std = 0.04"),
    ({"period_jitter": {"kind": "x"}}, "period_jitter.kind = 'x': must be one of"),
    (
        {"period_jitter": {"kind": "gamma", "std": 0.01, "minimum": 0.06}},
        "period_jitter.minimum = 0.06: must be a finite number >= 0 and <= 0.054",
    ),
    (
        {"period_jitter": {"kind": "gamma", "std": 0.01, "keeps_order": True}},
        "period_jitter.keeps_order = true: must be false",
    ),
]


@pytest.mark.parametrize(("fields", "message"), REFUSED)
def test_bad_periods_are_refused(fields, message):
    with pytest.raises(ScenarioError) as error:
        Scenario(**fields)
    assert f"forward_channel.{message}" in str(error.value)


def test_periods_without_an_end_are_refused():
    config = NetworkChannelConfig(delay=0.1, sample_period=0.054, periods=PERIODS)
    with pytest.raises(ScenarioError, match="finite where the times between"):
        config.MakeChannel(size=1, initial_value=[0.0])

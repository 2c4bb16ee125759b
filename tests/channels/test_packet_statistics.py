"""What became of the packets, against counting them one by one."""

import math

import numpy as np
import pytest
from grids import Slow

from teleop_drake.channels.packet_network import (
    ComputePacketStatistics,
    Jitter,
    Loss,
    PacketNetwork,
    Receiver,
)
from teleop_drake.channels.variable import DelayProfile

MEAN = 0.1
BUSY = {
    "jitter": Jitter(kind="gamma", std=0.02, minimum=0.05),
    "loss": Loss(kind="burst", probability=0.1, burst_length=4),
}


def make(*, h=0.001, **arguments):
    profile = DelayProfile(delay=MEAN)
    return PacketNetwork(profile=profile, sample_period=h, **arguments)


@pytest.mark.parametrize(
    "receiver",
    Slow([Receiver(policy="playout", depth=0.02), Receiver()]),
    ids=lambda receiver: receiver.policy,
)
def test_statistics_against_counting(receiver):
    network = make(**BUSY, h=0.01, seed=4)
    end = 7.003
    result = ComputePacketStatistics(network, receiver, end)
    sent = 701
    arrivals = network.Arrivals(sent)
    received = [k for k in range(sent) if arrivals[k] <= end]
    d = np.array([arrivals[k] - k * 0.01 for k in received])
    assert result.sent == sent
    assert result.received == len(received)
    assert result.lost == sum(math.isinf(a) for a in arrivals)
    assert result.loss_rate == result.lost / sent
    assert result.reordered == sum(
        any(arrivals[j] < arrivals[k] for j in received if j > k) for k in received
    )
    assert result.reordered > 50
    late = sum(d > MEAN + receiver.depth) if receiver.policy == "playout" else 0
    assert result.late == late
    assert result.delay_mean == pytest.approx(d.mean())
    for key, percent in (
        ("minimum", 0),
        ("median", 50),
        ("p95", 95),
        ("p99", 99),
        ("maximum", 100),
    ):
        value = getattr(result, f"delay_{key}")
        assert value == pytest.approx(np.percentile(d, percent))
    shown = np.array([network.Shown(k, receiver) for k in range(sent)])
    grid = np.arange(min(shown), end, 1e-4) + 5e-5
    order = np.array(received)[np.argsort(shown[received])]
    num_shown = np.searchsorted(shown[order], grid, side="right")
    ages = grid - np.maximum.accumulate(order)[num_shown - 1] * 0.01
    assert result.age_mean == pytest.approx(np.mean(ages), rel=1e-3)
    assert result.age_maximum == pytest.approx(np.max(ages), abs=2e-4)


def test_age_of_information_of_a_constant_delay():
    result = ComputePacketStatistics(make(h=0.01), Receiver(), 10.1)
    assert result.age_mean == pytest.approx(MEAN + 0.005)
    assert result.age_maximum == pytest.approx(MEAN + 0.01)
    assert (result.sent, result.received, result.lost) == (1010, 1001, 0)


def test_statistics_of_nothing():
    loss = Loss(kind="independent", probability=1.0)
    result = ComputePacketStatistics(make(loss=loss), Receiver(), 1.0)
    assert (result.sent, result.received, result.loss_rate) == (1000, 0, 1.0)
    assert result.delay_mean is result.delay_p99 is result.age_mean is None
    assert ComputePacketStatistics(make(), Receiver(), 0.0).sent == 0

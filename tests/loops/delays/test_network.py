"""Tests of the delay in packets with fates of their own."""

import functools
import math

import numpy as np
import pytest
import sources
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Jitter, Loss, Receiver
from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.delays.variable import DelayProfile

H = 0.01


def make_network(*, delay=0.1, h=H, **arguments):
    return PacketNetwork(
        profile=DelayProfile(delay=delay), sample_period=h, **arguments
    )


def make(*, receiver=None, **arguments):
    return NetworkDelay(
        network=make_network(**arguments),
        receiver=receiver,
        size=2,
        initial_value=[-1.0, -2.0],
    )


BUSY = {
    "jitter": Jitter(kind="gamma", std=0.03, minimum=0.05),
    "loss": Loss(kind="burst", probability=0.2, burst_length=3),
    "seed": 2,
}
POLICIES = [
    Receiver(),
    Receiver(policy="playout", depth=0.03),
    Receiver(policy="extrapolate"),
]


Ramp = functools.partial(sources.Ramp, start=[3.0, -4.0])


def signal(time):
    return np.array([1.0, 2.0]) * time + [3.0, -4.0]


def expected_output(network, receiver, time):
    """Returns the output at a time by looking at every packet."""
    shown = [network.Shown(k, receiver) for k in range(math.floor(time / H + 1e-9) + 1)]
    k = max((k for k in range(len(shown)) if shown[k] <= time), default=None)
    if k is None:
        return np.array([-1.0, -2.0])
    value = signal(k * H)
    # The one that it replaced is the newest of those that came before it.
    has_slope = any(shown[j] < shown[k] for j in range(k))
    if receiver.policy == "extrapolate" and has_slope:
        value = value + np.array([1.0, 2.0]) * (time - shown[k])
    return value


@pytest.mark.parametrize("receiver", POLICIES, ids=lambda receiver: receiver.policy)
def test_every_policy_against_a_look_at_every_packet(receiver):
    network = make_network(**BUSY)
    ramp = Ramp(
        NetworkDelay(
            network=network, receiver=receiver, size=2, initial_value=[-1.0, -2.0]
        )
    )
    assert_array_equal(ramp.Eval(), [-1.0, -2.0])
    for time in np.arange(0.00713, 1.5, 0.0137):
        expected = expected_output(network, receiver, time)
        assert_allclose(ramp.Output(time), expected, atol=1e-12)


@pytest.mark.parametrize("receiver", POLICIES, ids=lambda receiver: receiver.policy)
@pytest.mark.parametrize("delay", [0.1, 0.004, 0.0])
def test_jumps_are_announced_and_have_two_sides(receiver, delay):
    network = make_network(
        delay=delay, loss=BUSY["loss"], jitter=Jitter(kind="normal", std=delay / 2)
    )
    ramp = Ramp(
        NetworkDelay(
            network=network, receiver=receiver, size=2, initial_value=[-1.0, -2.0]
        )
    )
    shown = [network.Shown(k, receiver) for k in range(60)]
    # Those that no newer packet overtakes.
    jumps = sorted(
        {s for k, s in enumerate(shown) if s < min(shown[k + 1 :], default=9)}
    )
    for jump in [jump for jump in jumps if jump < 0.4]:
        while (announced := ramp.dut.NextJumpTime(ramp.context)) > jump:
            # Sent later than the end of the next step: known before it arrives.
            ramp.Output(ramp.context.get_time() + H / 4)
        assert announced == jump
        ramp.simulator.AdvanceTo(jump)
        before = ramp.Eval()
        ramp.simulator.AdvancePendingEvents()
        after = ramp.Eval()
        expected = expected_output(network, receiver, jump)
        assert_allclose(after, expected, atol=1e-12)
        # What happens at the start, happens before anything can be looked at.
        if receiver.policy != "extrapolate" and jump > 0:
            assert np.any(before != after)
            expected = expected_output(network, receiver, jump - 1e-9)
            assert_allclose(before, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("delay", "h"), [(0.1, 0.01), (0.1, 0.03), (0.1, 0.1), (0.123, 0.02), (1 / 3, 0.05)]
)
def test_packets_arrive_one_delay_after_they_were_sent(delay, h):
    ramp = sources.Ramp(
        SampledDelay(delay=delay, sample_period=h, size=2, initial_value=[-1.0, -2.0])
    )
    for time in np.arange(0.00713, 1.0, 0.0137):
        newest = math.floor((time - delay) / h + 1e-9)
        expected = np.array([1.0, 2.0]) * (newest * h if newest >= 0 else -1.0)
        assert_allclose(ramp.Output(time), expected, atol=1e-12)

"""The policies of a receiver, and what is refused."""

import pytest

from teleop_drake.channels.packet_network import Receiver


@pytest.mark.parametrize("policy", Receiver.used)
def test_each_policy_is_allowed(policy):
    Receiver(policy=policy).Check()
    Receiver(policy="playout", depth=0.02).Check()


@pytest.mark.parametrize(
    ("receiver", "message"),
    [
        (Receiver(policy="oldest"), "receiver.policy = 'oldest': must be one of"),
        (Receiver(policy="playout", depth=-1), "receiver.depth = -1: must be"),
        (Receiver(depth=0.1), "receiver.depth = 0.1: must be 0 where"),
    ],
)
def test_bad_receivers(receiver, message):
    with pytest.raises(ValueError, match=message):
        receiver.Check()

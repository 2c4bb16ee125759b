"""The networks by name deliver what their sources say."""

import numpy as np
import pytest

from teleop_drake.channels import CHANNEL_KINDS
from teleop_drake.scenario import LoadScenario

# Of round trips: mean, standard deviation, minimum, in s; share of loss. None: none.
STATED = {
    "wifi": (0.010, 0.002 * 2**0.5, None, 0.01),
    "lte": (0.0545, 0.0236, None, None),
    "satellite_leo": (0.050, 0.0148, 0.020, None),
    "satellite_geo": (0.650, None, 4 * 35_786e3 / 299_792_458, None),
}


@pytest.mark.parametrize("kind", STATED)
def test_round_trips_are_those_of_the_source(kind):
    config = CHANNEL_KINDS.Find(kind, "kind")()
    config.Check("forward_channel", 600.0)
    num = int(600 / config.sample_period)
    sent = np.arange(num) * config.sample_period
    ways = [
        config.Network(600.0, stream=stream).Arrivals(num) - sent
        for stream in ("forward_channel", "return_channel")
    ]
    arrived = np.isfinite(ways[0]) & np.isfinite(ways[1])
    trips = (ways[0] + ways[1])[arrived]
    mean, std, minimum, loss = STATED[kind]
    assert trips.mean() == pytest.approx(mean, rel=0.05)
    if std is not None:
        assert trips.std() == pytest.approx(std, rel=0.05)
    if minimum is not None:
        assert minimum - 1e-4 < trips.min() < mean
    if loss is not None:
        lost = [np.isinf(way).mean() for way in ways]
        assert lost == pytest.approx([loss, loss], rel=0.2)


def test_a_scenario_chooses_one_by_its_name():
    channel = LoadScenario("one_dof", ["forward_channel={kind: lte}"]).forward_channel
    assert (channel.kind, channel.delay) == ("lte", 0.0272)
    # The scenario's own delay stays where the kind alone is changed.
    kept = LoadScenario("one_dof", ["forward_channel.kind=lte"]).forward_channel
    assert (kept.kind, kept.delay, kept.jitter.kind) == ("lte", 0.1, "gamma")

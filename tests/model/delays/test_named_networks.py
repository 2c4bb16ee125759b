"""The networks by name deliver what their sources say."""

import numpy as np
import pytest

from teleop_drake.model.channels.kinds import CHANNEL_KINDS
from teleop_drake.model.scenario import LoadScenario

# Of round trips: mean, standard deviation, minimum, in s. None: none.
STATED = {
    "wifi": (0.00724, 0.01077, None),
    "lte": (0.0919, 0.0459, None),
    "satellite_leo": (0.050, 0.0148, 0.020),
    "satellite_geo": (None, None, 0.550),
}


@pytest.mark.parametrize("kind", STATED)
def test_round_trips_are_those_of_the_source(kind):
    config = CHANNEL_KINDS.Find(kind, "kind")()
    # Rare packets are nearly independent, and many seconds cost little.
    config.sample_period = 1.0
    num = 20_000
    ways = [
        config.Network(num, stream=stream).Arrivals(num) - np.arange(num)
        for stream in ("forward_channel", "return_channel")
    ]
    arrived = np.isfinite(ways[0]) & np.isfinite(ways[1])
    trips = (ways[0] + ways[1])[arrived]
    mean, std, minimum = STATED[kind]
    for value, stated in ((trips.mean(), mean), (trips.std(), std)):
        assert stated is None or value == pytest.approx(stated, rel=0.05)
    assert minimum is None or minimum - 1e-4 < trips.min() < trips.mean()


@pytest.mark.parametrize("kind", STATED)
def test_packets_keep_their_order_and_what_the_fields_say(kind):
    config = CHANNEL_KINDS.Find(kind, "kind")()
    num = 20_000
    duration = num * config.sample_period
    config.Check("forward_channel", duration)
    arrivals = config.Network(duration).Arrivals(num)
    delays = (arrivals - np.arange(num) * config.sample_period)[np.isfinite(arrivals)]
    assert np.diff(arrivals[np.isfinite(arrivals)]).min() >= 0
    # So many seconds are half as many independent delays; bursts are of few packets.
    error = config.jitter.std * np.sqrt(2 * config.jitter.correlation_time / duration)
    assert abs(delays.mean() - config.delay) < 4 * error
    lost = config.loss.probability
    length = config.loss.burst_length
    error = np.sqrt(2 * length * lost / num)
    assert abs(1 - len(delays) / num - lost) < 4 * error


def test_a_scenario_chooses_one_by_its_name():
    channel = LoadScenario("one_dof", ["forward_channel={kind: lte}"]).forward_channel
    assert (channel.kind, channel.delay) == ("lte", 0.0459)
    # The scenario's own delay stays where the kind alone is changed.
    kept = LoadScenario("one_dof", ["forward_channel.kind=lte"]).forward_channel
    assert (kept.kind, kept.delay, kept.jitter.kind) == ("lte", 0.1, "gamma")

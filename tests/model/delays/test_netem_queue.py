"""Tests of teleop_drake.loops.delays.netem_queue against what netem documents."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from teleop_drake import simulate
from teleop_drake.loops.delays.netem import ParseNetem
from teleop_drake.loops.delays.netem_queue import Deliver, Table
from teleop_drake.loops.delays.packet_statistics import ComputePacketStatistics
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.channels.network import NetworkChannelConfig
from teleop_drake.model.scenario import LoadScenario

NUM = 20_000
STEP = 0.01


def Send(line, num=NUM, seed=1, step=STEP):
    """Returns the times in the queue of packets and of copies, s; infinity: none."""
    draw = np.random.default_rng(seed)
    sent = np.arange(num) * step
    netem = ParseNetem("netem", line)
    return Deliver(netem, sent, lambda name: draw.integers(0, 2**32, max(num, 4)))


def IsShare(flags, share):
    """Returns whether a share of independent events is what is expected."""
    error = np.sqrt(share * (1 - share) / len(flags))
    return abs(np.mean(flags) - share) < 4 * error


def Correlated(rho, num, seed):
    """Returns the sequence x_n = rho x_(n-1) + (1 - rho) u_n, from 0 to 1."""
    u = np.random.default_rng(seed).random(num)

    def Next(x, new):
        return rho * x + (1 - rho) * new

    return np.array(list(itertools.accumulate(u, Next)))


@pytest.mark.mostly_slow
@pytest.mark.parametrize("name", ["normal", "pareto", "paretonormal"])
def test_tables_are_those_of_tc(name):
    """tc's tables are integrals in steps, and differ by one unit here and there."""
    files = [*Path("/usr/lib").glob(f"**/tc/{name}.dist")]
    if not files:
        pytest.skip("the tables of tc are not installed")
    lines = files[0].read_text().splitlines()
    numbers = [int(x) for line in lines if line[:1] != "#" for x in line.split()]
    assert np.abs(np.subtract(numbers, Table(name))).max() <= 1


def test_tables_are_quantiles():
    shares = (np.arange(4096) + 0.125) / 4096
    normal = np.array(Table("normal")) / 8192
    inner = slice(1, None)
    assert normal[inner] == pytest.approx(stats.norm.ppf(shares)[inner], abs=1e-4)
    # Mean 1.5 and variance 3/4: the table divides by the variance.
    pareto = (stats.pareto(3).ppf(np.arange(4096) / 4096) - 1.5) / 0.75
    assert np.array(Table("pareto")) / 8192 == pytest.approx(
        np.minimum(pareto, 32767 / 8192), abs=1e-4
    )


def test_uniform_delays():
    delays, copies = Send("delay 100ms 20ms")
    assert np.isinf(copies).all()
    assert stats.kstest(delays, stats.uniform(0.08, 0.04).cdf).pvalue > 0.01
    assert abs(np.corrcoef(delays[1:], delays[:-1])[0, 1]) < 4 / np.sqrt(NUM)


@pytest.mark.parametrize("distribution", ["normal", "pareto", "paretonormal"])
def test_delays_have_the_quantiles_of_their_table(distribution):
    delays, _ = Send(f"delay 100ms 10ms distribution {distribution}")
    table = 0.1 + 0.01 * np.sort(Table(distribution)) / 8192
    for share in (0.05, 0.5, 0.95):
        expected = table[int(4096 * share)]
        # The standard error of a share, as a difference of quantiles.
        error = 4 * np.sqrt(share * (1 - share) / NUM)
        low = table[int(4096 * (share - error))]
        high = table[int(4096 * (share + error))]
        found = np.quantile(delays, share)
        assert low <= found <= high, (expected, found)


def test_a_delay_is_never_negative():
    delays, _ = Send("delay 5ms 20ms")
    assert delays.min() == 0
    # Of -15 to 25 ms, 15/40 are negative.
    assert IsShare(delays == 0, 15 / 40)


def test_correlation_of_short_jitter_is_lost_in_the_remainder():
    """netem takes the remainder of a number of 32 bits by twice the jitter in ns."""
    delays, _ = Send("delay 100ms 10ms 50%")
    assert abs(np.corrcoef(delays[1:], delays[:-1])[0, 1]) < 4 / np.sqrt(NUM)
    assert delays.std() == pytest.approx(0.01 / np.sqrt(3), rel=0.02)
    # Twice 2.147 s in ns is nearly 2^32, so that the correlation is seen.
    delays, _ = Send("delay 3s 2.147s 50%")
    assert np.corrcoef(delays[1:], delays[:-1])[0, 1] == pytest.approx(0.5, abs=0.05)
    # The variance of the numbers is (1 - rho)/(1 + rho) of that of uniform ones.
    expected = 2.147 / np.sqrt(3) * np.sqrt(0.5 / 1.5)
    assert delays.std() == pytest.approx(expected, rel=0.03)


def test_independent_losses():
    delays, _ = Send("loss 3%")
    assert IsShare(np.isinf(delays), 0.03)


@pytest.mark.parametrize("rho", [0.25, 0.5])
def test_correlated_losses_are_rarer_than_their_percentage(rho):
    delays, _ = Send(f"loss 20% {100 * rho:g}%", num=40_000)
    lost = np.isinf(delays)
    expected = Correlated(rho, 400_000, 5) <= 0.2
    assert lost.mean() == pytest.approx(expected.mean(), abs=0.015)
    assert lost.mean() < 0.17
    # Twice in a row.
    pairs = (expected[1:] & expected[:-1]).mean() / expected.mean()
    assert (lost[1:] & lost[:-1]).mean() / lost.mean() == pytest.approx(pairs, abs=0.05)


def test_gilbert_elliott():
    """The stationary share of the bad state is p/(p + r); it lasts 1/r packets."""
    delays, _ = Send("loss gemodel 2% 25%", 60_000)
    lost = np.isinf(delays)
    assert lost.mean() == pytest.approx(0.02 / 0.27, rel=0.12)
    edges = np.flatnonzero(np.diff(lost, prepend=False, append=False))
    lengths = edges[1::2] - edges[::2]
    assert lengths.mean() == pytest.approx(4, rel=0.1)
    delays, _ = Send("loss gemodel 2% 25% 60% 1%", 60_000)
    expected = (0.02 * 0.6 + 0.25 * 0.01) / 0.27
    assert np.isinf(delays).mean() == pytest.approx(expected, rel=0.12)


def test_gilbert_elliott_begins_in_the_good_state():
    firsts = [np.isinf(Send("loss gemodel 50% 50%", 2, seed)[0]) for seed in range(400)]
    firsts = np.array(firsts)
    assert not firsts[:, 0].any()
    assert IsShare(firsts[:, 1], 0.5)


def test_copies_are_lost_by_themselves():
    """A packet that is both doubled and lost leaves one copy."""
    loss = 0.2
    double = 0.3
    first, second = Send("delay 50ms 10ms loss 20% duplicate 30%")
    assert IsShare(np.isfinite(second), double * (1 - loss) ** 2)
    assert IsShare(np.isinf(first), loss * (1 - double))
    both = np.isfinite(second)
    assert abs(np.corrcoef(first[both], second[both])[0, 1]) < 4 / np.sqrt(both.sum())


def test_every_fifth_packet_is_sent_at_once():
    """The example of the manual: reorder 100% with a gap of 5."""
    delays, _ = Send("delay 10ms reorder 100% gap 5", num=100)
    expected = np.where(np.arange(100) % 5 == 4, 0.0, 0.01)
    assert delays == pytest.approx(expected, abs=1e-12)


def test_a_gap_of_five_and_a_chance():
    """Four packets are delayed, and then others until one is sent at once."""
    delays, _ = Send("delay 10ms reorder 25% gap 5")
    assert np.mean(delays == 0) == pytest.approx(1 / (4 + 4), rel=0.05)
    at = np.flatnonzero(delays == 0)
    assert np.diff(at).min() == 5


def test_reordering_without_a_gap():
    delays, _ = Send("delay 10ms reorder 25%")
    assert IsShare(delays == 0, 0.25)


def test_a_full_queue_loses_packets():
    """Of the packets of 1 s, the queue takes 20 until the first of them leaves."""
    delays, _ = Send("delay 1s limit 20", num=400)
    expected = np.arange(400) % 100 < 20
    assert np.array_equal(np.isfinite(delays), expected)


def Network(line, *, delay=0.1, duration=20.0, **fields):
    config = NetworkChannelConfig(
        delay=delay, sample_period=STEP, netem=line, seed=3, **fields
    )
    config.Check("forward_channel", duration)
    return config, config.Network(duration, stream="forward_channel")


def test_a_network_has_the_options():
    line = "delay 100ms 10ms 25% loss 5% duplicate 2% reorder 25%"
    config, network = Network(line, drift=0.001)
    arrivals = network.Arrivals(2000)
    sent = np.arange(2000) * STEP
    delays = arrivals - sent - 0.001 * sent
    lost = np.isinf(arrivals)
    assert IsShare(lost, 0.05 * 0.98)
    at_once = np.abs(delays) < 1e-9
    assert at_once.mean() == pytest.approx(0.25 * 0.95, rel=0.2)
    later = delays[~lost & ~at_once]
    # The first of two copies arrives in the place of the other.
    assert later.mean() == pytest.approx(0.1, abs=1e-3)
    assert later.std() == pytest.approx(0.01 / np.sqrt(3), rel=0.05)
    statistics = ComputePacketStatistics(network, config.receiver, 20.0)
    assert statistics.duplicated == pytest.approx(2000 * 0.02 * 0.95**2, abs=25)
    assert statistics.reordered > 300


def test_more_packets_leave_the_first_unchanged():
    _, network = Network("delay 100ms 10ms loss gemodel 2% 25% duplicate 5% reorder 9%")
    first = network.Arrivals(100)
    assert np.array_equal(network.Arrivals(2000)[:100], first)


@pytest.mark.slow
def test_both_engines_show_the_same_packets():
    line = "delay 20ms 15ms loss 10% duplicate 10% reorder 10%"
    channel = {"kind": "network", "delay": 0.02, "sample_period": 0.01, "netem": line}
    overrides = {"forward_channel": channel, "duration": 0.6}
    overrides["controller.kind"] = "direct_force"
    scenario = LoadScenario("one_dof", overrides)
    drake, compiled = (simulate(scenario, engine=x) for x in ("drake", "compiled"))
    times = np.arange(0.0053, 0.6, 0.01)
    received = [
        run.Interpolate("forward_packet_received", times) for run in (drake, compiled)
    ]
    assert received[1] == pytest.approx(received[0], abs=1e-6)
    assert drake.channels == compiled.channels
    assert drake.channels["forward_channel"].reordered > 0


REFUSED = [
    ({"delay": 0.2}, "delay = 0.2: must be 0.1 (s), the delay of netem"),
    ({"jitter.kind": "uniform"}, "jitter.kind = 'uniform': must be none with netem"),
    ({"duplicates": 0.1}, "duplicates = 0.1: must be 0.0 with netem"),
    ({"netem": "delay 1"}, "netem = 'delay 1': must be such that delay is a time"),
]


@pytest.mark.parametrize(("fields", "message"), REFUSED)
def test_what_netem_replaces_is_refused(fields, message):
    overrides = {"kind": "network", "sample_period": 0.01, "netem": "delay 100ms"}
    overrides = {f"forward_channel.{k}": v for k, v in (overrides | fields).items()}
    with pytest.raises(ScenarioError) as error:
        LoadScenario("one_dof", overrides)
    assert f"forward_channel.{message}" in str(error.value)

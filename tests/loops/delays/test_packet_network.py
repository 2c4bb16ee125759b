"""Networks that delay, lose and reorder packets."""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from grids import Slow
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Jitter, Loss, Receiver
from teleop_drake.loops.delays.packet_statistics import ComputePacketStatistics
from teleop_drake.loops.delays.variable import DelayProfile, Sinusoid

COUNT = 20_000
H = 0.001
MEAN = 0.1


def make(*, delay=MEAN, h=H, **arguments):
    profile = DelayProfile(
        delay=delay,
        drift=arguments.pop("drift", 0.0),
        sinusoid=arguments.pop("sinusoid", None),
        trace=arguments.pop("trace", None),
        duration=arguments.pop("duration", None),
    )
    return PacketNetwork(profile=profile, sample_period=h, **arguments)


def delays(network, count=COUNT):
    """Returns the delays of the first packets; infinity for the lost ones."""
    return network.Arrivals(count) - np.arange(count) * network.sample_period


def runs(lost):
    """Returns the lengths of the runs of lost packets."""
    edges = np.flatnonzero(np.diff(lost, prepend=False, append=False))
    return edges[1::2] - edges[::2]


# Delays.


def test_packets_follow_the_profile():
    sinusoid = Sinusoid(amplitude=0.05, frequency=2.0)
    network = make(sinusoid=sinusoid, drift=0.001)
    t = np.arange(COUNT) * H
    expected = MEAN + 0.001 * t + 0.05 * np.sin(2 * t)
    assert_allclose(delays(network), expected, atol=2e-12)


def test_measured_delays_are_used_as_they_are():
    times = np.arange(50) * 0.01
    measured = np.random.default_rng(0).uniform(0.01, 0.2, 50)
    network = make(delay=0.0, h=0.01, trace=(times, measured))
    assert_allclose(delays(network, 50), measured, atol=1e-11)


@pytest.mark.parametrize(
    ("jitter", "name", "arguments"),
    [
        (Jitter(kind="uniform", std=0.02), "uniform",
         (MEAN - math.sqrt(3) * 0.02, 2 * math.sqrt(3) * 0.02)),
        (Jitter(kind="normal", std=0.01), "norm", (MEAN, 0.01)),
        (Jitter(kind="normal", std=0.05, minimum=0.06), "truncnorm",
         (-0.8, math.inf, MEAN, 0.05)),
        (Jitter(kind="gamma", std=0.02, minimum=0.06), "gamma", (4.0, 0.06, 0.01)),
        (Jitter(kind="gamma", std=0.02 * math.sqrt(2), minimum=0.08), "gamma",
         (0.5, 0.08, 0.04)),
    ],
)  # fmt: skip
def test_delays_have_the_distribution_of_their_parameters(jitter, name, arguments):
    from scipy import stats  # It takes a second.

    distribution = getattr(stats, name)(*arguments)
    sample = delays(make(jitter=jitter, seed=1))
    assert stats.kstest(sample, distribution.cdf).pvalue > 0.01
    assert sample.min() >= max(jitter.minimum, distribution.ppf(0)) - 1e-9
    mean_error = (sample.mean() - distribution.mean()) / distribution.std()
    assert abs(mean_error) < 4 / math.sqrt(COUNT)
    assert sample.std() == pytest.approx(distribution.std(), rel=0.05)
    # Neighbours are independent.
    assert abs(np.corrcoef(sample[1:], sample[:-1])[0, 1]) < 4 / math.sqrt(COUNT)


@pytest.mark.parametrize(
    ("jitter", "kurtosis"),
    [
        (Jitter(kind="uniform", std=0.02), 1.8),
        (Jitter(kind="normal", std=0.01), 3.0),
        (Jitter(kind="gamma", std=0.02, minimum=0.06), 3 + 6 / 4),
    ],
)
def test_correlated_delays_have_the_same_distribution(jitter, kurtosis, subtests):
    jitter.correlation_time = 5 * H
    a = math.exp(-1 / 5)
    sample = delays(make(jitter=jitter, seed=2))
    independent = COUNT * (1 - a) / (1 + a)
    assert abs(sample.mean() - MEAN) < 4 * jitter.std / math.sqrt(independent)
    error = math.sqrt((kurtosis - 1) / 4 / independent)
    assert sample.std() == pytest.approx(jitter.std, rel=4 * error)
    ranks = np.argsort(np.argsort(sample))
    for m in (1, 3, 8):
        with subtests.test(m=m):
            expected = 6 / math.pi * math.asin(a**m / 2)
            found = np.corrcoef(ranks[m:], ranks[:-m])[0, 1]
            assert found == pytest.approx(expected, abs=4 / math.sqrt(independent))


def test_in_order_a_packet_waits_for_the_one_before():
    loss = Loss(kind="burst", probability=0.1, burst_length=4)
    jitter = {"kind": "gamma", "std": 0.02, "minimum": 0.05}
    free, ordered = (
        make(jitter=Jitter(**jitter, keeps_order=order), loss=loss).Arrivals(3000)
        for order in (False, True)
    )
    arrived = np.isfinite(free)
    assert np.diff(free[arrived]).min() < 0
    assert_array_equal(np.isfinite(ordered), arrived)
    waiting = np.maximum.accumulate(free[arrived])
    assert_array_equal(ordered[arrived], waiting)


@pytest.mark.parametrize("kind", ["uniform", "normal", "gamma"])
def test_no_spread_is_no_jitter(kind):
    jitter = Jitter(kind=kind, std=0.0)
    assert_array_equal(make(jitter=jitter).Arrivals(100), make().Arrivals(100))


def test_constant_delays_end_on_the_grid_of_the_samples():
    assert_array_equal(make().Arrivals(2000), (np.arange(2000) + 100) * H)


# Loss.


def test_independent_loss():
    network = make(loss=Loss(kind="independent", probability=0.1), seed=3)
    lost = np.isinf(delays(network))
    assert abs(lost.mean() - 0.1) < 4 * math.sqrt(0.1 * 0.9 / COUNT)
    lengths = runs(lost)
    # Geometric, with mean 1 / (1 - p).
    assert lengths.mean() == pytest.approx(1 / 0.9, rel=0.05)


@pytest.mark.parametrize(("rate", "length"), [(0.05, 8.0), (0.3, 2.0), (0.8, 30.0)])
def test_bursts_have_the_rate_and_length_of_their_parameters(rate, length):
    count = 50_000
    loss = Loss(kind="burst", probability=rate, burst_length=length)
    lost = np.isinf(delays(make(loss=loss, seed=5), count))
    lengths = runs(lost)
    # With bad_loss 1 and good_loss 0 the runs are the stays in the bad state.
    spread = length * math.sqrt((1 - 1 / length) / len(lengths))
    assert abs(lengths.mean() - length) < 4 * spread
    # Lost packets are correlated over some burst lengths.
    correlation = 1 - 1 / length - rate / (1 - rate) / length
    spread = math.sqrt(
        rate * (1 - rate) / count * (1 + correlation) / (1 - correlation)
    )
    assert abs(lost.mean() - rate) < 4 * spread
    # Geometric: long ones have the share that their mean demands.
    longer = np.mean(lengths > 2 * length)
    expected = (1 - 1 / length) ** math.floor(2 * length)
    assert abs(longer - expected) < 4 * math.sqrt(expected / len(lengths))


def test_losses_within_the_states():
    loss = Loss(
        kind="burst", probability=0.2, burst_length=50, good_loss=0.1, bad_loss=0.6
    )
    count = 50_000
    lost = np.isinf(delays(make(loss=loss, seed=2), count))
    assert lost.mean() == pytest.approx(0.2, abs=0.01)
    # share 0.2 of the packets is bad; the covariance of neighbours has a closed form.
    share = 0.2
    leave = 1 / 50
    enter = leave * share / (1 - share)
    covariance = share * (1 - share) * 0.5**2 * (1 - leave - enter)
    assert np.mean((lost[1:] - 0.2) * (lost[:-1] - 0.2)) == pytest.approx(
        covariance, rel=0.15
    )


def test_bursts_by_the_four_numbers_are_the_same_chain():
    burst = Loss(
        kind="burst", probability=0.2, burst_length=5, good_loss=0.1, bad_loss=0.6
    )
    # A share of 0.2 is bad: 1/5 to leave it, and 0.2/0.8/5 to enter it.
    four = Loss(
        kind="gilbert_elliott", to_bad=0.05, to_good=0.2, good_loss=0.1, bad_loss=0.6
    )
    found = [np.isinf(make(loss=x, seed=2).Arrivals(COUNT)) for x in (burst, four)]
    assert np.array_equal(*found)


# Delays that are held, and copies.


@pytest.mark.parametrize("kind", ["uniform", "normal", "gamma"])
def test_held_delays_have_a_geometric_autocorrelation(kind):
    fresh = Jitter(kind=kind, std=0.01)
    held = Jitter(kind=kind, std=0.01, hold=0.6)
    sample = delays(make(jitter=held, seed=3))
    # Runs of one delay are 1/(1 - hold) packets long.
    repeats = np.isclose(np.diff(sample), 0, atol=1e-9)
    assert repeats.mean() == pytest.approx(0.6, abs=4 * math.sqrt(0.24 / COUNT))
    deviations = sample - sample.mean()
    for m in (1, 2, 4):
        found = np.mean(deviations[m:] * deviations[:-m]) / sample.var()
        assert found == pytest.approx(0.6**m, abs=0.06)
    # The distribution is that of delays that are not held.
    others = delays(make(jitter=fresh, seed=3))
    for share in (0.1, 0.5, 0.9):
        expected = np.quantile(others, share)
        assert np.quantile(sample, share) == pytest.approx(expected, abs=1e-3)


def test_the_first_of_two_copies_is_used():
    double = 0.3
    loss = 0.2
    network = make(
        jitter=Jitter(kind="uniform", std=0.02),
        loss=Loss(kind="independent", probability=loss),
        duplicates=double,
        seed=4,
    )
    first = network.Arrivals(COUNT)
    second = network.CopyArrivals(COUNT)
    assert np.all(first <= second)
    error = 4 * math.sqrt(0.25 / COUNT)
    lost = loss * (1 - double + double * loss)
    assert np.mean(np.isinf(first)) == pytest.approx(lost, abs=error)
    twice = double * (1 - loss) ** 2
    both = np.isfinite(second)
    assert np.mean(both) == pytest.approx(twice, abs=error)
    # Of two uniform delays, the first and the second are a third from either end.
    sent = np.arange(COUNT) * H
    width = 2 * math.sqrt(3) * 0.02
    for arrivals, place in ((first, -1 / 6), (second, 1 / 6)):
        mean = np.mean((arrivals - sent)[both])
        assert mean == pytest.approx(MEAN + place * width, abs=1e-3)
    alone = make(jitter=Jitter(kind="uniform", std=0.02), seed=4).Arrivals(COUNT)
    # Packets without a copy are what they are without copies.
    single = np.isfinite(first) & ~both & (first == alone)
    assert single.mean() > 0.8 * (1 - double)
    statistics = ComputePacketStatistics(network, Receiver(), COUNT * H)
    assert statistics.duplicated == pytest.approx(COUNT * twice, rel=0.05)


def test_in_order_copies_arrive_behind_their_packets():
    network = make(
        jitter=Jitter(kind="uniform", std=0.02, keeps_order=True),
        loss=Loss(kind="independent", probability=0.3),
        duplicates=0.5,
    )
    first = network.Arrivals(3000)
    second = network.CopyArrivals(3000)
    arrived = first[np.isfinite(first)]
    assert np.all(np.diff(arrived) >= 0)
    assert np.all(first <= second)


# Random numbers.

BUSY = {
    "jitter": Jitter(kind="gamma", std=0.02, minimum=0.05),
    "loss": Loss(kind="burst", probability=0.1, burst_length=4),
}


@pytest.mark.parametrize("correlated", [False, True])
def test_packets_do_not_depend_on_who_asks(correlated):
    new = {"correlation_time": 0.01, "keeps_order": True} if correlated else {}
    busy = {**BUSY, "jitter": dataclasses.replace(BUSY["jitter"], **new)}
    network = make(**busy, seed=7)
    other = make(**busy, seed=7)
    numbers = [5000, 3, 1024, 1023, 5000, 0]
    backwards = [network.Arrival(k) for k in numbers]
    forwards = other.Arrivals(6000)
    assert backwards == forwards[numbers].tolist()


def test_threads_share_a_network():
    """Runs of one compiled program go side by side."""
    alone = make(**BUSY, seed=7).Arrivals(100_000)
    shared = make(**BUSY, seed=7)
    numbers = range(0, 100_000, 500)
    with ThreadPoolExecutor(8) as threads:
        found = [*threads.map(shared.Arrival, numbers)]
    assert found == alone[numbers].tolist()


def test_seeds_and_streams_differ(subtests):
    arrivals = [
        make(**BUSY, seed=seed, stream=stream).Arrivals(2000)
        for seed, stream in ((0, "forward"), (0, "return"), (1, "forward"))
    ]
    for i, j in ((0, 1), (0, 2), (1, 2)):
        with subtests.test(i=i):
            a = arrivals[i]
            b = arrivals[j]
            both = np.isfinite(a) & np.isfinite(b)
            t = np.arange(2000)[both] * H
            assert abs(np.corrcoef(a[both] - t, b[both] - t)[0, 1]) < 0.1
            assert abs(np.corrcoef(np.isinf(a), np.isinf(b))[0, 1]) < 0.1


def test_impairments_leave_each_other_alone(subtests):
    base = delays(make(**BUSY), 3000)
    for loss in (
        Loss(),
        Loss(kind="independent", probability=0.3),
        Loss(kind="burst", probability=0.2, burst_length=9),
    ):
        with subtests.test(loss=loss):
            other = delays(make(jitter=BUSY["jitter"], loss=loss), 3000)
            both = np.isfinite(base) & np.isfinite(other)
            assert both.sum() > 1500
            assert_array_equal(base[both], other[both])
    for arguments in (
        {"jitter": Jitter(kind="normal", std=0.01)},
        {"sinusoid": Sinusoid(amplitude=0.01), "drift": 0.01},
    ):
        other = delays(make(loss=BUSY["loss"], **arguments), 3000)
        assert_array_equal(np.isinf(base), np.isinf(other))
        assert np.any(base[np.isfinite(base)] != other[np.isfinite(base)])


def test_more_loss_loses_the_same_packets_and_more():
    few, many = (
        np.isinf(
            make(loss=Loss(kind="independent", probability=p)).Arrivals(COUNT),
        )
        for p in (0.1, 0.2)
    )
    assert np.all(many[few])


# What is refused.

TRACE = ([0.0, 1.0], [0.1, 0.2])


def jitter(kind, *, waves=0.0, **fields):
    jitter = {"jitter": Jitter(kind=kind, **fields)}
    return jitter | ({"sinusoid": Sinusoid(amplitude=waves)} if waves else {})


def loss(kind, probability=0.1, **fields):
    return {"loss": Loss(kind=kind, probability=probability, **fields)}


def sinusoid(**fields):
    return {"sinusoid": Sinusoid(**fields)}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"delay": -0.1}, "delay = -0.1: must be a finite number >= 0"),
        ({"drift": math.nan}, "drift = nan: must be a finite number"),
        ({"drift": -0.01}, "delay = 0.1: must be such that the delay, down to -inf s"),
        (sinusoid(amplitude=0.2), "down to -0.1 s, is never negative"),
        (sinusoid(amplitude=-1), "sinusoid.amplitude = -1: must be"),
        (sinusoid(frequency=-1), "sinusoid.frequency = -1: must be"),
        (sinusoid(phase=math.inf), "sinusoid.phase = inf: must be"),
        ({"duration": 0.0}, "duration = 0.0: must be a number > 0"),
        ({"trace": TRACE, "h": 1.5}, "sample_period = 1.5: must be .* <= 1 "),
        ({"h": 0.0}, "sample_period = 0.0: must be"),
        ({"h": math.inf}, "sample_period = inf: must be"),
        ({"seed": -1}, "seed = -1: must be"),
        (jitter("norm"), "jitter.kind = 'norm': must be one of none,"),
        (jitter("none", std=0.1), "jitter.std = 0.1: must be 0 where"),
        (jitter("none", correlation_time=1), "jitter.correlation_time = 1: must be"),
        (jitter("normal", std=-1), "jitter.std = -1: must be"),
        (jitter("uniform", std=0.06), "jitter.std = 0.06: must be"),
        (jitter("uniform", minimum=0.1), "minimum = 0.1: must be 0"),
        (jitter("normal", minimum=0.2), "minimum = 0.2: must be .*0.1"),
        (jitter("gamma", std=0.1, minimum=0.1),
         "jitter.minimum = 0.1: must be less than the mean delay, 0.1 s"),
        (jitter("gamma", std=0.1, waves=0.01), "jitter.minimum = 0.0: must be >= 0.01"),
        (loss("some", 0.0), "loss.kind = 'some': must be one of"),
        (loss("none"), "loss.probability = 0.1: must be 0 where"),
        (loss("independent", 1.1), "loss.probability = 1.1: must be"),
        (loss("independent", burst_length=3), "loss.burst_length = 3: must be 1 where"),
        (loss("burst", burst_length=0.5), "loss.burst_length = 0.5: must be"),
        (loss("burst", 0.9, burst_length=2),
         "loss.probability = 0.9: must be >= 0 and <= 0.666667"),
        (loss("burst", good_loss=0.2), "loss.probability = 0.1: must be >= 0.2"),
        (loss("burst", 0.0, good_loss=0.5, bad_loss=0.5),
         "loss.bad_loss = 0.5: must be > good_loss"),
        (loss("gilbert_elliott"), "loss.probability = 0.1: must be 0 where"),
        (loss("gilbert_elliott", 0.0, to_good=0), "loss.to_good = 0: must be .* > 0"),
        (loss("gilbert_elliott", 0.0, good_loss=1), "loss.bad_loss = 1.0: must be > g"),
        (loss("burst", to_bad=0.1), "loss.to_bad = 0.1: must be 0 where"),
        (jitter("uniform", hold=1.5), "jitter.hold = 1.5: must be"),
        (jitter("none", hold=0.5), "jitter.hold = 0.5: must be 0 where"),
        ({"duplicates": 2.0}, "duplicates = 2.0: must be a finite number >= 0 and <="),
    ],
)  # fmt: skip
def test_bad_parameters(arguments, message):
    with pytest.raises(ValueError, match=message):
        make(**arguments)


# Statistics, against counting the packets one by one.


@pytest.mark.parametrize(
    "receiver",
    Slow([Receiver(policy="playout", depth=0.02), Receiver()]),
    ids=lambda receiver: receiver.policy,
)
def test_statistics_against_counting(receiver, subtests):
    network = make(**BUSY, h=0.01, seed=4)
    end = 7.003
    result = ComputePacketStatistics(network, receiver, end)
    sent = 701
    arrivals = network.Arrivals(sent)
    received = [k for k in range(sent) if arrivals[k] <= end]
    d = np.array([arrivals[k] - k * 0.01 for k in range(sent)])
    is_late = d[received] > MEAN + receiver.depth
    # What arrives after the end counts as well: the slowest packets are among it.
    d = d[np.isfinite(d)]
    assert len(d) > len(received) and result.delay_maximum == pytest.approx(max(d))
    assert result.sent == sent
    assert result.received == len(received)
    assert result.lost == sum(math.isinf(a) for a in arrivals)
    assert result.loss_rate == result.lost / sent
    assert result.reordered == sum(
        any(arrivals[j] < arrivals[k] for j in received if j > k) for k in received
    )
    assert result.reordered > 50
    late = sum(is_late) if receiver.policy == "playout" else 0
    assert result.late == late
    assert result.delay_mean == pytest.approx(d.mean())
    for key, percent in (
        ("minimum", 0),
        ("median", 50),
        ("p95", 95),
        ("p99", 99),
        ("maximum", 100),
    ):
        with subtests.test(key=key):
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

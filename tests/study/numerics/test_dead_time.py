"""Tests of teleop_drake.study.numerics.dead_time and signal_pair."""

import numpy as np
import pytest

from teleop_drake.study.numerics.dead_time import (
    common_count,
    find_dead_time,
    independent_count,
)
from teleop_drake.study.numerics.lagged_signal import Lag
from teleop_drake.study.numerics.signal_pair import Fit, SignalPair

STEP = 0.02
TIME = np.arange(400) * STEP


def Autoregressive(a, num, seed):
    """Returns a first-order autoregressive sequence."""
    noise = np.random.default_rng(seed).standard_normal(num)
    values = np.zeros(num)
    for k in range(1, num):
        values[k] = a * values[k - 1] + noise[k]
    return values


@pytest.mark.parametrize("a", [0.0, 0.5, 0.9])
def test_independent_rows_of_an_autoregressive_sequence(a):
    """Its autocorrelation is a^k, so that their sum over all k is (1 + a)/(1 - a)."""
    counts = [independent_count(Autoregressive(a, 4000, seed)) for seed in range(8)]
    assert np.median(counts) == pytest.approx(4000 * (1 - a) / (1 + a), rel=0.15)


def test_independent_pairs_of_autoregressive_sequences():
    """The products of their autocorrelations are (a b)^k."""
    counts = [
        common_count(Autoregressive(0.9, 20000, s), Autoregressive(0.8, 20000, s + 50))
        for s in range(6)
    ]
    expected = 20000 * (1 - 0.72) / (1 + 0.72)
    assert np.median(counts) == pytest.approx(expected, rel=0.1)


def Pair(delay, maximum=1.0):
    def Signal(times):
        return np.sin(2.1 * times) + 0.6 * np.sin(5.3 * times + 1)

    return SignalPair(TIME, Signal(TIME), TIME, Signal(TIME - delay), maximum)


def test_sum_of_squares_is_that_of_the_definition():
    """With the right dead time nothing is left; with another, what a fit leaves."""
    pair = Pair(0.31)
    assert np.abs(pair.residuals(Fit(0.31, 0.0, Lag(), 0.0))).max() < 1e-4
    z = np.sin(2.1 * (pair.t - 0.2)) + 0.6 * np.sin(5.3 * (pair.t - 0.2) + 1)
    columns = np.column_stack([np.ones(len(z)), z])
    _, squares, *_ = np.linalg.lstsq(columns, pair.y)
    found = np.sum(pair.residuals(Fit(0.2, 0.0, Lag(), 0.0)) ** 2)
    assert found == pytest.approx(float(squares[0]), rel=1e-3)


def test_rows_without_a_known_command_are_left_out():
    pair = Pair(0.31, maximum=2.5)
    assert pair.t[0] == pytest.approx(2.5)
    assert pair.t[-1] == TIME[-1]


@pytest.mark.parametrize("delay", [0.0, 0.02, 0.31, 0.95])
def test_first_search_finds_every_dead_time(delay):
    found = find_dead_time(Pair(delay), [0])
    assert found.fit.delay == pytest.approx(delay, abs=1e-4)
    best = found.search[0, np.argmin(found.search[1])]
    assert best == pytest.approx(delay, abs=STEP / 8)


def test_stepwise_commands_are_recognised():
    steps = np.floor(TIME / 0.7) % 2
    assert SignalPair(TIME, steps, TIME, steps, 1.0).is_stepwise
    assert not Pair(0.1).is_stepwise
    ramps = np.minimum(TIME % 2, 1.0)
    assert not SignalPair(TIME, ramps, TIME, ramps, 1.0).is_stepwise

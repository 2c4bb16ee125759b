"""Tests of teleop_drake.study.numerics.delay_course."""

import numpy as np
import pytest

from teleop_drake.study.numerics.dead_time import find_dead_time
from teleop_drake.study.numerics.delay_course import (
    delay_course,
    drift_error,
    missing_packets,
    row_spread,
)
from teleop_drake.study.numerics.lagged_signal import Lag
from teleop_drake.study.numerics.signal_pair import Fit, SignalPair

TIME = np.arange(1000) * 0.01
DELAY = 0.2


def Signal(times):
    return np.sin(2.1 * times) + 0.6 * np.sin(5.3 * times + 1)


def Pair(response):
    return SignalPair(TIME, Signal(TIME), TIME, response, 1.0)


def test_course_finds_a_jump_of_the_delay():
    delays = np.where(TIME < 6, DELAY, DELAY + 0.15)
    pair = Pair(Signal(TIME - delays))
    fit = find_dead_time(pair, [0]).fit
    course = delay_course(pair, fit, 15)
    inner = np.abs(course.times - 6) > 0.7
    expected = np.where(course.times < 6, DELAY, DELAY + 0.15)
    assert course.delays[inner] == pytest.approx(expected[inner], abs=0.03)


def test_course_is_unknown_where_nothing_moves():
    command = np.where(TIME < 5, Signal(TIME), Signal(5.0))
    response = np.where(TIME < 5 + DELAY, Signal(TIME - DELAY), Signal(5.0))
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(TIME))
    pair = SignalPair(TIME, command, TIME, response + noise, 1.0)
    course = delay_course(pair, Fit(DELAY, 0.0, Lag(), 0.0), 9)
    assert np.isfinite(course.delays[course.times < 5]).all()
    assert np.isnan(course.delays[course.times > 6.5]).all()


def test_standard_error_of_the_drift():
    """It is that of many records with other noise."""
    drifts = []
    errors = []
    for seed in range(30):
        noise = 0.1 * np.random.default_rng(seed).standard_normal(len(TIME))
        pair = Pair(Signal(TIME - DELAY) + noise)
        fit = pair.refine(Fit(DELAY, 0.0, Lag(), 0.0))
        drifts.append(fit.drift)
        errors.append(drift_error(pair, fit, len(pair.y)))
    assert np.std(drifts) == pytest.approx(np.mean(errors), rel=0.35)


def test_spread_and_noise_are_told_apart():
    draw = np.random.default_rng(2)
    delays = DELAY + 0.01 * draw.standard_normal(len(TIME))
    noise = 0.03 * draw.standard_normal(len(TIME))
    pair = Pair(Signal(TIME - delays) + noise)
    found = row_spread(pair, Fit(DELAY, 0.0, Lag(), 0.0))
    assert found.spread == pytest.approx(0.01, abs=3 * found.error)
    assert found.error < 0.002
    assert found.noise == pytest.approx(0.03, rel=0.15)


def test_missing_packets_counts_packets():
    """Packets every third row; of 100 packets, those with a 7 at the end are lost."""
    packets = np.arange(334) * 0.03
    got = packets[np.arange(334) % 10 != 7]
    last = np.searchsorted(got, TIME - DELAY + 1e-9, side="right") - 1
    pair = Pair(Signal(got[np.maximum(last, 0)]))
    fit = find_dead_time(pair, [0]).fit
    assert missing_packets(pair, fit).share == pytest.approx(0.1, abs=0.02)


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
def test_missing_packets_of_packets_with_jitter(loss):
    """Gaps that vary by more than half a period are no losses."""
    draw = np.random.default_rng(5)
    packets = np.arange(490) * 0.02
    came = draw.random(490) >= loss
    arrivals = (packets + DELAY + draw.uniform(-0.008, 0.008, 490))[came]
    last = np.searchsorted(arrivals, TIME, side="right") - 1
    pair = Pair(Signal(packets[came][np.maximum(last, 0)]))
    fit = find_dead_time(pair, [0]).fit
    found = missing_packets(pair, fit).share
    assert found == pytest.approx(np.mean(~came[50:]), abs=0.03)


@pytest.mark.parametrize("jitter", [0.004, 0.012])
def test_packets_that_are_replaced_between_two_rows(jitter):
    """The rows show a known number of packets; less is lost, by at most `hidden`."""
    draw = np.random.default_rng(1)
    packets = np.arange(480) * 0.02
    arrivals = packets + DELAY + draw.exponential(jitter, 480)
    order = np.argsort(arrivals)[draw.random(480) >= 0.11]
    # The receiver drops what was overtaken.
    newest = np.maximum.accumulate(packets[order])
    last = np.searchsorted(arrivals[order], TIME, side="right") - 1
    pair = Pair(Signal(newest[np.maximum(last, 0)]))
    found = missing_packets(pair, find_dead_time(pair, [0]).fit)
    missed = 1 - len(np.unique(newest)) / 480
    in_rows = np.unique(newest[last[last >= 0]])
    assert found.share == pytest.approx(1 - len(in_rows) / 480, abs=0.03)
    assert found.share - found.hidden - 0.02 < missed < found.share + 0.02
    assert found.hidden < 0.1


def test_missing_packets_is_unknown_with_noise():
    noise = 0.2 * np.random.default_rng(3).standard_normal(len(TIME))
    pair = Pair(Signal(TIME - DELAY) + noise)
    assert missing_packets(pair, Fit(DELAY, 0.0, Lag(), 0.0)) is None

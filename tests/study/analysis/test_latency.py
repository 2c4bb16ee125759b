"""Tests of teleop_drake.study.analysis.latency on signals whose delay is known.

The command is a sum of sines. A lag turns and scales each of them, so that the response
is known in closed form.
"""

import json

import numpy as np
import pytest

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.study.analysis.latency import EstimateLatency

H = 0.02
TIME = np.arange(600) * H
DELAY = 0.1537

# Frequencies in rad/s, not commensurate, with amplitudes and phases.
W = np.array([0.9, 2.3, 3.7, 5.9, 8.1, 11.3])
AMPLITUDES = np.array([1.0, 0.8, 0.7, 0.5, 0.4, 0.3])
PHASES = np.array([0.3, 1.9, 4.0, 5.2, 0.8, 2.6])


def Signal(times, transfer=np.ones_like):
    """Returns the sum of sines after a lag of a transfer function, at times in s."""
    factors = transfer(1j * W) * AMPLITUDES * np.exp(1j * PHASES)
    return np.imag(np.exp(1j * np.multiply.outer(times, W)) @ factors)


def Noise(seed=1):
    return np.random.default_rng(seed).standard_normal(len(TIME))


def First(s):
    return 1 / (0.08 * s + 1)


def Second(s):
    return 1 / ((0.06 * s) ** 2 + 2 * 0.5 * 0.06 * s + 1)


COMMAND = Signal(TIME)
RESPONSE = Signal(TIME - DELAY)


def Holds(latency, delay=DELAY):
    """Returns whether the interval holds a dead time, and the estimate is in it."""
    low, high = latency.interval
    return low <= delay <= high and low <= latency.delay <= high


LAGS = {"none": np.ones_like, "first": First, "second": Second}


CASES = [
    ("none", 0.0),
    ("none", 0.3),
    ("first", 0.02),
    ("first", 0.3),
    ("second", 0.0),
    ("second", 0.1),
]


@pytest.mark.mostly_slow
@pytest.mark.parametrize(("lag", "noise"), CASES)
def test_dead_time_and_lag_are_told_apart(lag, noise):
    response = 1.7 * Signal(TIME - DELAY, LAGS[lag]) - 0.4 + noise * Noise()
    latency = EstimateLatency(TIME, COMMAND, response, lag=lag)
    assert Holds(latency)
    assert latency.delay == pytest.approx(DELAY, abs=1e-4 + 0.05 * noise)
    assert latency.gain == pytest.approx(1.7, rel=1e-3 + 0.1 * noise)
    assert latency.lag.order == list(LAGS).index(lag)
    if lag != "none":
        expected = {"first": 0.08, "second": 0.06}[lag]
        assert latency.lag.time == pytest.approx(expected, rel=0.01 + 0.5 * noise)
    if lag == "second":
        assert latency.lag.damping == pytest.approx(0.5, rel=0.01 + noise)
    delays, errors = latency.search
    assert delays[errors.argmin()] == pytest.approx(latency.delay, abs=H)


def test_a_lag_that_is_not_allowed_goes_into_the_delay():
    """A first-order lag delays slow signals by its time constant."""
    response = Signal(TIME - DELAY, First)
    latency = EstimateLatency(TIME, COMMAND, response, lag="none")
    assert latency.delay == pytest.approx(DELAY + 0.08, abs=0.02)
    assert latency.interval[0] > DELAY


@pytest.mark.slow
def test_interval_has_its_confidence():
    """At least 95 % of the intervals of many records hold the dead time."""
    hits = []
    for seed in range(40):
        response = RESPONSE + 0.3 * Noise(seed)
        found = EstimateLatency(TIME, COMMAND, response, lag="none", maximum=1.0)
        hits.append(Holds(found))
    assert sum(hits) >= 36
    widths = np.diff(found.interval)
    # The Cramer-Rao bound of a dead time in white noise, for 95 % to both sides.
    slope = np.gradient(COMMAND, H)[TIME > 1.0]
    assert widths == pytest.approx(2 * 1.96 * 0.3 / np.linalg.norm(slope), rel=0.15)


def test_quantised_signals():
    command = np.round(COMMAND, 1)
    response = np.round(RESPONSE, 1)
    latency = EstimateLatency(TIME, command, response, lag="first")
    assert Holds(latency)
    # Rounding looks like a lag of half a row.
    assert latency.delay + latency.lag.mean_delay == pytest.approx(DELAY, abs=2e-3)
    direct = EstimateLatency(TIME, command, response, lag="none")
    assert direct.delay == pytest.approx(DELAY, abs=2e-3)
    assert direct.spread < 3 * direct.spread_error


def test_drift_is_a_change_of_the_delay():
    drift = 2e-3
    delays = DELAY + drift * (TIME - TIME[-1] / 2)
    response = Signal(TIME - delays) + 0.02 * Noise()
    latency = EstimateLatency(TIME, COMMAND, response, lag="none")
    assert latency.delay == pytest.approx(DELAY, abs=1e-3)
    assert latency.drift == pytest.approx(drift, abs=4 * latency.drift_error)
    assert latency.drift_error < 1e-4
    expected = np.interp(latency.course.times, TIME, delays)
    errors = (latency.course.delays - expected) / latency.course.errors
    assert np.abs(errors).max() < 4


@pytest.mark.mostly_slow
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_spread_of_delays_that_differ_from_row_to_row(noise):
    """They also blur the response, which must not be taken for a lag."""
    delays = DELAY + 0.02 * Noise(2)
    response = Signal(TIME - delays) + noise * Noise()
    latency = EstimateLatency(TIME, COMMAND, response, lag="first")
    assert latency.lag.order == 0
    assert latency.delay == pytest.approx(DELAY, abs=3e-3)
    assert latency.spread == pytest.approx(0.02, abs=3 * latency.spread_error)
    assert latency.spread_error < 0.002
    assert Holds(latency)


def test_a_constant_delay_has_no_spread():
    latency = EstimateLatency(TIME, COMMAND, RESPONSE + 0.05 * Noise(), lag="none")
    assert latency.spread < 3 * latency.spread_error + 1e-3
    assert latency.losses is None or latency.losses == 0


def Held(sent, lost):
    """Returns the response of a receiver that holds what arrived last."""
    got = sent[~lost]
    k = np.searchsorted(got, TIME - DELAY + 1e-9, side="right") - 1
    return Signal(np.where(k >= 0, got[np.maximum(k, 0)], 0.0))


def test_losses_of_packets_that_are_held():
    sent = np.arange(int(TIME[-1] / (2 * H)) + 1) * 2 * H
    lost = np.random.default_rng(4).random(len(sent)) < 0.15
    latency = EstimateLatency(TIME, COMMAND, Held(sent, lost), lag="none")
    assert latency.losses == pytest.approx(lost.mean(), abs=0.02)
    received = EstimateLatency(TIME, COMMAND, Held(sent, lost & False), lag="none")
    assert received.losses == 0


def test_irregular_rows():
    times = np.sort(np.random.default_rng(5).uniform(0, 12, 600))
    response = Signal(times - DELAY)
    latency = EstimateLatency(times, Signal(times), response, lag="none")
    assert latency.delay == pytest.approx(DELAY, abs=2e-3)
    assert latency.losses in (0, None)


def test_missing_values_are_left_out():
    command = np.where(np.arange(600) % 3 == 0, COMMAND, np.nan)
    response = np.where(np.arange(600) % 3 == 1, RESPONSE, np.nan)
    latency = EstimateLatency(TIME, command, response, lag="none")
    assert latency.delay == pytest.approx(DELAY, abs=2e-3)


UNKNOWN = {
    "exact ramp": (2 * TIME, 2 * (TIME - DELAY), "explain the record"),
    "ramp": (2 * TIME, 2 * (TIME - DELAY) + 0.01 * Noise(), "explain the record"),
    "sine": (np.sin(6 * TIME), np.sin(6 * (TIME - DELAY)), "explain the record"),
    "constant": (0 * TIME, Noise(), "the command never changes"),
    "dead": (COMMAND, 0 * TIME, "the response never changes"),
    "early": (TIME > 0.5, TIME > 0.5 + DELAY, "the response never changes after 1 s"),
    "one jump": (
        TIME > 4.0,
        TIME > 4.0 + DELAY,
        "as with a command that has few jumps",
    ),
    "unrelated": (COMMAND, Noise(), "the response does not follow the command"),
}


@pytest.mark.mostly_slow
@pytest.mark.parametrize("name", UNKNOWN)
def test_what_cannot_be_told_is_not_told(name):
    command, response, reason = UNKNOWN[name]
    # Every dead time up to the largest is tried; a second of them is enough.
    latency = EstimateLatency(TIME, command, response, lag="first", maximum=1.0)
    assert latency.delay is None
    assert reason in latency.reason
    with pytest.raises(ScenarioError, match=reason):
        latency.Trace()
    json.dumps(latency.ToRecord(), allow_nan=False)


def test_a_sine_without_a_lag_repeats():
    """Without a lag, a sine is known up to half periods."""
    command = np.sin(3 * TIME)
    response = np.sin(3 * (TIME - DELAY)) + 0.02 * Noise()
    latency = EstimateLatency(TIME, command, response, lag="none", maximum=3.0)
    assert latency.delay is None
    assert "a command that repeats" in latency.reason
    short = EstimateLatency(TIME, command, response, lag="none", maximum=0.9)
    assert short.delay == pytest.approx(DELAY, abs=1e-3)


def test_a_dead_time_that_is_too_long_is_not_told():
    latency = EstimateLatency(TIME, COMMAND, RESPONSE, lag="none", maximum=0.1)
    assert latency.delay is None


def test_steps_are_known_to_a_row():
    """A command that jumps between two rows jumps at an unknown instant."""
    jumps = np.array([1.03, 2.9, 5.317, 6.0, 8.81, 10.42, 13.333, 15.1])
    command = np.searchsorted(jumps, TIME, side="right") % 2.0
    response = np.searchsorted(jumps, TIME - DELAY, side="right") % 2.0
    latency = EstimateLatency(TIME, command, response, lag="none")
    assert Holds(latency)
    assert latency.interval[1] - latency.interval[0] < 4 * H


def test_trace_has_the_course():
    delays = DELAY + 0.05 * np.sin(0.5 * TIME)
    response = Signal(TIME - delays)
    times, found = EstimateLatency(TIME, COMMAND, response, lag="none").Trace()
    assert times[0] == 0
    assert np.all(np.diff(times) > 0)
    # A trace counts from when a value left, the delays here from when it arrived.
    inner = slice(1, None)
    arrived = times[inner] + found[inner]
    assert found[inner] == pytest.approx(np.interp(arrived, TIME, delays), abs=6e-3)


REFUSED = [
    ({"lag": "third"}, "lag = 'third': must be one of none, first, second"),
    ({"maximum": 0.0}, "maximum = 0.0: must be a finite number > 0"),
    ({"maximum": 12.0}, "maximum = 12.0: must be a finite number > 0 and <= 5.99"),
    ({"command": COMMAND[:-1]}, "command = "),
    ({"response": np.full(600, np.nan)}, "response = 0: must be 50 finite rows"),
    ({"time": TIME[::-1]}, "time = 'rows that do not ascend'"),
]


@pytest.mark.parametrize(("change", "message"), REFUSED)
def test_bad_input(change, message):
    arguments = {"time": TIME, "command": COMMAND, "response": RESPONSE}
    with pytest.raises(ScenarioError, match=message):
        EstimateLatency(**(arguments | change))

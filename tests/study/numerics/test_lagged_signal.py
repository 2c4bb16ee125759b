"""Tests of teleop_drake.study.numerics.lagged_signal."""

import numpy as np
import pytest

from teleop_drake.study.numerics.lagged_signal import Lag, free_motions, lagged

TIME = np.arange(400) * 0.01
TAU = 0.13

# The responses to a ramp u = t in closed form.
RESPONSES = {
    Lag(): TIME,
    Lag(1, TAU): TIME - TAU * (1 - np.exp(-TIME / TAU)),
    Lag(2, TAU, 1.0): TIME - 2 * TAU + (2 * TAU + TIME) * np.exp(-TIME / TAU),
    # Two first-order lags, TAU and 3 TAU, one after the other.
    Lag(2, TAU * np.sqrt(3), 2 / np.sqrt(3)): TIME
    - 4 * TAU
    + TAU * (9 * np.exp(-TIME / (3 * TAU)) - np.exp(-TIME / TAU)) / 2,
}


@pytest.mark.parametrize("lag", RESPONSES)
def test_response_to_a_ramp_is_exact(lag):
    assert lagged(TIME, 0.01, lag) == pytest.approx(RESPONSES[lag], abs=1e-12)


def test_underdamped_response_to_a_ramp():
    lag = Lag(2, TAU, 0.3)
    w = np.sqrt(1 - 0.3**2) / TAU
    decay = np.exp(-0.3 * TIME / TAU)
    # z = t - 2 zeta tau + decay (2 zeta tau cos w t + B sin w t), z'(0) = 0.
    B = (0.3 * 0.6 - 1) / w
    free = 0.6 * TAU * np.cos(w * TIME) + B * np.sin(w * TIME)
    expected = TIME - 0.6 * TAU + decay * free
    assert lagged(TIME, 0.01, lag) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("lag", [Lag(1, 0.2), Lag(2, 0.2, 0.4), Lag(2, 0.2, 2.5)])
def test_a_lag_starts_at_rest(lag):
    assert lagged(np.full(50, 3.5), 0.01, lag) == pytest.approx(3.5)


@pytest.mark.parametrize("lag", [Lag(1, 0.2), Lag(2, 0.2, 0.4), Lag(2, 0.2, 2.5)])
def test_free_motions_explain_the_difference_of_two_starts(lag):
    """After the signals agree, two responses differ by a free motion."""
    late = TIME >= 1
    first = lagged(np.sin(5 * TIME), 0.01, lag)
    second = lagged(np.where(late, np.sin(5 * TIME), 0.7), 0.01, lag)
    motions = free_motions(TIME[late], lag)
    difference = (first - second)[late]
    best, *_ = np.linalg.lstsq(motions[1:], difference[1:])
    assert motions[1:] @ best == pytest.approx(difference[1:], abs=1e-9)
    assert motions.shape[1] == lag.order


def test_mean_delay_is_that_of_a_ramp():
    for lag, response in RESPONSES.items():
        assert TIME[-1] - response[-1] == pytest.approx(lag.mean_delay, abs=2e-3)

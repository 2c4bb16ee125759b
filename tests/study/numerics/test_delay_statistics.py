"""Tests of teleop_drake.study.numerics.delay_statistics."""

import numpy as np
import pytest
from scipy.optimize import linprog

from teleop_drake.study.numerics.delay_statistics import (
    burst_lengths,
    delay_autocorrelation,
    least_delay_line,
    least_delay_slope_error,
)

NUM = 2000
TIMES = np.arange(NUM) * 0.02


def test_burst_lengths():
    is_lost = np.array([1, 0, 0, 1, 1, 0, 1, 1, 1], dtype=bool)
    assert burst_lengths(is_lost).tolist() == [1, 2, 3]
    assert burst_lengths(np.zeros(5, dtype=bool)).tolist() == []


def test_autocorrelation_of_an_autoregressive_sequence():
    draw = np.random.default_rng(1)
    noise = draw.standard_normal(20_000)
    delays = np.zeros(20_000)
    for k in range(1, 20_000):
        delays[k] = 0.8 * delays[k - 1] + noise[k]
    delays[draw.random(20_000) < 0.1] = np.nan
    found = delay_autocorrelation(delays, 6)
    assert found == pytest.approx(0.8 ** np.arange(6), abs=0.05)


def test_equal_delays_have_no_autocorrelation():
    assert np.isnan(delay_autocorrelation(np.full(9, 0.1), 3)).all()


@pytest.mark.parametrize("seed", range(5))
def test_line_is_that_of_linear_programming(seed):
    """Minimise the sum of (d - a - b t) with a + b t <= d."""
    draw = np.random.default_rng(seed)
    times = np.sort(draw.uniform(0, 40, 300))
    delays = 0.05 + 3e-4 * times + draw.exponential(0.01, 300)
    value, slope = least_delay_line(times, delays)
    columns = np.column_stack([np.ones(300), times])
    best = linprog(-columns.sum(axis=0), columns, delays, bounds=(None, None))
    assert columns.sum(axis=0) @ [value, slope] == pytest.approx(-best.fun, rel=1e-6)
    assert np.all(value + slope * times <= delays + 1e-12)


@pytest.mark.parametrize("drift", [0.0, 1e-4, -5e-4])
def test_slope_is_the_drift_under_queues(drift):
    draw = np.random.default_rng(7)
    delays = 0.08 + drift * TIMES + draw.exponential(0.02, NUM)
    _, slope = least_delay_line(TIMES, delays)
    error = least_delay_slope_error(TIMES, delays, 10)
    assert error < 5e-5
    assert slope == pytest.approx(drift, abs=4 * error)


def test_two_delays_have_a_line():
    assert least_delay_line(np.array([0.0, 2.0]), np.array([1.0, 2.0])) == (1.0, 0.5)

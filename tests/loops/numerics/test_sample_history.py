"""Tests of the stored samples of a delayed signal."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.loops.numerics.sample_history import (
    EnoPolynomial,
    SampleHistory,
    stencil_window,
)

DELAY = 0.1


@given(steps=st.lists(st.floats(0.005, DELAY), min_size=10, max_size=80))
def test_a_new_sample_does_not_move_what_is_delivered_now(steps):
    history = SampleHistory()
    time = 0.0
    for step in steps:
        value = np.array([np.sin(9 * time), np.cos(40 * time)])
        before = history.eval(time) if time > DELAY else None
        history = history.append(time + DELAY, value, now=time, spacing=DELAY / 1024)
        if before is not None:
            assert_array_equal(history.eval(time), before)
        time += step


def test_evaluating_it_changes_nothing():
    asked = left_alone = SampleHistory()
    for time in np.arange(0.0, 2.0, 0.03).tolist():
        value = np.array([np.sin(9 * time)])
        asked, left_alone = (
            history.append(time + DELAY, value, now=time, spacing=DELAY / 1024)
            for history in (asked, left_alone)
        )
        for ahead in (0.0, 0.01, 0.09):
            asked.eval(time + ahead)
    for time in (2.0, 2.03, 2.06):
        assert_array_equal(asked.eval(time), left_alone.eval(time))


def between(times, values, num=11):
    """Returns times within the intervals of a signal and the interpolated values."""
    query = []
    result = []
    for i in np.flatnonzero(np.diff(times) > 0).tolist():
        polynomial = EnoPolynomial(times.tolist(), values[:, np.newaxis], i)
        t = np.linspace(times[i], times[i + 1], num)
        query.append(t)
        result.append([polynomial.eval(s)[0] for s in t.tolist()])
    return np.array(query), np.array(result)


def test_order_of_convergence():
    errors = []
    for count in (30, 60):
        times = np.linspace(0, 3, count)
        t, result = between(times, np.sin(5 * times))
        errors.append(np.abs(result - np.sin(5 * t))[8:-8].max())
    assert errors[0] / errors[1] > 2**7.5


def test_a_jump_stays_a_jump():
    times = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.0, 1.3, 1.7, 2.0])
    t, result = between(times, np.where(np.arange(9) < 5, times**2, 10 - times))
    assert_allclose(result[:4], t[:4] ** 2, atol=1e-8)
    assert_allclose(result[4:], 10 - t[4:], atol=1e-8)


def test_a_nonsmooth_point_does_not_ring():
    times = np.linspace(-1, 1, 21)
    t, result = between(times, np.abs(times))
    assert_allclose(result, np.abs(t), atol=1e-12)


def test_clustered_samples_do_not_amplify_rounding():
    cluster = 1.0 + np.cumsum(np.full(30, 1e-7))
    times = np.concatenate([np.linspace(0, 0.95, 20), cluster, np.arange(1.1, 2, 0.1)])
    t, result = between(times, np.sin(times))
    assert np.abs(result - np.sin(t))[:-2].max() < 1e-8


@pytest.mark.parametrize(
    ("i", "indices"), [(3, [3, 4, 5]), (4, [3, 4, 5]), (0, [0, 1, 2])]
)
def test_a_stencil_stops_at_jumps(i, indices):
    assert stencil_window([0.0, 1.0, 2.0, 2.0, 3.0, 4.0, 4.0, 5.0], i) == indices


def test_a_nonsmooth_point_soon_after_a_jump_does_not_reach_back():
    """A control force that jumps, is constant, and then begins to fall."""
    held = [0, 0.003, 0.0178, 0.0199, 0.0206, 0.0211, 0.0213, 0.0225, 0.0236, 0.0253]
    times = np.array([-0.0022, 0.0, *held])
    values = np.array([0.00436, 0.00348, *[0.2] * 7, 0.17756, 0.15753, 0.13281])
    _, result = between(times, values)
    assert result.max() < 0.2 + 1e-12
    assert_allclose(result[1:7], 0.2, rtol=1e-12)

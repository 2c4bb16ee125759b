"""Tests of the ENO interpolation against functions it must reproduce."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from teleop_drake.numerics.interpolation import (
    evaluate_newton,
    fill_rest,
    fill_window,
    fit_series,
    interpolate,
)
from teleop_drake.numerics.newton_polynomials import NUM_STENCIL_POINTS


def window_of(times, i):
    """Returns the samples for interval i, and the place of i among them."""
    window = np.empty(2 * NUM_STENCIL_POINTS - 2, int)
    first, end = fill_window(times, i, window), fill_rest(times, i, window)
    samples = window[first:end]
    return samples, samples.tolist().index(i)


def newton_polynomial(times, values, i):
    """Returns the polynomials with all of their terms."""
    samples, _ = window_of(times, i)
    polynomials = np.zeros((2, NUM_STENCIL_POINTS, values.shape[1]))
    for j in range(values.shape[1]):
        places = np.empty(len(samples))
        fit_series(times, values, i, j, samples, places, polynomials)
    return polynomials


@given(
    steps=st.lists(st.floats(0.3, 1.0), min_size=NUM_STENCIL_POINTS, max_size=20),
    coefficients=st.lists(st.floats(-1, 1), min_size=1, max_size=NUM_STENCIL_POINTS),
    fraction=st.floats(0, 1),
)
def test_polynomials_are_exact(steps, coefficients, fraction):
    times = np.concatenate([[0.0], np.cumsum(steps)])
    times /= times[-1]
    values = np.polyval(coefficients, times)
    for i in range(len(times) - 1):
        t = times[i] + fraction * (times[i + 1] - times[i])
        polynomial = newton_polynomial(times, np.stack([values, -values], axis=1), i)
        expected = np.polyval(coefficients, t) * np.array([1, -1])
        for form in (polynomial, polynomial.tolist()):
            result = evaluate_newton(form, t)
            np.testing.assert_allclose(result, expected, rtol=0, atol=1e-9)


def test_order_of_convergence():
    errors = []
    query = np.linspace(0.5, 2.5, 1001)
    for count in (30, 60):
        times = np.linspace(0, 3, count)
        result = interpolate(times, np.sin(5 * times)[:, np.newaxis], query)
        errors.append(np.abs(result[:, 0] - np.sin(5 * query)).max())
    assert errors[0] / errors[1] > 2 ** (NUM_STENCIL_POINTS - 0.5)


def test_jump_stays_a_jump():
    times = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.0, 1.3, 1.7, 2.0])
    values = np.where(np.arange(9) < 5, times**2, 10 - times)[:, np.newaxis]
    query = np.array([0.1, 0.99, 1.0, 1.0 + 1e-9, 1.5, 2.0])
    expected = np.where(query <= 1.0, query**2, 10 - query)
    np.testing.assert_allclose(
        interpolate(times, values, query)[:, 0], expected, atol=1e-8
    )


def test_nonsmooth_point_does_not_ring():
    times = np.linspace(-1, 1, 21)
    query = np.linspace(-1, 1, 999)
    result = interpolate(times, np.abs(times)[:, np.newaxis], query)[:, 0]
    # The nonsmooth point is at a sample: the interpolant is exact on both sides of it.
    np.testing.assert_allclose(result, np.abs(query), atol=1e-12)


def test_clustered_samples_do_not_amplify_rounding():
    cluster = 1.0 + np.cumsum(np.full(30, 1e-7))
    times = np.concatenate([np.linspace(0, 0.95, 20), cluster, np.arange(1.1, 2, 0.1)])
    result = interpolate(
        times, np.sin(times)[:, np.newaxis], query := np.linspace(0, 1.9, 5000)
    )
    assert np.abs(result[:, 0] - np.sin(query)).max() < 1e-8


@pytest.mark.parametrize(
    "i, indices, place", [(3, [3, 4, 5], 0), (4, [3, 4, 5], 1), (0, [0, 1, 2], 0)]
)
def test_window_stops_at_jumps(i, indices, place):
    times = np.array([0.0, 1.0, 2.0, 2.0, 3.0, 4.0, 4.0, 5.0])
    window, position = window_of(times, i)
    assert (window.tolist(), position) == (indices, place)


def test_queries_are_clamped_and_hold_constant_signals():
    times, values = np.array([1.0, 2.0]), np.array([[3.0], [3.0]])
    np.testing.assert_array_equal(
        interpolate(times, values, np.array([0.0, 1.5, 9.0]))[:, 0], [3.0, 3.0, 3.0]
    )


def test_many_queries_are_as_one():
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.1, 1.0, 30))
    times[12] = times[11]
    values = rng.normal(size=(30, 3))
    query = np.sort(rng.uniform(times[0], times[-1], 200))
    together = interpolate(times, values, query)
    for t, row in zip(query, together, strict=True):
        np.testing.assert_array_equal(
            interpolate(times, values, np.array([t])), row[np.newaxis]
        )
    assert interpolate(times, values, np.empty(0)).shape == (0, 3)


# Samples of a control force that is held behind a jump and then begins to fall.
HELD_TIMES = [0, 0.003, 0.0178, 0.0199, 0.0206, 0.0211, 0.0213, 0.0225, 0.0236, 0.0253]
HELD_FORCES = [0.2] * 7 + [0.17756, 0.15753, 0.13281]


def test_a_nonsmooth_point_soon_after_a_jump_does_not_reach_back():
    times = np.array([-0.0022, 0.0, *HELD_TIMES])
    values = np.array([0.00436, 0.00348, *HELD_FORCES])[:, np.newaxis]
    query = np.linspace(1e-9, HELD_TIMES[-1], 3000)
    result = interpolate(times, values, query)[:, 0]
    assert result.max() < 0.2 + 1e-12
    np.testing.assert_allclose(result[query < HELD_TIMES[6]], 0.2, rtol=1e-12)


# How far interpolation may leave the samples of a signal of straight lines, as a share
# of their range. Six samples of two corners may lie on a parabola: nothing tells them
# from one, whose peak may be a third of their range beyond them, as in PARABOLA. Of one
# corner, no more than four do.
EXCESS_BY_CORNERS = {1: 0.01, 2: 0.334}

PARABOLA_TIMES = np.array([0, 0.25, 0.5, 1.5, 1.75, 2])
PARABOLA = PARABOLA_TIMES, -((PARABOLA_TIMES - 1) ** 2), 2


@st.composite
def segment(draw):
    """Times and samples of straight lines, and between how many corners they run."""
    steps = draw(st.lists(st.floats(0.05, 1.0), min_size=1, max_size=16))
    times = np.concatenate([[0.0], np.cumsum(steps)])
    places = draw(st.lists(st.floats(0, 1), min_size=1, max_size=2))
    slopes = draw(
        st.lists(st.floats(-1, 1, width=16), min_size=len(places), max_size=len(places))
    )
    values = draw(st.floats(-1, 1, width=16)) + sum(
        slope * np.maximum(0, times - place * times[-1])
        for slope, place in zip(slopes, places, strict=True)
    )
    return times, values, len(places)


@given(segments=st.lists(segment(), min_size=1, max_size=3))
@example(segments=[PARABOLA])
def test_nonsmooth_points_and_jumps_stay_within_the_samples(segments):
    start, parts = 0.0, []
    for times, values, num_corners in segments:
        parts.append((start + times, values, EXCESS_BY_CORNERS[num_corners]))
        start += times[-1]
    times, values = (np.concatenate([part[i] for part in parts]) for i in range(2))
    for own_times, own_values, allowed in parts:
        query = np.linspace(own_times[0], own_times[-1], 200)[1:-1]
        result = interpolate(times, values[:, np.newaxis], query)[:, 0]
        excess = max(result.max() - own_values.max(), own_values.min() - result.min())
        assert excess <= allowed * np.ptp(own_values) + 1e-12


@given(
    first=st.lists(st.floats(-1, 1), min_size=2, max_size=4),
    second=st.lists(st.floats(-1, 1), min_size=2, max_size=4),
    steps=st.lists(st.floats(0.01, 1), min_size=6, max_size=6),
)
def test_few_samples_between_jumps_bound_what_lies_between(first, second, steps):
    values = np.array([*first, *second])
    times = np.concatenate([[0.0], np.cumsum(steps)])[: len(values) - 1]
    times = np.insert(times, len(first), times[len(first) - 1])
    for i in range(len(times) - 1):
        query = np.linspace(times[i], times[i + 1], 50)[1:]
        result = interpolate(times, values[:, np.newaxis], query)[:, 0]
        low, high = sorted(values[i : i + 2])
        assert low - 1e-12 <= result.min() <= result.max() <= high + 1e-12


@pytest.mark.parametrize("period, bound", [(60, 1e-9), (20, 5e-6), (12, 3e-4)])
def test_smooth_signals_beside_a_jump_keep_their_order(period, bound):
    times = np.array([*range(20), *range(19, 40)], dtype=float)
    phases = np.where(np.arange(41) < 20, 0.3, 1.7)
    omega = 2 * np.pi / period
    query = np.linspace(0, 39, 2000)
    result = interpolate(times, np.sin(omega * times + phases)[:, np.newaxis], query)
    expected = np.sin(omega * query + np.where(query <= 19, 0.3, 1.7))
    assert np.abs(result[:, 0] - expected).max() < bound


def test_a_pair_without_a_jump_does_not_take_samples_away():
    """As where another signal jumps: at packets, two steps apart."""
    times = np.linspace(0, 3, 61)
    times = np.sort(np.concatenate([times, times[2:-1:2]]))
    query = np.linspace(0.5, 2.5, 1001)
    values = np.sin(5 * times)[:, np.newaxis]
    result = interpolate(times, values, query)[:, 0]
    assert np.abs(result - np.sin(5 * query)).max() < 1e-5
    # Where it jumps, however little, nothing reaches across.
    first = np.flatnonzero(np.diff(times) == 0)[14]
    jump = 1e-3 * (np.arange(len(times)) > first)
    result = interpolate(times, values + jump[:, np.newaxis], query)[:, 0]
    expected = np.sin(5 * query) + 1e-3 * (query > times[first])
    assert np.abs(result - expected).max() < 1e-4


def test_a_bold_polynomial_is_a_parabola_where_the_samples_leave_it_open():
    times, query = np.array([0.0, 0.4, 1.0]), np.linspace(0, 1, 101)
    parabola = np.polynomial.Polynomial([0.0, 4.0, -4.0])
    cautious, bold = (
        interpolate(times, parabola(times)[:, np.newaxis], query, is_cautious=x)[:, 0]
        for x in (True, False)
    )
    assert cautious.max() == pytest.approx(parabola(0.4))
    np.testing.assert_allclose(bold, parabola(query), atol=1e-12)

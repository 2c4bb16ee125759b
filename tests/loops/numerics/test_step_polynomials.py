"""Tests of recorded signals as piecewise polynomials."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.loops.numerics.pieces import Pieces
from teleop_drake.loops.numerics.step_polynomials import (
    DEGREE,
    finite_part,
    integrate_product,
    interpolate,
    part,
    straight_steps,
)

# Three steps of unequal lengths; all signals jump at 2.
ENDS = [(0.0, 0.5), (0.5, 2.0), (2.0, 2.1)]
POWERS = np.polynomial.Polynomial([0.3, -2.0, 1.5, 0.7, -0.4])


def series(function=POWERS, jump=10.0):
    steps = np.array([range(5), range(4, 9), range(9, 14)])
    times = np.zeros(14)
    for rows, ends in zip(steps, ENDS, strict=True):
        times[rows] = np.linspace(*ends, 5)
    values = function(times) + jump * (np.arange(14) > 8)
    return times, {"x": values[:, np.newaxis]}, steps


def test_a_quartic_is_exact_and_a_jump_stays_a_jump():
    times, signals, steps = series()
    query = np.array([-1.0, 0.0, 0.2, 0.5, 1.9, 2.0, 2.0 + 1e-9, 2.05, 9.0])
    inside = np.clip(query, 0, 2.1)
    result = interpolate(times, signals["x"], steps, query)[:, 0]
    assert_allclose(result, POWERS(inside) + 10 * (query > 2), rtol=1e-13)
    # At the rows the interpolation is exact to the last digit.
    rows = interpolate(times, signals["x"], steps, times[:9])
    assert_array_equal(rows, signals["x"][:9])
    assert interpolate(times, signals["x"], steps, np.empty(0)).shape == (0, 1)
    single = interpolate(times[:1], signals["x"][:1], steps[:0], query)
    assert_array_equal(single, np.full((9, 1), signals["x"][0]))


def test_a_part_is_cut_within_its_steps(subtests):
    whole = series()
    for begin, end in ((0.2, 2.07), (0.6, 0.7), (0.5, 2.0), (-1.0, 0.4), (0.0, 9.0)):
        with subtests.test(begin=begin):
            times, signals, steps = part(whole, begin, end)
            assert (times[0], times[-1]) == (max(begin, 0), min(end, 2.1))
            query = np.linspace(times[0], times[-1], 50)[1:]
            result = interpolate(times, signals["x"], steps, query)
            expected = interpolate(whole[0], whole[1]["x"], whole[2], query)
            assert_allclose(result, expected, rtol=1e-12)
    assert_array_equal(times, whole[0])


def test_the_finite_part_ends_with_a_step(subtests):
    for bad, rows in ((13, 9), (9, 9), (6, 5), (2, 1), (0, 0)):
        with subtests.test(bad=bad):
            times, signals, steps = series()
            signals["x"][bad:] = np.nan
            times, signals, steps = finite_part((times, signals, steps))
            assert len(times) == len(signals["x"]) == rows
            assert steps.size == 0 or steps.max() == rows - 1


def test_the_first_crossing_upwards_is_a_root():
    times, signals, steps = series(jump=0.0)
    pieces = Pieces(times, steps)
    y = pieces.signal(signals["x"])[..., 0]
    roots = [x.real for x in POWERS.roots() if x.imag == 0 and 0 < x.real < 2.1]
    for sign in (1, -1):
        first = min(x for x in roots if sign * POWERS.deriv()(x) > 0)
        found = pieces.crossings(sign * y).upwards[0]
        assert_allclose(found, first, rtol=1e-12)


def test_products_are_integrated_exactly():
    times, signals, steps = series(jump=0.0)
    y = signals["x"][steps]
    integral = (POWERS * POWERS).integ()(times)
    length = np.ptp(times[steps], axis=1)
    expected = np.diff(integral[steps]) / length[:, np.newaxis]
    assert_allclose(integrate_product(y, y)[:, :, 0], expected, rtol=1e-10)


def test_rows_without_steps_are_joined_by_straight_lines():
    times = np.array([0.0, 1.0, 1.0, 3.0])
    steps = straight_steps(times)
    assert steps.tolist() == [[0, 1], [2, 3]] and DEGREE > 1
    values = np.array([[0.0], [2.0], [5.0], [9.0]])
    result = interpolate(times, values, steps, np.array([0.5, 1.0, 2.0]))
    assert_array_equal(result[:, 0], [1.0, 2.0, 7.0])

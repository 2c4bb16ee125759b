"""Metrics of signals in pieces against closed forms and dense samples."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from step_rows import rows

from teleop_drake.loops.numerics.pieces import NODES, Pieces
from teleop_drake.loops.numerics.step_polynomials import DEGREE
from teleop_drake.model.laws.signal_metrics import (
    Band,
    extremes,
    integral,
    rms,
    settling_time,
    value_before,
    values_in,
    variation,
)

NUM = 60
Y = np.random.default_rng(0).normal(size=(NUM, DEGREE + 1))
TIMES = np.concatenate([(k + NODES) / NUM for k in range(NUM)])
STEPS = np.arange(Y.size).reshape(Y.shape)
POLYNOMIALS = [np.polynomial.Polynomial.fit(NODES, y, DEGREE, (0, 1)) for y in Y]


def dense():
    """Returns the values of the polynomials at many points of their steps."""
    return np.array([p(np.linspace(0, 1, 10_001)) for p in POLYNOMIALS])


def test_extremes_are_those_of_the_polynomials():
    values = dense()
    assert_allclose(extremes(Y).max(), values.max(), rtol=1e-6)
    assert_allclose(extremes(Y).min(), values.min(), rtol=1e-6)
    # All components of a vector together; then the order of the values of a parabola.
    both = np.stack([Y, -Y], axis=-1)
    expected = values.max(), -values.min()
    found = extremes(both).max(axis=(0, 1))
    assert_allclose(found, expected, rtol=1e-6)
    (found,) = extremes(16 * (NODES - 0.4)[np.newaxis] ** 2)
    expected = [2.56, 2.56, 0.36, 0.0, 0.16, 0.16, 1.96, 1.96, 5.76]
    assert_allclose(found, expected, atol=1e-11)


def test_variation_counts_what_jumps():
    steps = np.abs(np.diff(dense(), axis=1)).sum()
    jumps = np.abs(Y[1:, 0] - Y[:-1, -1]).sum()
    assert_allclose(variation(extremes(Y)), steps + jumps, rtol=1e-2)
    t, places = rows(200, 4 * math.pi)
    y = np.sin(t)[places]
    assert_allclose(variation(extremes(y)), 8.0, rtol=1e-8)
    assert variation(extremes(np.full((3, 5), 0.1))) == 0.0


def test_rms_and_integral_are_exact():
    length = np.full(NUM, 1 / NUM)
    squares = [(p * p).integ() for p in POLYNOMIALS]
    expected = math.sqrt(np.mean([s(1) - s(0) for s in squares]))
    assert_allclose(rms(Y[..., None], length), [expected], rtol=1e-12)
    found = integral(Y[..., None], length, np.array([3.0]))[..., 0]
    means = [p.integ()(1) - p.integ()(0) for p in POLYNOMIALS]
    assert_allclose(found[-1, -1], 3.0 + np.mean(means), rtol=1e-12)
    assert_allclose(found[1:, 0], found[:-1, -1], rtol=1e-12)


def test_a_run_of_one_row_is_one_piece():
    pieces = Pieces(np.array([0.5]), np.empty((0, 5), int), [0.5, 0.7])
    y = pieces.signal(np.array([[2.0, -3.0]]))
    assert pieces.length.tolist() == [1.0]
    assert rms(y, pieces.length) == pytest.approx([2.0, 3.0])
    assert value_before(y, slice(0, 1)).tolist() == [2.0, -3.0]
    assert values_in(y, slice(1, 1)).tolist() == [2.0, -3.0]


@pytest.mark.parametrize(
    ("radius", "expected"), [(0.05, math.log(20)), (0.5, math.log(2)), (2.0, 0.0)]
)
def test_a_vector_settles_in_its_band(radius, expected):
    t, steps = rows(400, 9.0)
    spiral = np.exp(-t)[:, None] * np.stack([np.cos(9 * t), np.sin(9 * t)], axis=1)
    pieces = Pieces(t, steps)
    centre = np.array([1.0, -2.0])
    band = Band(pieces.signal(centre + spiral) - centre, radius)
    found = settling_time(pieces, pieces.between(), [band])
    assert found == pytest.approx(expected, rel=1e-7, abs=1e-12)
    # A vector that never enters its band, and an empty span, have no settling time.
    never = Band(band.offset, 1e-9)
    assert settling_time(pieces, pieces.between(), [band, never]) is None
    assert settling_time(pieces, slice(400, 400), [band]) is None

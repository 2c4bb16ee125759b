"""Signals in pieces: cuts, delays and changes of sign."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from step_rows import rows

from teleop_drake.loops.numerics.bisection import bisect
from teleop_drake.loops.numerics.pieces import NODES, Crossings, Pieces
from teleop_drake.loops.numerics.step_polynomials import DEGREE


def smooth(times):
    return np.stack([np.sin(7 * times), np.cos(3 * times)], axis=-1)


def test_a_place_is_found_to_the_last_digit():
    roots = np.array([0.1, 1 / 3, 0.999, 1.0])
    found = bisect(lambda x: x < roots, np.zeros(4), np.ones(4))
    assert_allclose(found, roots, rtol=1e-14)


def test_cuts_change_no_signal_and_instants_that_are_one_cut_once():
    times, steps = rows(40)
    ends = times[steps[:, -1]]
    inner = [0.3, 0.30001, 1.7]
    # These cut nothing: they are at ends of steps, or repeat an instant.
    known = [0.0, ends[3], ends[4] + 1e-12, ends[5] - 1e-12, 0.3 + 1e-13, 99.0]
    pieces = Pieces(times, steps, [*inner, *known])
    assert len(pieces.begin) == 40 + len(inner)
    assert_array_equal(pieces.begin[1:], pieces.end[:-1])
    assert set(inner) <= {*pieces.end.tolist()}
    points = pieces.begin[:, None] + NODES * pieces.length[:, None]
    found = pieces.signal(smooth(times))
    assert_allclose(found, smooth(points), atol=2e-6)
    delayed = pieces.signal(smooth(times), 0.25)
    expected = smooth(points - 0.25) * (points >= 0.25)[..., None]
    is_inside = np.abs(points - 0.25) > 1e-9
    assert_allclose(delayed[is_inside], expected[is_inside], atol=3e-6)
    span = pieces.between(0.3, 1.7)
    assert (pieces.begin[span.start], pieces.end[span.stop - 1]) == (0.3, 1.7)


def test_a_step_of_no_length_is_left_out():
    """Drake records such a step if several events are at one instant up to rounding."""
    times = np.concatenate([NODES, [1.0] * 4 + [1.0 + 2e-16], 1.0 + NODES])
    values = np.concatenate([np.zeros(5), np.linspace(0, 9, 5), np.ones(5)])
    pieces = Pieces(times, np.arange(15).reshape(3, 5))
    signal = pieces.signal(values[:, np.newaxis])
    assert_array_equal(signal[..., 0], [[0.0] * 5, [1.0] * 5])


@pytest.mark.parametrize("degree", [1, 2, DEGREE])
def test_crossings_are_roots(degree):
    t = np.linspace(0.0, 10.0, 20 * degree + 1)
    steps = np.arange(20)[:, None] * degree + np.arange(degree + 1)
    pieces = Pieces(t, steps)
    found = pieces.crossings(pieces.signal((t - 3.3)[:, None])[..., 0])
    assert found == Crossings([pytest.approx(3.3, rel=1e-14)], [])
    found = pieces.crossings(pieces.signal((7.1 - t)[:, None])[..., 0])
    assert found == Crossings([], [pytest.approx(7.1, rel=1e-14)])

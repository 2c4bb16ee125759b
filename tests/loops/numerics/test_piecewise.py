"""Piecewise polynomial approximations against the functions."""

import math

import numpy as np
import pytest

from teleop_drake.loops.engine import delays
from teleop_drake.loops.numerics.piecewise import fit_pieces


def wave(t):
    return 0.3 + 0.1 * math.sin(7 * t + 1) + 0.02 * t


def bent(t):
    """Returns a piecewise linear function of t, with bends at 0.5 and 2."""
    return float(np.interp(t, [0.0, 0.5, 2.0, 3.0], [0.1, 0.4, 0.2, 0.3]))


def evaluate_pieces(pieces, t):
    return delays.evaluate_pieces(*pieces, 0, len(pieces.knots), t)


@pytest.mark.parametrize("function, nonsmooth_times", [(wave, ()), (bent, (0.5, 2.0))])
def test_the_pieces_are_the_function(function, nonsmooth_times):
    pieces = fit_pieces(function, 0.0, 3.0, nonsmooth_times=nonsmooth_times)
    for t in np.linspace(0, 3, 1001).tolist():
        assert evaluate_pieces(pieces, t) == pytest.approx(function(t), abs=2e-13)
    assert len(pieces.coefficients) < 100
    assert evaluate_pieces(pieces, 99.0) == pytest.approx(function(3.0), abs=2e-13)


def test_a_nonsmooth_point_that_nobody_told_costs_pieces_but_not_accuracy(subtests):
    pieces = fit_pieces(bent, 0.0, 3.0)
    assert 20 < len(pieces.coefficients) < 200
    for t in (0.499, 0.5, 1.999999, 2.1):
        with subtests.test(t=t):
            assert evaluate_pieces(pieces, t) == pytest.approx(bent(t), abs=1e-5)


def test_what_is_rounded_has_an_end():
    pieces = fit_pieces(lambda t: round(t * 50) / 50, 0.0, 1.0)
    assert len(pieces.coefficients) < 4000
    assert evaluate_pieces(pieces, 0.7) == pytest.approx(0.7, abs=1e-3)

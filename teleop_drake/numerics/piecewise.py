"""A smooth function of one variable as polynomials, one after another.

A function in Python becomes numbers, which machine code can read.
"""

import itertools
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from teleop_drake.arrays import Array

NUM_COEFFICIENTS = 8
"""The number of coefficients of each polynomial."""

# On a piece the variable goes from -1 to 1. Chebyshev's points with both ends.
_NODES = np.cos(np.pi * np.arange(NUM_COEFFICIENTS) / (NUM_COEFFICIENTS - 1))[::-1]
_TO_COEFFICIENTS = np.linalg.inv(np.vander(_NODES, increasing=True))
# Where a polynomial is compared with the function.
_TESTS = (_NODES[1:] + _NODES[:-1]) / 2
_AT_TESTS = np.vander(_TESTS, NUM_COEFFICIENTS, increasing=True)
# The nodes, and the tests between them.
_POINTS = np.sort(np.concatenate([_NODES, _TESTS])).tolist()

# The polynomials may differ from the function by this share of it, or of 1 where it is
# less.
_TOLERANCE = 1e-13

# Pieces are not cut into pieces shorter than this share of the whole, whatever the
# tolerance, so that there cannot be too many.
_SHORTEST = 1e-5


class Pieces(NamedTuple):
    """Polynomials, each of which holds between two knots.

    Attributes:
        knots: Where each piece begins and ends (k, 2), ascending.
        coefficients: Of ascending powers of what goes from -1 to 1 on a piece (k, 8).
    """

    knots: Array
    coefficients: Array


def fit_pieces(
    function: Callable[[float], float],
    start: float,
    end: float,
    *,
    nonsmooth_times: Iterable[float] = (),
) -> Pieces:
    """Returns polynomials that are a function, to within a tolerance.

    Args:
        function: Continuous, and smooth between its nonsmooth points.
        end: Where it ends, > start.
        nonsmooth_times: Where a derivative jumps; no piece reaches across one.
    """
    shortest = _SHORTEST * (end - start)
    inner = sorted({float(x) for x in nonsmooth_times if start < x < end})
    ends = [float(start), *inner, float(end)]
    # The next interval is the last one of the list.
    intervals = list(itertools.pairwise(ends))[::-1]
    knots = []
    rows = []
    while intervals:
        a, b = intervals.pop()
        middle = (a + b) / 2
        half = (b - a) / 2
        values = np.array([function(middle + half * x) for x in _POINTS])
        coefficients = _TO_COEFFICIENTS @ values[::2]
        error = np.abs(_AT_TESTS @ coefficients - values[1::2]).max()
        is_good = error <= _TOLERANCE * max(1.0, np.abs(values).max())
        if is_good or b - a <= 2 * shortest:
            knots.append((a, b))
            rows.append(coefficients)
        else:
            intervals += [(middle, b), (a, middle)]
    return Pieces(np.array(knots), np.array(rows))

"""Approximation of a function of one variable by piecewise polynomials.

The polynomials are arrays of numbers, which compiled code can evaluate without a call
to the Python function.
"""

import itertools
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array

NUM_COEFFICIENTS = 8
"""The number of coefficients of each polynomial."""

# On each piece the variable is scaled to [-1, 1]. The nodes are the Chebyshev points of
# the second kind, which include both ends.
_NODES = np.cos(np.pi * np.arange(NUM_COEFFICIENTS) / (NUM_COEFFICIENTS - 1))[::-1]
_TO_COEFFICIENTS = np.linalg.inv(np.vander(_NODES, increasing=True))
# The points between the nodes at which a polynomial is compared with the function.
_TESTS = (_NODES[1:] + _NODES[:-1]) / 2
_AT_TESTS = np.vander(_TESTS, NUM_COEFFICIENTS, increasing=True)
# The nodes and the test points between them, ascending.
_POINTS = np.sort(np.concatenate([_NODES, _TESTS])).tolist()

# The largest error of a polynomial, relative to the function's largest absolute value
# on the piece or to 1, whichever is greater.
_TOLERANCE = 1e-13

# The shortest piece as a share of the whole interval. It takes precedence over the
# tolerance and so limits the number of pieces.
_SHORTEST = 1e-5


class Pieces(NamedTuple):
    """A piecewise polynomial of k pieces.

    Attributes:
        knots: Start and end of each piece (k, 2), ascending.
        coefficients: Coefficients of ascending powers of the piece's variable, which is
            scaled to [-1, 1] (k, 8).
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
    """Returns the piecewise polynomial that approximates a function to a tolerance.

    A piece whose polynomial is not accurate enough is halved.

    Args:
        function: The function, continuous, and smooth between its nonsmooth points.
        start: The lower end of the interval.
        end: The upper end of the interval, > start.
        nonsmooth_times: Points at which a derivative jumps; no piece reaches across
            one.
    """
    shortest = _SHORTEST * (end - start)
    inner = sorted({float(x) for x in nonsmooth_times if start < x < end})
    ends = [float(start), *inner, float(end)]
    # A stack: the last interval of the list is the next one to be fitted.
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

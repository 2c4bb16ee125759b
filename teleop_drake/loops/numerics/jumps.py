"""The jumps of a function of time, found by evaluating it."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.numerics.instants import same_within

_FOURTH_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0])

# The fourth difference of five samples of a smooth function is smaller than this share
# of the function's range; so is a change that is no jump.
_SMOOTH = 1e-6

# The most intervals in which one search looks; a jump needs some eighty.
_MOST_INTERVALS = 2000


class Jump(NamedTuple):
    """A jump between two instants, s, that are as good as equal."""

    before: float
    after: float


class TooManyJumps(Exception):
    """The function jumps or bends wherever it is evaluated."""


def find_jumps(
    function: Callable[[float], Array], begin: float, end: float, parts: int
) -> list[Jump]:
    """Returns the jumps of a function in an interval of time, in ascending order.

    An interval in which the fourth difference of five samples is large is halved. A
    kink then becomes smooth, and a jump does not.

    Args:
        function: The values (k) at a time in s; NaN where it is not defined.
        begin: The begin of the interval, s.
        end: The end of the interval, s.
        parts: The number of equal parts into which the interval is divided first. A
            pulse that is shorter than a quarter of a part may be missed.

    Raises:
        TooManyJumps: If the function jumps or bends nearly everywhere.
    """
    edges = np.linspace(begin, end, 4 * parts + 1)
    values = np.array([function(t) for t in edges.tolist()])
    is_defined = np.isfinite(values).all(axis=1)
    if not is_defined.any():
        return []
    size = np.ptp(values[is_defined], axis=0)
    ahead = [
        (edges[i : i + 5], values[i : i + 5]) for i in range(4 * (parts - 1), -1, -4)
    ]
    found = []
    num_intervals = 0
    while ahead:
        t, y = ahead.pop()
        if not np.isfinite(y).all():
            continue
        if np.all(np.abs(_FOURTH_DIFFERENCE @ y) <= _SMOOTH * size):
            continue
        num_intervals += 1
        if num_intervals > _MOST_INTERVALS:
            raise TooManyJumps
        if t[4] - t[0] <= same_within(t[4]):
            if np.any(np.abs(y[4] - y[0]) > _SMOOTH * size):
                found.append(Jump(float(t[0]), float(t[4])))
            continue
        for i in (2, 0):
            inside = [t[i], (t[i] + t[i + 1]) / 2, t[i + 1]]
            inside += [(t[i + 1] + t[i + 2]) / 2, t[i + 2]]
            middles = [function(float(inside[k])) for k in (1, 3)]
            half = [y[i], middles[0], y[i + 1], middles[1], y[i + 2]]
            ahead.append((np.array(inside), np.array(half)))
    return found

"""Bisection: the point of an interval at which a condition ceases to hold."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array

# The number of equal parts into which each round divides an interval. All dividing
# points are tried at once, which is faster in NumPy than halving repeatedly.
_PARTS = 32

ROUNDS = 10
"""The default number of rounds, which narrow an interval to 2^-50 of its length."""


def halve(
    holds: Callable[[float], bool], low: float, high: float, num_halves: int = 60
) -> tuple[float, float]:
    """Returns the narrowed interval (low, high) in which a condition ceases to hold.

    Args:
        holds: Returns whether the condition holds at a point.
        low: A point at which the condition holds.
        high: A point at which it does not.
        num_halves: The number of times the interval is halved; fewer if its ends become
            neighbouring floating-point numbers.
    """
    for _ in range(num_halves):
        middle = (low + high) / 2
        if not low < middle < high:
            break
        if holds(middle):
            low = middle
        else:
            high = middle
    return low, high


def bisect(
    holds: Callable[[Array], Array],
    low: ArrayLike,
    high: ArrayLike,
    rounds: int = ROUNDS,
) -> Array:
    """Returns the point of each of k intervals at which a condition ceases to hold (k).

    It is the upper end of the narrowed interval.

    Args:
        holds: Returns whether the condition holds at points (31, k), a column for each
            interval.
        low: Lower ends (k), where the condition holds.
        high: Upper ends (k), where it does not.
        rounds: The number of times each interval is divided into 32 parts.
    """
    lower = np.asarray(low, float)
    part = (np.asarray(high, float) - lower) / _PARTS
    inner = np.arange(1.0, _PARTS)[:, np.newaxis]
    if not part.size:
        return lower
    for _ in range(rounds):
        # True at the points before the first one at which the condition fails.
        still_holds = np.logical_and.accumulate(holds(lower + inner * part))
        lower = lower + still_holds.sum(axis=0) * part
        part = part / _PARTS
    return lower + _PARTS * part

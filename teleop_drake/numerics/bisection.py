"""Where a condition that holds at one end of an interval ceases to hold."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.arrays import Array

# Each round divides an interval into as many equal parts. They are tried at once,
# which is quicker in numpy than one half after another.
_PARTS = 32

ROUNDS = 10
"""Rounds that leave 2^-50 of an interval."""


def halve(
    holds: Callable[[float], bool], low: float, high: float, num_halves: int = 60
) -> tuple[float, float]:
    """Returns the last place at which a condition holds, and the first it does not.

    Args:
        holds: Whether the condition holds at a place.
        low: Where it holds.
        high: Where it does not.
        num_halves: How often the interval is halved, unless its ends are neighbours.
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
    """Returns where a condition ceases to hold in each of k intervals (k).

    It is the upper end of what is left of the interval.

    Args:
        holds: Returns whether the condition holds at places (31, k), a column for each
            interval.
        low: Lower ends (k), where it holds.
        high: Upper ends (k), where it does not.
        rounds: How often an interval is divided by 32.
    """
    lower = np.asarray(low, float)
    part = (np.asarray(high, float) - lower) / _PARTS
    inner = np.arange(1.0, _PARTS)[:, np.newaxis]
    if not part.size:
        return lower
    for _ in range(rounds):
        still_holds = np.logical_and.accumulate(holds(lower + inner * part))
        lower = lower + still_holds.sum(axis=0) * part
        part = part / _PARTS
    return lower + _PARTS * part

"""Bisection: the point of an interval at which a condition ceases to hold.

find_roots() needs fewer evaluations if the condition is the sign of a function.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array

# The number of equal parts into which each round divides an interval. All dividing
# points are tried at once, which is faster in NumPy than halving repeatedly.
_PARTS = 32

# The largest number of rounds of find_roots(), and the relative size of its last step.
_MOST_ROUNDS = 200
_ROUNDING = 4e-16

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


def find_roots(
    function: Callable[[Array], Array],
    low: ArrayLike,
    high: ArrayLike,
    most: int = _MOST_ROUNDS,
) -> Array:
    """Returns a root of a function in each of k intervals, to rounding (k).

    The root is found by the secant method of the bracket that contains it. Where one
    end of the bracket stays, the value there is halved, which moves the next secant.
    Each third round halves the bracket. Where the function jumps, the result is the
    point of the jump, not to rounding.

    Source: M. Dowell and P. Jarratt, "A modified regula falsi method for computing the
    root of an equation", BIT 11 (1971), the Illinois method.

    Args:
        function: Returns values at points (k), one for each interval.
        low: Lower ends (k).
        high: Upper ends (k); the values at both ends have different signs.
        most: The largest number of rounds.
    """
    other = np.asarray(low, float)
    x = np.asarray(high, float)
    if not x.size:
        return x
    at_other = function(other)
    at_x = function(x)
    for k in range(most):
        rise = np.where(at_x == at_other, 1.0, at_x - at_other)
        is_secant = k % 3 < 2
        step = (other - x) * (at_x / rise if is_secant else 0.5)
        new = x + step
        at_new = function(new)
        has_crossed = np.signbit(at_new) != np.signbit(at_x)
        other = np.where(has_crossed, x, other)
        at_other = np.where(has_crossed, at_x, at_other / 2)
        x = new
        at_x = at_new
        is_found = (np.abs(step) <= _ROUNDING * np.abs(x)) | (at_x == 0)
        if is_secant and is_found.all():
            break
    return x

"""Words for a packet that was lost, and numbers of packets with gaps."""

import numpy as np

from teleop_drake.loops.framework.arrays import ArrayLike, Flags, Indices

_WORDS = frozenset(
    [
        "", "na", "n/a", "nan", "nil", "null", "none", "lost", "loss", "timeout",
        "timedout", "timed out", "time out", "timed-out", "request timed out",
        "request timed out.", "no reply", "no answer", "no response", "unreachable",
        "dropped", "drop", "missing", "failed", "error", "inf", "+inf", "-inf",
        "infinity", "*", "-", "--", "?", "#n/a", "<na>", "-nan", "nat",
    ]
)  # fmt: skip

# The numbers of packets of ping have 16 bits.
_WRAP = 1 << 16


def AreLost(texts: ArrayLike) -> Flags:
    """Returns whether each text stands for a lost packet or a missing value (N).

    -1 does too, but only where no other number is negative: see Table.Values().
    """
    return np.array([str(x).strip().lower() in _WORDS for x in np.asarray(texts)])


def Unwrapped(numbers: ArrayLike) -> Indices:
    """Returns numbers of packets that count on where 16 bits are full.

    A number is nearest to the one before it: answers that overtake each other keep
    their numbers. macOS tells of lost packets by numbers that have counted on.
    """
    numbers = np.asarray(numbers, dtype=np.int64)
    if numbers.size == 0 or numbers.min() >= _WRAP:
        return numbers
    steps = np.diff(numbers)
    is_wrapped = np.minimum(numbers[1:], numbers[:-1]) < _WRAP
    nearest = (steps + _WRAP // 2) % _WRAP - _WRAP // 2
    steps = np.where(is_wrapped, nearest, steps)
    return numbers[0] + np.concatenate([[0], np.cumsum(steps)])

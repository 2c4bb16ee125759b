"""Tolerances within which two instants count as the same."""

SAME = 1e-12
"""Instants closer together than this, in s, count as the same."""

SAME_SHARE = 2e-15
"""At late times, instants closer together than this share of them count as the same."""

TIE = 1e-6
"""A number of periods counts as whole if it is closer than this to a whole number."""


def same_within(time: float) -> float:
    """Returns the distance in s within which an instant counts as equal to a time.

    Times that should be equal may differ by rounding: 15 * 0.02 is less than 3 * 0.1.
    """
    return max(SAME, SAME_SHARE * abs(time))

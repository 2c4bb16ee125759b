"""When two instants are one."""

SAME = 1e-12
"""Instants closer together than this, in s, are one."""

TIE = 1e-6
"""A number of periods that differs from a whole number by less than this is whole."""


def same_within(time: float) -> float:
    """Returns how far from a time in s an instant may be to be the same one, s.

    Rounding makes 15 * 0.02 less than 3 * 0.1, by some units in the last place.
    """
    return max(SAME, 2e-15 * abs(time))

"""Instants that differ only by rounding count as the same."""

import pytest

from teleop_drake.loops.numerics.instants import SAME, same_within


@pytest.mark.parametrize(
    ("a", "b", "is_same"),
    [
        (15 * 0.02, 3 * 0.1, True),
        (0.8999999999999999 + 0.1, 1.0, True),
        (1e4 * 0.3, 3e3 + 4e-12, True),
        (0.3, 0.3 + 2 * SAME, False),
        (3e3, 3e3 + 1e-11, False),
    ],
)
def test_rounding_makes_no_other_instant(a, b, is_same):
    assert (abs(a - b) <= same_within(b)) == is_same

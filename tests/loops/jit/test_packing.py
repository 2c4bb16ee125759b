"""Values packed into one vector, and other values in the same layouts."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from teleop_drake.loops.jit.packing import Parameters, repack


class Pair(NamedTuple):
    first: np.ndarray
    second: float


class Other(NamedTuple):
    first: np.ndarray
    second: float


BASE = {
    "one": Pair(np.array([1.0, 2.0]), 3.0),
    "two": Pair(np.array([1.0, 2.0]), 4.0),  # Its array shares the place of the first.
    "matrix": np.eye(2),
    "count": 3,
    "number": 0.5,
}


def packed():
    parameters = Parameters()
    layouts = [parameters.Add(value) for value in BASE.values()]
    return layouts, np.array(parameters.numbers)


def repacked(**changes):
    layouts, p = packed()
    values = [*(BASE | changes).values()]
    return layouts, repack(layouts, values, len(p))


def test_the_same_values_are_packed_alike():
    _, p = packed()
    _, again = repacked()
    assert_array_equal(again, p)


@pytest.mark.parametrize(
    "changes",
    [
        {"number": 0.7},
        {"matrix": np.array([[1.0, 2.0], [3.0, 4.0]])},
        {"one": Pair(np.array([1.0, 2.0]), 7.0)},
        {name: Pair(np.array([5.0, 6.0]), 7.0) for name in ("one", "two")},
    ],
)
def test_other_values_are_read_back(changes):
    layouts, p = repacked(**changes)
    for layout, (name, value) in zip(layouts, (BASE | changes).items(), strict=True):
        read = layout.In(p)
        assert type(read) is type(value) or name in ("number", "count", "matrix")
        flat = read if isinstance(value, tuple) else (read,)
        expected = value if isinstance(value, tuple) else (value,)
        for x, y in zip(flat, expected, strict=True):
            assert_array_equal(x, y)


@pytest.mark.parametrize(
    "changes",
    [
        {"two": Pair(np.array([1.0, 2.5]), 4.0)},
        {"two": Pair(np.array([1.0, -2.0]), 4.0)},
        {"one": Other(np.array([1.0, 2.0]), 3.0)},
        {"one": np.array([1.0, 2.0])},
        {"matrix": np.eye(3)},
        {"matrix": np.eye(2, dtype=int)},
        {"matrix": (1.0, 2.0)},
        {"count": 4},
        {"count": 3.0},
    ],
)
def test_values_that_need_another_layout_are_not_packed(changes):
    assert repacked(**changes)[1] is None


def test_zeros_of_different_sign_do_not_share_a_place():
    parameters = Parameters()
    pair = Pair(np.array([0.0]), 1.0)
    layouts = [parameters.Add(pair), parameters.Add(pair)]
    values = [pair, Pair(np.array([-0.0]), 1.0)]
    assert repack(layouts, values, len(parameters.numbers)) is None

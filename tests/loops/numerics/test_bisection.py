"""Bisection of single intervals and of many at once."""

import math

import numpy as np
import pytest

from teleop_drake.loops.numerics.bisection import bisect, find_roots, halve


def test_an_interval_is_halved_to_neighbours():
    low, high = halve(lambda x: x * x < 2, 1.0, 2.0)
    assert high == math.nextafter(low, 2.0)
    assert low**2 < 2 <= high**2


def test_an_interval_is_halved_no_more_often_than_asked():
    calls = []
    low, high = halve(lambda x: calls.append(x) or False, 0.0, 1.0, num_halves=3)
    assert (low, high) == (0.0, 0.125) and calls == [0.5, 0.25, 0.125]


def test_many_intervals_at_once():
    limits = np.array([0.1, 0.7, 0.3])
    found = bisect(lambda x: x < limits, np.zeros(3), np.ones(3))
    assert found == pytest.approx(limits, abs=1e-15)


def test_roots_of_functions_in_many_intervals():
    powers = np.array([1.0, 3.0, 9.0, 31.0])
    calls = []

    def Function(x):
        calls.append(x)
        return x**powers - 2.0

    found = find_roots(Function, np.full(4, 0.5), np.full(4, 4.0))
    assert found == pytest.approx(2.0 ** (1 / powers), rel=1e-15)
    assert len(calls) < 60
    assert find_roots(Function, [], []).size == 0


def test_the_root_of_a_function_that_jumps_is_the_jump():
    found = find_roots(lambda x: np.where(x < 0.3, -690.0, 1e-3), [0.0], [1.0])
    assert found == pytest.approx([0.3], rel=1e-9)

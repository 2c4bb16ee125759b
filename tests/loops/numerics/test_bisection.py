"""Bisection of single intervals and of many at once."""

import math

import numpy as np
import pytest

from teleop_drake.loops.numerics.bisection import bisect, halve


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

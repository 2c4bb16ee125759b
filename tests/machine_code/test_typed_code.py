"""Loops over arrays as LLVM's code: they do what they do in Python."""

import ctypes
import math
from typing import NamedTuple

import numpy as np
import pytest

from teleop_drake.machine_code.native import Library, ObjectFile
from teleop_drake.machine_code.typed_code import MakeTypedCode
from teleop_drake.machine_code.typed_values import (
    FLOAT,
    INTEGER,
    Header,
    NotTyped,
    TypeOf,
)

NODES = np.array([[0.5, 2.0], [-1.0, 3.0]])


class Inner(NamedTuple):
    table: np.ndarray
    places: np.ndarray


class Work(NamedTuple):
    x: np.ndarray
    inner: Inner
    cube: np.ndarray
    result: np.ndarray


def total(values, first):
    result = 0.0
    for value in values:
        if value < 0:
            continue
        if value > 2.5:
            break
        result += value
    return result + first


def put(target, place, value):
    """Returns nothing."""
    if place < 0:
        return
    target[place] = value


def at_most(limit, x):
    if x > limit and not x < -limit:
        return limit
    return x


def everything(work, t, n):
    x, inner, result = work.x, work.inner, work.result
    for i in range(len(x)):
        put(result, i - 1, x[i] * NODES[1, 1])
    count, low, high = 0, 0, n
    while low < high:
        middle = (low + high) // 2
        count += 1
        if inner.table[middle, 0] < t or (middle == 0 and t > 0):
            low = middle + 1
        else:
            high = middle
    result[3] = total(x, float(count))
    row = work.cube[1]
    row[0, 1] += t**2 / 3 - abs(-t) ** (1 / 5)
    for k in range(2, -1, -1):
        row[1, k] = -row[0, k] if 0.0 < row[0, k] <= 1.0 else min(t, 2, row[0, k])
    part = inner.table[1:n]
    result[4] = part[0, 1] + len(part) + part.shape[1] + at_most(0.25, x[1])
    result[5] = max(at_most(math.inf, x[2]), inner.places[int(t)] + 1)
    other = x if bool(n > 100 or t > 100) else result
    other[0], other[1] = other[1], other[0]
    inner.places[0] = -low
    return low - 7


@pytest.mark.parametrize("t", [-0.5, 0.3, 1.7])
def test_machine_code_and_python_agree(t):
    results = []
    for is_compiled in (False, True):
        rng = np.random.default_rng(3)
        inner = Inner(np.sort(rng.normal(size=(5, 2)), axis=0), np.arange(3))
        work = Work(rng.normal(size=5), inner, rng.normal(size=(2, 2, 3)), np.zeros(6))
        arguments = work, t, 5
        if is_compiled:
            code = MakeTypedCode(everything, [TypeOf(work), FLOAT, INTEGER])
            library = Library(ObjectFile(code))
            number, pointer = ctypes.c_int64, ctypes.c_void_p
            kind = ctypes.CFUNCTYPE(number, pointer, ctypes.c_double, number)
            header = np.array(Header(work), np.int64)
            value = kind(library.Address("everything"))(header.ctypes.data, t, 5)
        else:
            value = everything(*arguments)
        arrays = work.x, *work.inner, work.cube, work.result
        results.append([value, *np.concatenate([x.ravel() for x in arrays])])
    np.testing.assert_allclose(results[1], results[0], rtol=1e-14)


def test_what_is_outside_is_refused_with_its_line():
    def with_a_list(n):
        items = [n]
        return items[0]

    def with_two_types(n):
        x = 1
        x = n / 2
        return x

    def with_a_condition_of_a_number(n):
        return 1.0 if n / 2 else 2.0

    line = with_a_list.__code__.co_firstlineno + 1
    with pytest.raises(NotTyped, match=f"with_a_list, line {line}: List"):
        MakeTypedCode(with_a_list, [INTEGER])
    with pytest.raises(NotTyped, match="a variable is i64 and double"):
        MakeTypedCode(with_two_types, [INTEGER])
    with pytest.raises(NotTyped, match="truth"):
        MakeTypedCode(with_a_condition_of_a_number, [INTEGER])

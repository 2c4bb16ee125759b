"""Loops over arrays as LLVM's code: they do what they do in Python."""

import ctypes
import math
from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

from teleop_drake.loops.jit.native import Header, Library, ObjectFile
from teleop_drake.loops.jit.scalar_code import FLOAT, INTEGER
from teleop_drake.loops.jit.typed_code import MakeTypedCode
from teleop_drake.loops.jit.typed_values import TypeOf

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
    for i in range(len(values)):
        if values[i] < 0:
            continue
        if values[i] > 2.5:
            break
        result += values[i]
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
    x = work.x
    inner = work.inner
    result = work.result
    for i in range(len(x)):
        put(result, i - 1, x[i] * NODES[1, 1])
    count = 0
    low = 0
    high = n
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
    for k in range(1, 3):
        if row[0, k] > 0.0 and row[0, k] <= 1.0:
            row[1, k] = -row[0, k]
        else:
            row[1, k] = min(t, 2, row[0, k])
    result[4] = inner.table[1, 1] + len(inner.table) + at_most(0.25, x[1])
    result[5] = max(at_most(math.inf, x[2]), inner.places[int(t)] + 1)
    other = result
    if n > 100 or t > 1:
        other = x
    other[0] -= 2 * other[1]
    inner.places[0] = 0 - low
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
            library = Library(ObjectFile(code), "everything")
            number = ctypes.c_int64
            pointer = ctypes.c_void_p
            kind = ctypes.CFUNCTYPE(number, pointer, ctypes.c_double, number)
            header = np.array(Header(work), np.int64)
            value = kind(library.Address("everything"))(header.ctypes.data, t, 5)
        else:
            value = everything(*arguments)
        arrays = work.x, *work.inner, work.cube, work.result
        results.append([value, *np.concatenate([x.ravel() for x in arrays])])
    assert_allclose(results[1], results[0], rtol=1e-14)


class Optional(NamedTuple):
    other: np.ndarray | None
    result: np.ndarray


def add_other(work, n):
    if work.other is not None:
        work.result[0] = n + work.other[0]
    else:
        work.result[0] = n
    return n


@pytest.mark.parametrize("other", [None, np.array([5.0])])
def test_a_field_that_is_none_has_no_code(other):
    """What `is not None` excludes is not even translated: None has no element 0."""
    work = Optional(other, np.zeros(1))
    code = MakeTypedCode(add_other, [TypeOf(work), INTEGER])
    library = Library(ObjectFile(code), "add_other")
    kind = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)
    header = np.array(Header(work), np.int64)
    kind(library.Address("add_other"))(header.ctypes.data, 2)
    expected = Optional(other, np.zeros(1))
    add_other(expected, 2)
    assert work.result == expected.result
    assert ("fadd" in code) == (other is not None)


def last_of(x, result, i):
    result[0] = x[2] + x[1] + x[i]


def before(x, result, i):
    result[0] = last(x, i)


def last(x, i):
    return x[i - 1]


def compiled(function, *samples):
    """Returns a function of arrays and whole numbers, as machine code."""
    types = [TypeOf(sample) for sample in samples]
    library = Library(
        ObjectFile(MakeTypedCode(function, types)), function.__name__, "fault"
    )
    slots = [ctypes.c_int64 for sample in samples for _ in Header(sample)]
    address = library.Address(function.__name__)

    def call(*arguments):
        parts = (part for argument in arguments for part in Header(argument))
        ctypes.CFUNCTYPE(None, *slots)(address)(*parts)
        library.RaiseFault()

    return call


def test_an_index_is_in_its_array_or_an_error():
    x = np.array([1.0, 2.0, 4.0])
    for function, inside, outside in (
        (last_of, (0, 2), (-4, -1, 3)),
        (before, (1, 3), (0, 4, -3)),
    ):
        loops = compiled(function, x, np.zeros(1), 0)
        name = function.__name__
        line = function.__code__.co_firstlineno + 1
        if function is before:
            name = "last"
            line = last.__code__.co_firstlineno + 1
        for i in inside:
            result = np.zeros(1)
            expected = np.zeros(1)
            loops(x, result, i)
            function(x, expected, i)
            assert result == expected
        for i in outside:
            with pytest.raises(IndexError, match=rf"{name}\(\), line {line}"):
                loops(x, np.zeros(1), i)
        loops(x, result, inside[0])


def test_what_is_outside_is_refused_with_its_line(subtests):
    def with_a_list(n):
        if n > 0:
            items = [n]
            return items[0]
        return 0.0

    def with_two_types(n):
        x = 1
        x = n / 2
        return x

    def with_a_condition_of_a_number(n):
        if n / 2:
            return 1.0
        return 2.0

    def with_any_step(n):
        for _ in range(0, 5, n):
            pass

    def with_a_loop_over_an_array(n):
        for _ in NODES:
            pass

    def with_two_at_once(n):
        n, m = 1, n
        return m

    def with_a_chain(n):
        return 0 < n < 3

    def with_a_slice(n):
        return len(NODES[1:n])

    for function, reason in (
        (with_any_step, "a range with steps"),
        (with_a_loop_over_an_array, "For"),
        (with_two_at_once, "Assign"),
        (with_a_chain, "truth"),
        (with_a_slice, "slice"),
    ):
        with (
            subtests.test(function=function),
            pytest.raises(TypeError, match=reason),
        ):
            MakeTypedCode(function, [INTEGER])
    line = with_a_list.__code__.co_firstlineno + 2
    with pytest.raises(TypeError, match="a list") as error:
        MakeTypedCode(with_a_list, [INTEGER])
    assert error.value.__notes__ == [f"with_a_list(), line {line}"]
    with pytest.raises(TypeError, match="a variable is i64 and double"):
        MakeTypedCode(with_two_types, [INTEGER])
    with pytest.raises(TypeError, match="not a boolean"):
        MakeTypedCode(with_a_condition_of_a_number, [INTEGER])

"""Functions as graphs of operations, and as LLVM's code: the same numbers."""

import contextlib
import functools
import inspect
import math
import re

import hostile_laws as laws
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.loops.jit.native import (
    BoundEvaluate,
    Evaluate,
    Library,
    ObjectFile,
)
from teleop_drake.loops.jit.packing import Place
from teleop_drake.loops.jit.scalar_code import (
    ALL,
    RATE,
    SIGNALS,
    Arrays,
    MakeCode,
    TraceLaw,
    TraceProgram,
)
from teleop_drake.loops.jit.symbolic_arrays import Table
from teleop_drake.loops.jit.symbols import Untraceable
from teleop_drake.loops.numerics.jacobi import singular_values

TABLE = np.array([[0, 1], [2, 3], [4, 5]])


def matrices(x, table):
    A = x[:9].reshape(3, 3)
    U, sigma, Vt = singular_values(A)
    b = np.linalg.solve(A, x[9:]) + np.linalg.inv(A).T @ x[9:]
    return np.concatenate(((U * sigma @ Vt).ravel(), sigma, b))


def small_matrices(x, table):
    U, sigma, Vt = singular_values(x[:4].reshape(2, 2))
    kept = sigma > 1.0
    if not kept.any():
        return np.zeros(4)
    return (U[:, kept] @ (sigma[kept, np.newaxis] * Vt[kept])).ravel()


def row_of(x, starts):
    return int(np.searchsorted(starts, x, side="right"))


def tables(x, table):
    starts = np.array([-0.5, 0.3])
    row = min(max(row_of(x[0], starts), 0), 2)
    limits = np.clip(x, -0.2, np.abs(x[1]))
    return np.concatenate(
        (np.minimum(limits, x), table[row, 1] * np.where(x > 0, x, 1))
    )


def writes_into(result, x, sign):
    for i in range(3):
        result[i] = sign * x[i] if x[i] > 0 else math.sin(x[i])
    if x[0] > x[1]:
        result[0] = 7.0


def branches(x, table):
    result = np.zeros(12)
    writes_into(result, x, 2.0)
    first = result.copy()
    writes_into(result, x, -1.0)
    return np.tanh(result) + first**2 * (1.0 if (x[3] < 0) & (x[4] < 0) else 2.0)


def zero_times_a_number(x, table):
    zeros = np.concatenate((0.0 * x, np.sin(x) * -0.0, np.zeros(12) * x))
    # It is pi for 0.0, and -pi for -0.0.
    return np.array([np.arctan2(zero, -1.0) for zero in zeros])


def zero_times_an_overflow(x, table):
    large = 1e200 * (2.0 + np.sin(x))
    return 0.0 * (large * large)


def zero_times_an_overflow_of_a_sum(x, table):
    large = 1.7e308 + np.sin(x)
    return 0.0 * (large + large)


FUNCTIONS = [
    matrices,
    small_matrices,
    tables,
    branches,
    zero_times_a_number,
    zero_times_an_overflow,
    zero_times_an_overflow_of_a_sum,
]


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid")
def test_machine_code_and_python_agree(function):
    rng = np.random.default_rng(1)
    size = len(function(rng.normal(size=12), TABLE))
    num_x = max(size, 12)
    table = TABLE.view(Table)

    def Needed(a):
        a.dx[0:size] = a.follow(function)(a.x[0:12], table)

    def Others(a):
        x = a.y[0] * a.x[0:12] + a.t - a.m[0] * a.p[1]
        a.y[1:] = a.follow(function)(x, table)

    def InPython(*arguments):
        *arrays, wanted = arguments
        Needed(Arrays(*arrays))
        if wanted:
            Others(Arrays(*arrays))

    program = TraceProgram((Needed, Others), (size + 1, num_x, 1), 2)
    library = Library(ObjectFile(MakeCode(program)), "evaluate")
    evaluate = Evaluate(library)
    for _ in range(50):
        x = rng.normal(size=num_x)
        m = rng.normal(size=1)
        p = rng.normal(size=2)
        results = []
        for f in (InPython, evaluate):
            for wanted in (RATE, ALL, SIGNALS):
                y = np.full(size + 1, 0.5)
                dx = np.zeros(num_x)
                f(0.3, x, m, p, y, dx, wanted)
                # Machine code leaves the rate out where nobody wants it.
                if wanted == SIGNALS:
                    dx[:] = 0.0
                results.append(np.concatenate((y, dx)))
        assert_allclose(results[3:], results[:3], rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize("law", laws.RIGHT, ids=lambda law: law.__name__)
@pytest.mark.filterwarnings("ignore")
def test_a_law_is_the_same_in_machine_code(law):
    rng = np.random.default_rng(1)
    program = TraceLaw(law, [Place(0, (6,))], 6)
    memory = np.zeros(6)
    result = np.zeros(len(program.stores))
    call = BoundEvaluate(
        Library(ObjectFile(MakeCode(program)), "evaluate"), memory, result
    )
    for k in range(40):
        memory[:] = x = rng.normal(size=6) * (0.7 if k % 2 else 1.5)
        call()
        expected = np.full(len(result), np.nan)
        with contextlib.suppress(IndexError):
            expected[:] = law(x.copy())
        if np.isfinite(expected).any():
            assert_allclose(result, expected, rtol=1e-12, atol=1e-12)
        else:
            assert not np.isfinite(result).all()


def found_in_tables(breaks, rows, x):
    left = np.searchsorted(breaks, x[0])
    right = np.searchsorted(breaks, x[0], side="right")
    last = rows[right - 1]
    return np.array([left, right, last[0], last[1], rows[left, 1]])


def CompileTables(count):
    """Returns the code, the memory, the result and the call of found_in_tables()."""
    layouts = [Place(0, (count,)), Place(count, (count, 2)), Place(3 * count, (1,))]
    program = TraceLaw(found_in_tables, layouts, 3 * count + 1)
    code = MakeCode(program)
    memory = np.zeros(3 * count + 1)
    result = np.zeros(5)
    call = BoundEvaluate(Library(ObjectFile(code), "evaluate"), memory, result)
    return code, memory, result, call


# From 32 rows on a table is searched where it lies.
@pytest.mark.parametrize("count", [31, 32, 333])
def test_tables_are_searched_and_indexed_as_in_python(count):
    rng = np.random.default_rng(1)
    _, memory, result, call = CompileTables(count)
    breaks = np.sort(rng.normal(size=count))
    breaks[5] = breaks[4]  # Where two are equal, the sides differ.
    rows = rng.normal(size=(count, 2))
    memory[: 3 * count] = np.concatenate([breaks, rows.ravel()])
    for x in [*rng.normal(size=50), *breaks, -9.0, 9.0]:
        memory[-1] = x
        call()
        left = np.searchsorted(breaks, x)
        right = np.searchsorted(breaks, x, side="right")
        # Python refuses an index that is too large, and counts -1 from the end.
        other = rows[left, 1] if left < count else np.nan
        expected = [left, right, *rows[right - 1], other]
        assert_array_equal(result, expected)
    memory[-1] = np.nan
    call()
    assert result[:2].tolist() == [count, count]


def test_the_code_does_not_grow_with_a_table():
    short, long = (CompileTables(count)[0] for count in (64, 6400))
    assert len(long) - len(short) < 50


def test_an_index_between_whole_numbers_is_none():
    def law(rows, x):
        return np.array([rows[x[0]]])

    program = TraceLaw(law, [Place(0, (40,)), Place(40, (1,))], 41)
    memory = np.arange(41.0)
    result = np.zeros(1)
    call = BoundEvaluate(
        Library(ObjectFile(MakeCode(program)), "evaluate"), memory, result
    )
    for x, expected in ((7.0, 7.0), (7.5, np.nan), (-1.0, 39.0), (40.0, np.nan)):
        memory[-1] = x
        call()
        assert_array_equal(result, [expected])


@pytest.mark.parametrize("of_parameter", [True, False])
def test_a_law_that_writes_into_what_it_keeps_is_refused(of_parameter):
    def law(buffer, x):
        buffer[0] += x[0]
        return buffer

    def Needed(a):
        if of_parameter:
            a.dx[0:1] = a.follow(law)(a.p, a.x)
        else:
            a.dx[0:1] = a.follow(functools.partial(law, np.zeros(1)))(a.x)

    with pytest.raises(Untraceable, match=r"law.*read-only"):
        TraceProgram((Needed, lambda a: None), (0, 1, 0), 1)


def test_whole_numbers_beyond_those_of_floats_are_rounded():
    def law(x):
        return np.array([int(1e17 * x[0]) + 1, np.where(x[1] > 0, 2**52, 1) * 3])

    program = TraceLaw(law, [Place(0, (2,))], 2)
    memory = np.zeros(2)
    result = np.zeros(2)
    call = BoundEvaluate(
        Library(ObjectFile(MakeCode(program)), "evaluate"), memory, result
    )
    for x, expected in (
        ((1e-3, -1.0), (1e14 + 1, 3.0)),
        ((1.0, 1.0), (1e17, 3.0 * 2**52)),
    ):
        memory[:] = x
        call()
        assert_array_equal(result, expected)


def Outside():
    """Returns what is outside of the laws."""
    plain = laws.COUNTS, laws.NOTES, laws.WORK, laws.TOTAL
    return repr([*plain, vars(laws.Calls), vars(laws.Damper), vars(laws.DAMPER)])


@pytest.mark.parametrize("law", laws.REFUSED, ids=lambda law: law.__name__)
def test_what_would_be_wrong_is_refused_with_its_line(law):
    before = Outside()
    lines, first = inspect.getsourcelines(law)
    marked = [first + i for i, line in enumerate(lines) if "# here" in line]
    with pytest.raises(Untraceable) as error:
        TraceLaw(law, [Place(0, (6,))], 6)
    name, line = re.match(r"(\w+)\(\), line (\d+): ", str(error.value)).groups()
    assert name == law.__name__ or hasattr(laws, name) or hasattr(laws.Damper, name)
    assert not marked or int(line) in marked
    # What it has changed is as it was.
    assert Outside() == before

"""Functions as graphs of operations, and as LLVM's code: the same numbers."""

import contextlib
import inspect
import math
import re

import hostile_laws as laws
import numpy as np
import pytest

from teleop_drake.engine.source import put
from teleop_drake.jit.native import (
    BoundEvaluate,
    Evaluate,
    Library,
    ObjectFile,
)
from teleop_drake.jit.scalar_code import MakeCode, TraceLaw, TraceProgram
from teleop_drake.jit.symbols import Untraceable
from teleop_drake.numerics.jacobi import singular_values

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

TEXT = """
def evaluate(t, x, m, p, q, y, dx, everything):
    put(dx[0:{size}], f0(x[0:12], q.reshape((3, 2))))
    if not everything:
        return
    put(y[1:], f0(y[0] * x[0:12] + t - m[0] * p[1], q.reshape((3, 2))))
"""


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid")
def test_machine_code_and_python_agree(function):
    rng = np.random.default_rng(1)
    size = len(function(rng.normal(size=12), TABLE))
    names, num_x, q = {"put": put, "f0": function}, max(size, 12), TABLE.ravel()
    text = TEXT.format(size=size)
    python = dict(names)
    exec(text, python)
    program = TraceProgram(text, names, (size + 1, num_x, 1), 2, q)
    library = Library(ObjectFile(MakeCode(program)), "evaluate")
    evaluate = Evaluate(library.Address("evaluate"), library, False)
    for _ in range(50):
        x, m, p = rng.normal(size=num_x), rng.normal(size=1), rng.normal(size=2)
        results = []
        for f in (python["evaluate"], evaluate):
            for everything in (False, True):
                y, dx = np.full(size + 1, 0.5), np.zeros(num_x)
                f(0.3, x, m, p, q, y, dx, everything)
                results.append(np.concatenate((y, dx)))
        np.testing.assert_allclose(results[2:], results[:2], rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize("law", laws.RIGHT, ids=lambda law: law.__name__)
@pytest.mark.filterwarnings("ignore")
def test_a_law_is_the_same_in_machine_code(law):
    rng = np.random.default_rng(1)
    program = TraceLaw(law, [np.ones(6)])
    memory, result = np.zeros(6), np.zeros(len(program.stores))
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
            np.testing.assert_allclose(result, expected, rtol=1e-12, atol=1e-12)
        else:
            assert not np.isfinite(result).all()


@pytest.mark.parametrize("law", laws.REFUSED, ids=lambda law: law.__name__)
def test_what_would_be_wrong_is_refused_with_its_line(law):
    before = repr([laws.COUNTS, laws.NOTES, vars(laws.Calls), laws.WORK, laws.TOTAL])
    lines, first = inspect.getsourcelines(law)
    marked = [first + i for i, line in enumerate(lines) if "# here" in line]
    with pytest.raises(Untraceable) as error:
        TraceLaw(law, [np.ones(6)])
    name, line = re.match(r"(\w+)\(\), line (\d+): ", str(error.value)).groups()
    assert hasattr(laws, name) or name == law.__name__
    assert not marked or int(line) in marked
    # What it has changed is as it was.
    after = repr([laws.COUNTS, laws.NOTES, vars(laws.Calls), laws.WORK, laws.TOTAL])
    assert after == before

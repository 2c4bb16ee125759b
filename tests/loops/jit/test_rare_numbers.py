"""Rare numbers: nan in searches, and whole numbers that no float represents."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.kernel import FixedBlock, Kernel

NAN = float("nan")
SHORT = np.array([0.0, 1.0, 2.0])
# A long table is searched by bisection.
LONG = np.arange(50.0)


def compiled(law, u, *parameters):
    """Returns law(*parameters, u) as machine code computes it."""
    expected = law(*parameters, np.array(u))
    names = {f"parameter{i}": value for i, value in enumerate(parameters)}
    kernel = Kernel(outputs={"y": (law, *names, "u")}, parameters=names)
    block = FixedBlock("b", kernel, inputs={"u": len(u)}, outputs={"y": len(expected)})
    context = block.CreateDefaultContext()
    block.GetInputPort("u").FixValue(context, u)
    evaluator = Evaluator(block, context, as_machine_code=True)
    y, _ = evaluator.Evaluate(context)
    ((_, place),) = evaluator.program.signals.items()
    return y[place], expected


def places(table, u):
    left = np.searchsorted(table, u[0])
    right = np.searchsorted(table, u[0], side="right")
    return np.array([left * 1.0, right * 1.0])


@pytest.mark.parametrize("x", [-1.0, 0.0, 0.5, 2.0, 99.0, NAN, np.inf, -np.inf])
@pytest.mark.parametrize("end", [[], [NAN], [NAN, NAN]], ids=["", "nan", "two nan"])
@pytest.mark.parametrize("table", [SHORT, LONG], ids=["short", "long"])
def test_nan_is_behind_all_numbers_of_a_table(table, end, x):
    """It was in front of them."""
    found, expected = compiled(places, [x], np.append(table, end))
    assert_array_equal(found, expected)


def after(u):
    """Returns the next whole number, its negative, and comparisons with it."""
    n = int(u[0]) + 1
    return np.array([float(n), -n, 1.0 if n > 0 else 2.0, 1.0 if n < -(2**53) else 2.0])


@pytest.mark.parametrize("x", [5.0, 2.0**53 - 1, 2.0**53, 1e16, 1e17, -1e17])
def test_a_result_that_no_float_represents_is_rounded(x):
    """It was nan, and each comparison with it was false."""
    found, expected = compiled(after, [x])
    assert_array_equal(found, expected)


def there_and_back(u):
    return np.array([int(u[0]) + 1 - int(u[0])])


@pytest.mark.parametrize(("x", "is_known"), [(2.0**53 - 2, True), (1e17, False)])
def test_a_rounded_whole_number_is_no_operand_of_another_one(x, is_known):
    """What floats make of it is 0; Python has 1."""
    found, expected = compiled(there_and_back, [x])
    assert expected == [1.0]
    assert_array_equal(found, expected if is_known else [NAN])


def larger(u):
    n = int(u[0])
    m = n + 1 if u[1] > 0 else n - 1
    return np.array([float(m), 1.0 if m > 0 else 2.0, abs(m) * 1.0])


@pytest.mark.parametrize("x", [3.0, 1e17, -1e17])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_rounded_whole_number_passes_a_branch(x, side):
    found, expected = compiled(larger, [x, side])
    assert_array_equal(found, expected)

"""Tapes of symbolic expressions against Drake's own evaluation of them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake import symbolic
from pydrake.symbolic import Expression, Variable

from teleop_drake.loops.engine.expression_tape import MakeTape, UnknownExpression

t = Variable("t")
x = Variable("x")
y = Variable("y")
CONDITIONS = [
    x < y, x <= y, x > y, x >= y, x == y, x != y,
    symbolic.logical_and(x > 0, y > 0, x < y),
    symbolic.logical_or(x > 1, y > 1),
    symbolic.logical_not(symbolic.logical_and(x > 0, y < 0.5)),
]  # fmt: skip
EXPRESSIONS = [
    Expression(2.5), Expression(t), x - y, 1 - x, -x - y, 3 * x - 2 * y, -x * y,
    2 * x * y / 3, x / (y + 1), x**2, x**3 * y, x**-2, (y + 2) ** 0.5, (y + 2) ** x,
    abs(x - 1), symbolic.sqrt(y + 2), symbolic.exp(x), symbolic.log(y + 2),
    symbolic.sin(x * t), symbolic.cos(x), symbolic.tan(y), symbolic.asin(x / 9),
    symbolic.acos(x / 9), symbolic.atan(x), symbolic.atan2(x, y), symbolic.sinh(x),
    symbolic.cosh(x), symbolic.tanh(x), symbolic.floor(3 * x), symbolic.ceil(3 * x),
    symbolic.min(x, y), symbolic.max(x, y),
    *(symbolic.if_then_else(c, x + 1, y - 1) for c in CONDITIONS),
]  # fmt: skip
POINTS = [(0.3, 0.7, 0.2), (1.2, -0.4, 1.1), (2.0, 1.5, -0.6), (0.1, 0.8, 0.8)]


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=str)
def test_a_tape_has_the_value_of_its_expression(expression):
    tape, constants = MakeTape([expression], [t, x, y])
    for point in POINTS:
        expected = expression.Evaluate(dict(zip((t, x, y), point, strict=True)))
        time, a, b = point
        value = tape(constants, time, np.array([a]), np.array([b]))
        assert_allclose(value, [expected], rtol=1e-14, atol=1e-15)


def test_a_common_part_is_computed_once():
    tape, _ = MakeTape([symbolic.sin(x) + y, symbolic.sin(x) * y], [x, y])
    assert len(tape.rows) == 3  # No constants among them.


def test_constants_do_not_decide_which_rows_there_are():
    one, constants = MakeTape([3 * x + 3 * y], [x, y])
    other, _ = MakeTape([3 * x + 4 * y], [x, y])
    assert one == other
    assert constants.tolist() == [3.0, 3.0]


def test_what_is_no_operation_is_named():
    unknown = symbolic.uninterpreted_function("f", [Expression(x)])
    with pytest.raises(UnknownExpression, match="UninterpretedFunction"):
        MakeTape([unknown], [x])


def test_too_many_parts_are_refused():
    """The limit counts a common part as often as it occurs."""
    expression = x + y
    for _ in range(16):
        expression = symbolic.sin(expression) * symbolic.cos(expression)
    with pytest.raises(UnknownExpression, match="more than 50000 operations"):
        MakeTape([expression], [x, y])

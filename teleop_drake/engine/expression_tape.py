"""Drake's symbolic expressions as a list of operations on numbers.

The values of a tape are the elements of the given vectors, and the value of each row,
in this order. A row is a constant, or an operation that names its operands by
their places among the values. Expressions that differ in their constants alone have the
same tape, and therefore the same machine code.
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.symbolic import Expression, ExpressionKind, Formula, FormulaKind, Variable

from teleop_drake.arrays import Array

# Expressions and formulas that are one function of their operands.
_SAME_OPERANDS: dict[Any, Callable[..., Any]] = {
    ExpressionKind.Abs: np.absolute,
    ExpressionKind.Sqrt: np.sqrt,
    ExpressionKind.Exp: np.exp,
    ExpressionKind.Log: np.log,
    ExpressionKind.Sin: np.sin,
    ExpressionKind.Cos: np.cos,
    ExpressionKind.Tan: np.tan,
    ExpressionKind.Asin: np.arcsin,
    ExpressionKind.Acos: np.arccos,
    ExpressionKind.Atan: np.arctan,
    ExpressionKind.Sinh: np.sinh,
    ExpressionKind.Cosh: np.cosh,
    ExpressionKind.Tanh: np.tanh,
    ExpressionKind.Floor: np.floor,
    ExpressionKind.Ceil: np.ceil,
    ExpressionKind.Div: np.divide,
    ExpressionKind.Min: np.minimum,
    ExpressionKind.Max: np.maximum,
    ExpressionKind.Atan2: np.arctan2,
    ExpressionKind.IfThenElse: np.where,
    FormulaKind.Lt: np.less,
    FormulaKind.Leq: np.less_equal,
    FormulaKind.Gt: np.greater,
    FormulaKind.Geq: np.greater_equal,
    FormulaKind.Eq: np.equal,
    FormulaKind.Neq: np.not_equal,
    FormulaKind.Not: np.logical_not,
}

# Of any number of operands, which are taken one after another.
_REDUCED = {
    ExpressionKind.Add: np.add,
    ExpressionKind.Mul: np.multiply,
    FormulaKind.And: np.logical_and,
    FormulaKind.Or: np.logical_or,
}

# The first operand, a number, is left out where it is this one.
_NEUTRAL = {ExpressionKind.Add: 0.0, ExpressionKind.Mul: 1.0}

# More parts take seconds to read and minutes to compile.
_MAX_PARTS = 50_000

# Powers up to this one are products.
_MAX_FACTORS = 16


class UnknownExpression(ValueError):
    """An expression with a part that is no operation of a tape."""


@dataclass(frozen=True)
class Tape:
    """A law that computes expressions, operation by operation.

    Attributes:
        rows: The function of each operation and the places of its operands, or None and
            the index of a constant.
        results: The place of the value of each expression.
    """

    rows: tuple[tuple[Any, ...], ...]
    results: tuple[int, ...]

    def __call__(self, constants: Array, *vectors: Any) -> Array:
        """Returns the values of the expressions.

        Args:
            constants: The numbers in the expressions.
            vectors: The values of the variables that MakeTape() was given; a number is
                a vector of one element.
        """
        values: list[Any] = []
        for vector in vectors:
            values.extend(np.ravel(vector))
        for function, *places in self.rows:
            if function is None:
                values.append(constants[places[0]])
            else:
                values.append(function(*[values[place] for place in places]))
        return np.array([values[place] for place in self.results])


def MakeTape(
    expressions: Iterable[Expression], variables: Sequence[Variable]
) -> tuple[Tape, Array]:
    """Returns the tape of expressions, and their constants.

    Args:
        variables: The elements of the vectors that the tape takes, one after another.

    Raises:
        UnknownExpression: If a part of an expression is no operation of a tape.
    """
    writer = _Writer(variables)
    results = tuple(writer.Write(expression) for expression in expressions)
    return Tape(tuple(writer.rows), results), np.array(writer.constants, float)


class _Writer:
    """Writes the rows of a tape, no operation twice.

    Equal constants are not shared, because which numbers are equal would decide which
    rows there are.

    Attributes:
        rows: The rows in their order, with the places of their values.
        constants: The numbers that rows mention by their indices.
    """

    def __init__(self, variables: Sequence[Variable]):
        self.rows: dict[tuple[Any, ...], int] = {}
        self.constants: list[float] = []
        self._variables = {x.get_id(): i for i, x in enumerate(variables)}
        self._num_parts = 0

    def Write(self, value: Expression | Formula | float) -> int:
        """Writes an expression or a formula; returns the place of its value."""
        self._num_parts += 1
        if self._num_parts > _MAX_PARTS:
            raise UnknownExpression(f"there are more than {_MAX_PARTS} operations")
        if not isinstance(value, Expression | Formula):
            return self._Constant(float(value))
        kind = value.get_kind()
        _, operands = value.Unapply()
        if kind == ExpressionKind.Constant:
            return self._Constant(operands[0])
        if kind == ExpressionKind.Var:
            return self._variables[operands[0].get_id()]
        if kind == ExpressionKind.Pow:
            return self._Power(*operands)
        if kind in _NEUTRAL and operands[0] == _NEUTRAL[kind]:
            operands = operands[1:]
        places = map(self.Write, operands)
        if kind in _REDUCED:
            return self._Reduce(_REDUCED[kind], places)
        if kind in _SAME_OPERANDS:
            return self._Row(_SAME_OPERANDS[kind], *places)
        raise UnknownExpression(f"{kind.name} is no operation of a tape")

    def _Power(self, base: Expression, exponent: Expression) -> int:
        """Writes a power, with a whole number as exponent as a product."""
        place = self.Write(base)
        is_number = exponent.get_kind() == ExpressionKind.Constant
        number = exponent.Evaluate() if is_number else 0.0
        if not (number.is_integer() and 1 <= abs(number) <= _MAX_FACTORS):
            return self._Row(np.power, place, self.Write(exponent))
        product = self._Reduce(np.multiply, [place] * int(abs(number)))
        if number > 0:
            return product
        return self._Row(np.divide, self._Constant(1.0), product)

    def _Constant(self, value: float) -> int:
        self.constants.append(value)
        return self._Row(None, len(self.constants) - 1)

    def _Reduce(self, function: Callable[..., Any], places: Iterable[int]) -> int:
        """Writes a function of two operands that is applied one after another."""
        return functools.reduce(functools.partial(self._Row, function), places)

    def _Row(self, *row: Any) -> int:
        """Writes a row, unless it is there; returns the place of its value."""
        return self.rows.setdefault(row, len(self._variables) + len(self.rows))

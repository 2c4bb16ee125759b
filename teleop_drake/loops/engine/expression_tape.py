"""Drake's symbolic expressions as a tape, which is a list of operations on numbers.

A tape computes a list of values. It begins with the elements of the given vectors, and
each row of the tape appends one value. A row is a constant, or an operation whose
operands are indices in the list. Expressions that differ only in their constants have
the same tape, and therefore the same machine code.
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.symbolic import Expression, ExpressionKind, Formula, FormulaKind, Variable

from teleop_drake.loops.framework.arrays import Array

# Kinds of expressions and formulas that apply one function to all their operands.
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

# Kinds with any number of operands, reduced by a function of two.
_REDUCED = {
    ExpressionKind.Add: np.add,
    ExpressionKind.Mul: np.multiply,
    FormulaKind.And: np.logical_and,
    FormulaKind.Or: np.logical_or,
}

# Drake's sums and products begin with a constant; it is left out if it has this value.
_NEUTRAL = {ExpressionKind.Add: 0.0, ExpressionKind.Mul: 1.0}

# Larger expressions take seconds to read and minutes to compile.
_MAX_PARTS = 50_000

# Whole powers up to this exponent are written as products.
_MAX_FACTORS = 16


class UnknownExpression(ValueError):
    """Raised for an expression that is too large or has an unknown operation."""


@dataclass(frozen=True)
class Tape:
    """A law that computes expressions, operation by operation.

    Attributes:
        rows: The function of each operation and the indices of its operands in the list
            of values, or None and the index of a constant.
        results: The index of each expression's value in the list of values.
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
        expressions: The expressions.
        variables: The elements of the vectors that the tape takes, one after another.

    Raises:
        UnknownExpression: If an expression is too large or has an unknown operation.
    """
    writer = _Writer(variables)
    results = tuple(writer.Write(expression) for expression in expressions)
    return Tape(tuple(writer.rows), results), np.array(writer.constants, float)


class _Writer:
    """Writes the rows of a tape. Equal operations share one row.

    Equal constants have separate rows. Otherwise the rows would depend on which
    constants happen to be equal, and new values would need a new compilation.

    Attributes:
        rows: The rows in their order, with the indices of their values.
        constants: The constants, which the rows name by their indices.
    """

    def __init__(self, variables: Sequence[Variable]):
        self.rows: dict[tuple[Any, ...], int] = {}
        self.constants: list[float] = []
        self._variables = {x.get_id(): i for i, x in enumerate(variables)}
        self._num_parts = 0

    def Write(self, value: Expression | Formula | float) -> int:
        """Writes an expression or a formula; returns the index of its value."""
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
        """Writes a power; a small whole exponent gives a product."""
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
        """Reduces operands from left to right by a function of two."""
        return functools.reduce(functools.partial(self._Row, function), places)

    def _Row(self, *row: Any) -> int:
        """Writes a row unless it exists; returns the index of its value."""
        return self.rows.setdefault(row, len(self._variables) + len(self.rows))

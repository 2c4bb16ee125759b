"""Drake's symbolic expressions as a list of operations on numbers.

The values of a tape are the time, the elements of the given vectors, and the result of
each row, in this order. A row names its operands by their places among the values. The
constants of the expressions are numbers beside the rows: expressions that differ in
their constants alone have the same rows, and therefore the same machine code.
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from pydrake.symbolic import Expression, ExpressionKind, Formula, FormulaKind, Variable

from teleop_drake.arrays import Array, Indices

CONSTANT = 0
UNARY = 1
BINARY = 2
SELECT = 3

# Expressions and formulas that are one function of their operands.
_SAME_OPERANDS = {
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
    ExpressionKind.Div: np.divide,
    ExpressionKind.Min: np.minimum,
    ExpressionKind.Max: np.maximum,
    ExpressionKind.Atan2: np.arctan2,
    FormulaKind.Lt: np.less,
    FormulaKind.Leq: np.less_equal,
    FormulaKind.Eq: np.equal,
    FormulaKind.Not: np.logical_not,
}

# Of any number of operands.
_REDUCED = {FormulaKind.And: np.logical_and, FormulaKind.Or: np.logical_or}

FUNCTIONS: tuple[Callable[..., Any], ...] = (
    *_SAME_OPERANDS.values(),
    *_REDUCED.values(),
    np.negative,
    np.add,
    np.subtract,
    np.multiply,
    np.power,
)
"""The functions that a row names by their places here."""

# More parts take seconds to read and minutes to compile.
_MAX_PARTS = 50_000

# Powers up to this one are products.
_MAX_FACTORS = 16


class UnknownExpression(ValueError):
    """An expression with a part that is no operation of a tape."""


class Tape(NamedTuple):
    """Expressions as operations, each after those of its operands.

    Attributes:
        rows: [operation, first, second, third] of each operation (k, 4):
            [CONSTANT, place in `constants`, 0, 0],
            [UNARY, place in FUNCTIONS, operand, 0],
            [BINARY, place in FUNCTIONS, operand, operand],
            [SELECT, condition, operand if it holds, operand otherwise].
        constants: The numbers in the expressions.
        results: The place of the value of each expression.
    """

    rows: Indices
    constants: Array
    results: Indices


def evaluate_tape(tape: Tape, time: Any, *vectors: Array) -> Array:
    """Returns the values of the expressions of a tape at a time in s.

    Args:
        vectors: The values of the variables that MakeTape() was given.
    """
    values = [time]
    for vector in vectors:
        for i in range(len(vector)):
            values.append(vector[i])
    for k in range(len(tape.rows)):
        operation, first, second, third = tape.rows[k]
        if operation == CONSTANT:
            values.append(tape.constants[first])
        elif operation == UNARY:
            values.append(FUNCTIONS[first](values[second]))
        elif operation == BINARY:
            values.append(FUNCTIONS[first](values[second], values[third]))
        else:
            values.append(np.where(values[first], values[second], values[third]))
    return np.array([values[i] for i in tape.results])


def MakeTape(
    expressions: Iterable[Expression],
    time: Variable,
    vectors: Sequence[Sequence[Variable]],
) -> Tape:
    """Returns the tape of expressions.

    Args:
        time: The variable that stands for the time.
        vectors: The variables in the expressions, as evaluate_tape() takes them.

    Raises:
        UnknownExpression: If a part of an expression is no operation of a tape.
    """
    variables = [time, *(variable for vector in vectors for variable in vector)]
    writer = _Writer(variables)
    results = [writer.Write(expression) for expression in expressions]
    return Tape(
        rows=np.reshape(np.array(writer.rows, np.int64), (-1, 4)),
        constants=np.array(writer.constants, float),
        results=np.array(results, np.int64),
    )


class _Writer:
    """Writes the rows of a tape, no operation twice.

    Attributes:
        rows: As Tape has them.
        constants: As Tape has them. Equal constants are not shared: which numbers are
            equal would decide which rows there are.
    """

    def __init__(self, variables: Sequence[Variable]):
        self.rows: list[tuple[int, int, int, int]] = []
        self.constants: list[float] = []
        self._variables = {x.get_id(): i for i, x in enumerate(variables)}
        self._num_variables = len(variables)
        self._places: dict[tuple[int, int, int, int], int] = {}
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
        if kind in _SAME_OPERANDS:
            return self._Apply(_SAME_OPERANDS[kind], *map(self.Write, operands))
        if kind in _REDUCED:
            apply = functools.partial(self._Apply, _REDUCED[kind])
            return functools.reduce(apply, map(self.Write, operands))
        if kind not in _WRITERS:
            raise UnknownExpression(f"{kind.name} is no operation of a tape")
        return _WRITERS[kind](self, operands)

    def Sum(self, operands: Sequence[Any]) -> int:
        """Writes a sum. Its first operand is a number, as Drake has it."""
        number, *terms = operands
        result = None if number == 0 else self._Constant(number)
        for term in terms:
            # A product begins with its number, too.
            is_product = term.get_kind() == ExpressionKind.Mul
            factors = term.Unapply()[1] if is_product else [1.0]
            if factors[0] == -1 and result is not None:
                value = self.Product([1.0, *factors[1:]])
                result = self._Apply(np.subtract, result, value)
                continue
            value = self.Write(term)
            result = value if result is None else self._Apply(np.add, result, value)
        assert result is not None
        return result

    def Product(self, operands: Sequence[Any]) -> int:
        """Writes a product. Its first operand is a number, as Drake has it."""
        number, *factors = operands
        places = [self.Write(factor) for factor in factors]
        if abs(number) != 1:
            places.insert(0, self._Constant(number))
        product = functools.reduce(functools.partial(self._Apply, np.multiply), places)
        return self._Apply(np.negative, product) if number == -1 else product

    def Power(self, operands: Sequence[Any]) -> int:
        """Writes a power, with a whole number as exponent as a product."""
        base = self.Write(operands[0])
        exponent = operands[1]
        is_number = exponent.get_kind() == ExpressionKind.Constant
        number = exponent.Evaluate() if is_number else 0.0
        if not (number.is_integer() and 1 <= abs(number) <= _MAX_FACTORS):
            return self._Apply(np.power, base, self.Write(exponent))
        product = base
        for _ in range(int(abs(number)) - 1):
            product = self._Apply(np.multiply, product, base)
        if number > 0:
            return product
        return self._Apply(np.divide, self._Constant(1.0), product)

    def Greater(self, operands: Sequence[Any]) -> int:
        """Writes whether the first of two operands is greater."""
        first, second = map(self.Write, operands)
        return self._Apply(np.less, second, first)

    def GreaterEqual(self, operands: Sequence[Any]) -> int:
        """Writes whether the first of two operands is greater, or equal."""
        first, second = map(self.Write, operands)
        return self._Apply(np.less_equal, second, first)

    def NotEqual(self, operands: Sequence[Any]) -> int:
        """Writes whether two operands differ."""
        is_equal = self._Apply(np.equal, *map(self.Write, operands))
        return self._Apply(np.logical_not, is_equal)

    def Ceiling(self, operands: Sequence[Any]) -> int:
        """Writes the smallest whole number that is not less than the operand."""
        negated = self._Apply(np.negative, self.Write(operands[0]))
        return self._Apply(np.negative, self._Apply(np.floor, negated))

    def Selection(self, operands: Sequence[Any]) -> int:
        """Writes [condition, value if it holds, value otherwise]."""
        condition, first, second = map(self.Write, operands)
        return self._Add((SELECT, condition, first, second))

    def _Constant(self, value: float) -> int:
        self.constants.append(value)
        return self._Add((CONSTANT, len(self.constants) - 1, 0, 0))

    def _Apply(self, function: Callable[..., Any], *operands: int) -> int:
        operation = UNARY if len(operands) == 1 else BINARY
        first, second = (*operands, 0)[:2]
        return self._Add((operation, FUNCTIONS.index(function), first, second))

    def _Add(self, row: tuple[int, int, int, int]) -> int:
        """Returns the place of a row's value, which is added unless it is there."""
        if row not in self._places:
            self._places[row] = self._num_variables + len(self.rows)
            self.rows.append(row)
        return self._places[row]


_WRITERS: dict[Any, Callable[[_Writer, Sequence[Any]], int]] = {
    ExpressionKind.Add: _Writer.Sum,
    ExpressionKind.Mul: _Writer.Product,
    ExpressionKind.Pow: _Writer.Power,
    ExpressionKind.Ceil: _Writer.Ceiling,
    ExpressionKind.IfThenElse: _Writer.Selection,
    FormulaKind.Gt: _Writer.Greater,
    FormulaKind.Geq: _Writer.GreaterEqual,
    FormulaKind.Neq: _Writer.NotEqual,
}

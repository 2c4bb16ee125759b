"""Symbolic numbers, whose operators record operations in a graph.

`tracing` defines the graph. `symbolic_arrays` has arrays of symbolic numbers, and
`traced_numpy` defines numpy's functions on both.
"""

import math
from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np


class Untraceable(Exception):
    """Raised for a function that cannot be a graph of operations."""

    place: str = ""  # The function and the line of the cause.

    def __str__(self) -> str:
        """Returns the place and the reason."""
        return f"{self.place}: {self.args[0]}" if self.place else str(self.args[0])


# From here on, floats do not represent each whole number.
_LARGEST = 2.0**53

COMPARISONS = frozenset({"lt", "le", "gt", "ge", "eq", "ne"})
"""The operations that compare two numbers."""


def _Operator(operation: str) -> Callable[..., Any]:
    """Returns the method of an operator whose first operand is the Symbol."""

    def Operator(self: "Symbol", *others: Any) -> Any:
        return self.Operate(operation, self, *others)

    return Operator


def _Reflected(operation: str) -> Callable[..., Any]:
    """Returns the method of an operator whose second operand is the Symbol."""

    def Operator(self: "Symbol", other: Any) -> Any:
        return self.Operate(operation, other, self)

    return Operator


class Symbol:
    """A value whose operators record an operation instead of computing it."""

    __slots__ = ()

    @abstractmethod
    def Operate(self, operation: str, *operands: Any) -> Any:
        """Records an operation with the Symbol as an operand; returns its value."""

    __add__ = _Operator("add")
    __radd__ = _Reflected("add")
    __sub__ = _Operator("sub")
    __rsub__ = _Reflected("sub")
    __mul__ = _Operator("mul")
    __rmul__ = _Reflected("mul")
    __truediv__ = _Operator("div")
    __rtruediv__ = _Reflected("div")
    __floordiv__ = _Operator("floordiv")
    __pow__ = _Operator("pow")
    __rpow__ = _Reflected("pow")
    __and__ = _Operator("and")
    __rand__ = _Reflected("and")
    __or__ = _Operator("or")
    __ror__ = _Reflected("or")
    __lt__ = _Operator("lt")
    __le__ = _Operator("le")
    __gt__ = _Operator("gt")
    __ge__ = _Operator("ge")
    __eq__ = _Operator("eq")
    __ne__ = _Operator("ne")
    __neg__ = _Operator("neg")
    __abs__ = _Operator("fabs")


class Ref(NamedTuple):
    """A reference to a node of a graph by its index."""

    place: int


def KindOf(value: Any) -> type:
    """Returns the kind of a number, symbolic or not: bool, int or float."""
    if isinstance(value, Number):
        return value.kind
    if isinstance(value, (bool, np.bool_)):
        return bool
    return int if isinstance(value, (int, np.integer)) else float


def IsBoolean(value: Any) -> bool:
    """Returns whether a number is a boolean."""
    return KindOf(value) is bool


def AsReal(value: Any) -> Any:
    """Returns a number as a float; a boolean becomes 1 or 0."""
    if not isinstance(value, Number):
        return _AsFloat(value)
    if value.kind is float:
        return value
    if value.kind is bool:
        return value.graph.Add("select", value, 1.0, 0.0)
    return Number(value.graph, value.ref)


def AsWhole(value: Any, rounded: Any = None) -> Any:
    """Returns a Number as a whole number; see Number for `rounded`."""
    ref = None if rounded is None else rounded.ref
    return Number(value.graph, AsReal(value).ref, int, ref)


def Rounded(value: Any) -> Any:
    """Returns a number, or what floats make of a whole number; see Number."""
    if isinstance(value, Number) and value.rounded is not None:
        return Number(value.graph, value.rounded)
    return value


def _Exact(value: Any) -> Any:
    """Returns a number; nan for a whole number that floats may have rounded."""
    if not isinstance(value, Number) or value.rounded is None:
        return value
    is_exact = abs(AsReal(value)) < _LARGEST
    return value.graph.Add("select", is_exact, AsReal(value), math.nan)


def AsBoolean(value: Any) -> Any:
    """Returns whether a number is not zero."""
    return value if IsBoolean(value) else value != 0.0


def Not(value: Any) -> Any:
    """Returns the negation of AsBoolean()."""
    value = AsBoolean(value)
    if isinstance(value, Number):
        return value.graph.Add("not", value)
    return not value


def IsSame(a: Any, b: Any) -> bool:
    """Returns whether two values are the same number or node."""
    if isinstance(a, Number) or isinstance(b, Number):
        return isinstance(a, Number) and isinstance(b, Number) and a.ref == b.ref
    # Texts distinguish 0.0 from -0.0, and True from 1.0.
    return repr(a) == repr(b)


def CheckPrecision(value: Any) -> None:
    """Refuses arrays and numbers of another precision than Python's floats."""
    if not isinstance(value, (np.ndarray, np.generic)):
        return
    dtype = np.asarray(value).dtype
    if dtype.kind in "fc" and dtype != np.float64:
        raise Untraceable(f"numbers of the type {dtype}")


def _AsFloat(value: Any) -> float:
    """Returns a plain number as a float; refuses one that is not exactly a float."""
    CheckPrecision(value)
    result = float(value)
    if isinstance(value, (int, np.integer)) and result != int(value):
        raise Untraceable("a whole number that no float represents")
    return result


def _Operand(value: Any) -> Any:
    """Returns a number as a float or a Number of the graph; None for anything else."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    return AsReal(value) if isinstance(value, _NUMBERS) else None


def Apply(operation: str, *values: Any) -> Any:
    """Records an operation with a Number as an operand; returns its value."""
    graph = None
    operands = []
    for value in values:
        if isinstance(value, Number):
            graph = value.graph
        operand = _Operand(value)
        if operand is None:
            return NotImplemented
        operands.append(operand)
    assert graph is not None
    return graph.Add(operation, *operands)


def _Arithmetic(operation: str, a: Any, b: Any) -> Any:
    """Returns a sum, a difference or a product."""
    kinds = {KindOf(a), KindOf(b)}
    if kinds == {bool}:
        if operation == "mul":
            return _Logical("and", a, b)
        raise Untraceable(
            "a sum of two comparisons, which numpy takes for `or`: write float()"
        )
    if float in kinds:
        return _Combined(operation, a, b)
    result = _Combined(operation, _Exact(a), _Exact(b))
    if not isinstance(result, Number):
        return result
    return AsWhole(result, _Combined(operation, Rounded(a), Rounded(b)))


def _Combined(operation: str, a: Any, b: Any) -> Any:
    """Returns a sum, a difference or a product of floats."""
    result = _FoldedProduct(a, b) if operation == "mul" else None
    return Apply(operation, a, b) if result is None else result


def _Compare(operation: str, a: Any, b: Any) -> Any:
    """Returns a comparison; whole numbers beyond 2^53 are compared as floats."""
    return Apply(operation, Rounded(a), Rounded(b))


def _FoldedProduct(a: Any, b: Any) -> Any:
    """Returns a product with a constant 0 or 1 that needs no operation, else None."""
    for x, y in ((a, b), (b, a)):
        if isinstance(x, Number):
            continue
        factor = _Operand(x)
        if factor == 1.0:
            return AsReal(y)
        if factor == 0.0 and y.graph.IsZeroTimes(y):
            return 0.0
    return None


def _Quotient(a: Any, b: Any) -> Any:
    """Returns a / b; a division by 0.5, 1, 2 or 4 becomes a product, as exact."""
    divisor = None if isinstance(b, Number) else _Operand(b)
    if divisor is not None and abs(divisor) in (0.5, 1.0, 2.0, 4.0):
        return AsReal(a) * (1 / divisor)
    return Apply("div", a, b)


def _Power(a: Any, b: Any) -> Any:
    """Returns a ** b; small powers are products."""
    if float not in (KindOf(a), KindOf(b)):
        raise Untraceable("a power of whole numbers: write float()")
    power = None if isinstance(b, Number) else _Operand(b)
    if power in (0.0, 1.0, 2.0, 3.0, 4.0):
        return math.prod([AsReal(a)] * int(power), start=1.0)
    return Apply("sqrt", a) if power == 0.5 else Apply("pow", a, b)


def _Logical(operation: str, a: Any, b: Any) -> Any:
    """Returns `and` or `or` of two booleans, one of which is a Number."""
    if not (IsBoolean(a) and IsBoolean(b)):
        return NotImplemented
    number = a if isinstance(a, Number) else b
    return number.graph.Add(operation, a, b)


NUMPY: dict[str, Callable[..., Any]] = {}
"""The functions that call numpy's functions on Numbers, set by traced_numpy.

They are `ufunc`, for numpy's ufuncs, `function`, for all others, and `remainder`.
"""


class Dispatched:
    """A value on which numpy's functions are called through NUMPY."""

    __slots__ = ()

    def __array_ufunc__(self, *arguments: Any, **keywords: Any) -> Any:
        """Calls a ufunc of numpy."""
        return NUMPY["ufunc"](*arguments, **keywords)

    def __array_function__(self, *arguments: Any) -> Any:
        """Calls another function of numpy."""
        return NUMPY["function"](*arguments)


class Number(Dispatched, Symbol):
    """A symbolic number: a node of a graph.

    From 2^53 on, floats do not represent each whole number, as Python's ints do. The
    result of an operation on two whole numbers is the float next to it. If it is an
    operand of a further operation on whole numbers, the result is nan, because its
    error could be of any size. Comparisons ignore the error.

    Attributes:
        graph: The tracing.Graph.
        ref: The node.
        kind: The type of the number in Python: bool, int or float.
        rounded: For the result of an operation on whole numbers, the node of what
            floats make of it, never nan; None for any other number.
    """

    __slots__ = ("graph", "kind", "ref", "rounded")

    def __init__(
        self, graph: Any, ref: Ref, kind: type = float, rounded: Ref | None = None
    ):
        self.graph = graph
        self.ref = ref
        self.kind = kind
        self.rounded = rounded

    def __bool__(self) -> bool:
        """Returns the truth on the way that is being traced; see tracing."""
        return bool(self.graph.Decide(AsBoolean(self).ref))

    def __repr__(self) -> str:
        raise Untraceable("it makes text of what depends on numbers")

    def __format__(self, _: str) -> str:
        return repr(self)

    __hash__ = None  # type: ignore[assignment]

    def Operate(self, operation: str, *operands: Any) -> Any:
        """Records an operation; returns its value, or NotImplemented."""
        if operation not in _OPERATIONS:  # Floor division.
            return NotImplemented
        return _OPERATIONS[operation](*operands)

    def __neg__(self) -> Any:
        if self.kind is bool:
            raise Untraceable("the negative of a comparison: write float()")
        return self._Alike("neg")

    def __pos__(self) -> "Number":
        return self

    def __abs__(self) -> "Number":
        if self.kind is bool:
            return self
        return self._Alike("fabs")

    def __mod__(self, other: Any) -> Any:
        return NUMPY["remainder"](self, other)

    def __rmod__(self, other: Any) -> Any:
        return NUMPY["remainder"](other, self)

    def _Alike(self, operation: str) -> "Number":
        """Returns an operation on the Number, which has the same kind."""
        value = self.graph.Add(operation, self)
        rounded = None
        if self.rounded is not None:
            rounded = self.graph.Add(operation, Rounded(self)).ref
        return Number(self.graph, value.ref, self.kind, rounded)


_NUMBERS = (Number, bool, int, float, np.bool_, np.integer, np.floating)

_OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": partial(_Arithmetic, "add"),
    "sub": partial(_Arithmetic, "sub"),
    "mul": partial(_Arithmetic, "mul"),
    "div": _Quotient,
    "pow": _Power,
    "and": partial(_Logical, "and"),
    "or": partial(_Logical, "or"),
    **{name: partial(_Compare, name) for name in COMPARISONS},
}

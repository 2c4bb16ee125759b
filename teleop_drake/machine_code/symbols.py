"""Numbers of which it is only known what is done with them.

See tracing, which makes a graph of that.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np


class Untraceable(Exception):
    """A function that does what a graph of operations cannot.

    Attributes:
        function: The function; None if it is not known.
    """

    function: Any = None


class Ref(NamedTuple):
    """A node, as an argument of another one.

    Attributes:
        place: Its index.
    """

    place: int


def AsReal(value: Any) -> Any:
    """Returns a number of which a yes is 1 and a no is 0.

    Args:
        value: A number, also one of Python.
    """
    if not isinstance(value, Number):
        return float(value)
    if value.graph.IsBoolean(value):
        return value.graph.Add("select", value, 1.0, 0.0)
    return value


def IsSame(column: Sequence[Any]) -> bool:
    """Returns whether all are the same number, whatever it is.

    Args:
        column: Numbers, also those of Python.
    """
    first = column[0]
    if isinstance(first, Number):
        return all(isinstance(x, Number) and x.ref == first.ref for x in column)
    return all(not isinstance(x, Number) and x == first for x in column)


def _Constant(value: Any) -> Any:
    """Returns a number of Python's as a float; None if it is something else."""
    if isinstance(value, (bool, np.bool_, int, float, np.integer, np.floating)):
        return float(value)
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return value.item()
    return None


def _Operator(
    name: str, fold: Callable[[Any, Any], Any] | None = None, swapped: bool = False
) -> Callable[[Any, Any], Any]:
    """Returns a method for an operator with two sides.

    Args:
        name: The operation.
        fold: Returns the result if one side makes it trivial, else None.
        swapped: Whether the number is on the right.
    """

    def Operate(self: "Number", other: Any) -> Any:
        if not isinstance(other, Number):
            other = _Constant(other)
            if other is None:
                return NotImplemented
        a, b = (other, self) if swapped else (self, other)
        a, b = _Plain(a), _Plain(b)
        if fold is not None:
            result = fold(a, b)
            if result is not None:
                return result
        return self.graph.Add(name, a, b)

    return Operate


def _Plain(value: Any) -> Any:
    return AsReal(value) if isinstance(value, Number) else value


def _FoldSum(a: Any, b: Any) -> Any:
    if isinstance(a, float) and a == 0.0:
        return b
    return a if isinstance(b, float) and b == 0.0 else None


def _FoldDifference(a: Any, b: Any) -> Any:
    if isinstance(b, float) and b == 0.0:
        return a
    return -b if isinstance(a, float) and a == 0.0 else None


def _FoldProduct(a: Any, b: Any) -> Any:
    for x, y in ((a, b), (b, a)):
        if isinstance(x, float) and x in (0.0, 1.0, -1.0):
            return 0.0 if x == 0.0 else (y if x == 1.0 else -y)
    return None


def _FoldQuotient(a: Any, b: Any) -> Any:
    if isinstance(a, float) and a == 0.0:
        return 0.0
    if isinstance(b, float) and abs(b) in (0.5, 1.0, 2.0, 4.0):
        return a * (1 / b)
    return None


class Notes(Protocol):
    """Where it is noted what is done with numbers: a tracing.Graph.

    Attributes:
        nodes: What has been done, as (operation, arguments).
    """

    nodes: list[Any]

    def Add(self, operation: str, *arguments: Any) -> "Number":
        """Returns the value of an operation.

        Args:
            operation: Its name.
            arguments: Numbers, also those of Python.
        """

    def IsBoolean(self, value: Any) -> bool:
        """Returns whether a number is a yes or no.

        Args:
            value: A number, also one of Python.
        """

    def Decide(self, condition: Ref) -> bool:
        """Returns the answer to a condition.

        Args:
            condition: The node.
        """


class Number:
    """A value that a graph computes.

    Args:
        graph: The graph.
        place: Of its node.

    Attributes:
        graph: The graph.
        ref: The node.
    """

    __slots__ = ("graph", "ref")

    def __init__(self, graph: "Notes", place: Ref):
        self.graph, self.ref = graph, place

    def __bool__(self) -> bool:
        """Returns the answer on the way that is being traced."""
        condition = self if self.graph.IsBoolean(self) else self != 0.0
        return self.graph.Decide(condition.ref)

    __add__ = _Operator("add", _FoldSum)
    __radd__ = _Operator("add", _FoldSum, swapped=True)
    __sub__ = _Operator("sub", _FoldDifference)
    __rsub__ = _Operator("sub", _FoldDifference, swapped=True)
    __mul__ = _Operator("mul", _FoldProduct)
    __rmul__ = _Operator("mul", _FoldProduct, swapped=True)
    __truediv__ = _Operator("div", _FoldQuotient)
    __rtruediv__ = _Operator("div", _FoldQuotient, swapped=True)
    __lt__ = _Operator("lt")
    __le__ = _Operator("le")
    __gt__ = _Operator("gt")
    __ge__ = _Operator("ge")
    __eq__ = _Operator("eq")
    __ne__ = _Operator("ne")
    __hash__ = None  # type: ignore[assignment]

    def __and__(self, other: Any) -> Any:
        return self._Logical("and", other)

    def __or__(self, other: Any) -> Any:
        return self._Logical("or", other)

    __rand__, __ror__ = __and__, __or__

    def _Logical(self, name: str, other: Any) -> Any:
        if isinstance(other, (bool, np.bool_)):
            is_and = name == "and"
            return self if bool(other) == is_and else bool(other)
        if isinstance(other, Number):
            return self.graph.Add(name, self, other)
        return NotImplemented

    def __invert__(self) -> "Number":
        return self.graph.Add("not", self)

    def __neg__(self) -> Any:
        node = self.graph.nodes[self.ref.place]
        if node.operation == "neg":
            return Number(self.graph, node.arguments[0])
        return self.graph.Add("neg", AsReal(self))

    def __pos__(self) -> "Number":
        return self

    def __abs__(self) -> "Number":
        return self.graph.Add("fabs", AsReal(self))

    def __pow__(self, other: Any) -> Any:
        power = None if isinstance(other, Number) else _Constant(other)
        if power is not None and power == int(power) and 0 <= power <= 4:
            result: Any = 1.0
            for _ in range(int(power)):
                result = self * result
            return result
        if power == 0.5:
            return self.sqrt()
        return self.graph.Add("pow", self, other if power is None else power)

    def __rpow__(self, other: Any) -> "Number":
        return self.graph.Add("pow", _Constant(other), self)

    # What numpy's functions call on the elements of an array of objects.
    def sqrt(self) -> "Number":
        """Returns the square root."""
        return self.graph.Add("sqrt", self)

    def exp(self) -> "Number":
        """Returns the exponential."""
        return self.graph.Add("exp", self)

    def log(self) -> "Number":
        """Returns the natural logarithm."""
        return self.graph.Add("log", self)

    def sin(self) -> "Number":
        """Returns the sine."""
        return self.graph.Add("sin", self)

    def cos(self) -> "Number":
        """Returns the cosine."""
        return self.graph.Add("cos", self)

    def tan(self) -> "Number":
        """Returns the tangent."""
        return self.graph.Add("tan", self)

    def arctan(self) -> "Number":
        """Returns the arc tangent."""
        return self.graph.Add("atan", self)

    def tanh(self) -> "Number":
        """Returns the hyperbolic tangent."""
        return self.graph.Add("tanh", self)

    def floor(self) -> "Number":
        """Returns the largest whole number that is not larger."""
        return self.graph.Add("floor", self)

    def trunc(self) -> "Number":
        """Returns the whole number next to it on the side of zero."""
        return self.graph.Add("trunc", AsReal(self))

    def conjugate(self) -> "Number":
        """Returns the number itself."""
        return self

    @property
    def size(self) -> int:
        """One, as numpy's numbers have it."""
        return 1


class Numbers(np.ndarray):
    """An array of `Number`s, whose indices may be Numbers too."""

    def __array_wrap__(self, array: Any, *_: Any) -> Any:
        """Returns a number where numpy would have an array without dimensions."""
        return array.view(Numbers) if array.ndim > 0 else array[()]

    def __getitem__(self, key: Any) -> Any:
        keys = key if isinstance(key, tuple) else (key,)
        for axis, item in enumerate(keys):
            if isinstance(item, Number):
                return self._Selected(keys, axis)
            if isinstance(item, np.ndarray) and item.dtype == object:
                # A mask: each answer is a way of its own.
                mask = np.array([bool(x) for x in item.flat]).reshape(item.shape)
                return self[(*keys[:axis], mask, *keys[axis + 1 :])]
        return super().__getitem__(key)

    def _Selected(self, keys: tuple[Any, ...], axis: int) -> Any:
        index = keys[axis]
        rows = [self[(*keys[:axis], i, *keys[axis + 1 :])] for i in range(len(self))]
        if axis > 0:
            raise Untraceable("an index behind another one depends on numbers")
        result = rows[-1]
        for i in range(len(rows) - 2, -1, -1):
            result = Where(index == float(i), rows[i], result)
        return result

    def __setitem__(self, key: Any, value: Any) -> None:
        keys = key if isinstance(key, tuple) else (key,)
        if any(isinstance(item, Number) for item in keys):
            raise Untraceable("it writes at an index that depends on numbers")
        super().__setitem__(key, value)

    def __lt__(self, other: Any) -> Any:
        return np.less(self, other, dtype=object)

    def __le__(self, other: Any) -> Any:
        return np.less_equal(self, other, dtype=object)

    def __gt__(self, other: Any) -> Any:
        return np.greater(self, other, dtype=object)

    def __ge__(self, other: Any) -> Any:
        return np.greater_equal(self, other, dtype=object)

    def __eq__(self, other: Any) -> Any:
        return np.equal(self, other, dtype=object)

    def __ne__(self, other: Any) -> Any:
        return np.not_equal(self, other, dtype=object)


def AsNumbers(value: Any) -> Numbers:
    """Returns an array as one that Numbers can be written into.

    Args:
        value: An array, a number or a list of them.
    """
    return np.asarray(value, object).view(Numbers)


def HasNumbers(value: Any) -> bool:
    """Returns whether a value is a Number, or may have one in it.

    Args:
        value: Anything that a function takes.
    """
    if isinstance(value, np.ndarray):
        return bool(value.dtype == object)
    if isinstance(value, (list, tuple)):
        return any(HasNumbers(item) for item in value)
    return isinstance(value, Number)


def Where(condition: Any, a: Any, b: Any) -> Any:
    """Returns a where a condition holds and b elsewhere, element by element.

    Args:
        condition: A yes or no, or an array of them.
        a: A number or an array.
        b: A number or an array.
    """
    if any(isinstance(item, np.ndarray) for item in (condition, a, b)):
        arrays = (np.asarray(item, object) for item in (condition, a, b))
        result = np.frompyfunc(Where, 3, 1)(*arrays)
        return result.view(Numbers) if isinstance(result, np.ndarray) else result
    if not isinstance(condition, Number):
        return a if condition else b
    if IsSame((a, b)):
        return a
    if not condition.graph.IsBoolean(condition):
        condition = condition != 0.0
    return condition.graph.Add("select", condition, AsReal(a), AsReal(b))

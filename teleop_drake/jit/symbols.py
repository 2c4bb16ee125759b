"""Symbolic numbers and arrays of them: each records the operation that made it.

`tracing` makes a graph of these operations. `traced_numpy` defines numpy's functions on
symbolic numbers and arrays.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, NoReturn

import numpy as np

UFUNCS: dict[Any, Any] = {}
"""The functions that compute the ufuncs of numpy on arrays of objects."""

FUNCTIONS: dict[Any, Callable[..., Any]] = {}
"""The replacements of other functions of numpy."""


class Untraceable(Exception):
    """Raised for a function that cannot be a graph of operations."""

    function: Any = None  # The outermost one, if it is known.
    place: str = ""  # The function and the line that are to blame.

    def __str__(self) -> str:
        """Returns the place and the reason."""
        return f"{self.place}: {self.args[0]}" if self.place else str(self.args[0])


class Ref(NamedTuple):
    """A node, by its index, as an argument of another one."""

    place: int


def IsBoolean(value: Any) -> bool:
    """Returns whether a number, symbolic or of Python, is a boolean."""
    if isinstance(value, Number):
        return value.is_boolean
    return isinstance(value, (bool, np.bool_))


def LimitOf(value: Any) -> float | None:
    """Returns the largest magnitude of a whole number; None for other numbers."""
    if IsBoolean(value):
        return 1.0
    if isinstance(value, Number):
        return value.limit
    return abs(float(value)) if isinstance(value, (int, np.integer)) else None


def AsReal(value: Any) -> Any:
    """Returns a number as a float, of which a yes is 1 and a no is 0."""
    if not isinstance(value, Number):
        return _AsFloat(value)
    if value.is_boolean:
        return value.graph.Add("select", value, 1.0, 0.0)
    return value if value.limit is None else Number(value.graph, value.ref)


def AsWhole(value: Any, limit: float = math.inf) -> Any:
    """Returns a Number as a whole number of at most a magnitude."""
    return Number(value.graph, AsReal(value).ref, limit=limit)


def AsBoolean(value: Any) -> Any:
    """Returns whether a number is not zero."""
    return value if IsBoolean(value) else value != 0.0


def Not(value: Any) -> Any:
    """Returns the opposite of AsBoolean()."""
    value = AsBoolean(value)
    if isinstance(value, Number):
        return value.graph.Add("not", value)
    return not value


def IsSame(column: Sequence[Any]) -> bool:
    """Returns whether all values of a column are the same number or node."""
    first = column[0]
    if isinstance(first, Number):
        return all(isinstance(x, Number) and x.ref == first.ref for x in column)
    # Texts distinguish 0.0 from -0.0, and True from 1.0.
    return all(not isinstance(x, Number) and repr(x) == repr(first) for x in column)


def CheckPrecision(value: Any) -> None:
    """Refuses arrays and numbers that round in another way than Python's floats."""
    if isinstance(value, Numbers) or not isinstance(value, (np.ndarray, np.generic)):
        return
    if value.dtype.kind in "fc" and value.dtype != np.float64:
        raise Untraceable(f"numbers of the type {value.dtype}")


def _AsFloat(value: Any) -> float:
    """Returns a number of Python's as a float; refuses values that are no numbers."""
    CheckPrecision(value)
    result = float(value)
    if isinstance(value, (int, np.integer)) and result != int(value):
        raise Untraceable("a whole number that is no float")
    return result


def _Constant(value: Any) -> Any:
    """Returns a number of Python's as a float; None if it is something else."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if not isinstance(value, (bool, np.bool_, int, float, np.integer, np.floating)):
        return None
    return _AsFloat(value)


def _Operand(value: Any) -> Any:
    """Returns a number as a float or a Number of the graph; None for anything else."""
    return AsReal(value) if isinstance(value, Number) else _Constant(value)


def _LimitOfResult(operation: str, a: Any, b: Any) -> float | None:
    """Returns the largest magnitude of a sum, difference or product of whole numbers.

    Floats have gaps from 2^53 on, where whole numbers of Python's have none.
    """
    first = LimitOf(a)
    second = LimitOf(b)
    if first is None or second is None:
        return None
    limit = first * second if operation == "mul" else first + second
    if limit > 2.0**53:
        raise Untraceable("whole numbers that may be beyond 2^53: write float()")
    return limit


def Apply(operation: str, *values: Any) -> Any:
    """Returns the value of an operation, of which one argument is a Number."""
    graph = next(value.graph for value in values if isinstance(value, Number))
    return graph.Add(operation, *values)


def _Arithmetic(operation: str, a: Any, b: Any) -> Any:
    """Returns a sum, a difference or a product."""
    if IsBoolean(a) and IsBoolean(b):
        if operation == "mul":
            return Both(a, b)
        raise Untraceable(
            "a sum of two comparisons, which numpy takes for `or`: write float()"
        )
    x = _Operand(a)
    y = _Operand(b)
    if x is None or y is None:
        return NotImplemented
    limit = _LimitOfResult(operation, a, b)
    result = _FoldedProduct(x, y) if operation == "mul" else None
    if result is None:
        result = Apply(operation, x, y)
    if limit is None or not isinstance(result, Number):
        return result
    return AsWhole(result, limit)


def _FoldedProduct(a: Any, b: Any) -> Any:
    """Returns a product that takes no operation; None if it takes one."""
    for x, y in ((a, b), (b, a)):
        if not isinstance(x, float):
            continue
        if x == 1.0:
            return y
        if x == -1.0:
            return -y
        if x == 0.0 and y.graph.IsZeroTimes(y):
            return 0.0
    return None


def _Quotient(a: Any, b: Any) -> Any:
    """Returns a / b."""
    x = _Operand(a)
    y = _Operand(b)
    if x is None or y is None:
        return NotImplemented
    if isinstance(y, float) and abs(y) in (0.5, 1.0, 2.0, 4.0):
        return x * (1 / y)
    return Apply("div", x, y)


def _Power(a: Any, b: Any) -> Any:
    """Returns a ** b; small powers are products."""
    x = _Operand(a)
    y = _Operand(b)
    if x is None or y is None:
        return NotImplemented
    base = LimitOf(a)
    exponent = LimitOf(b)
    if base is None or exponent is None:
        num_bits = 0.0
    else:
        num_bits = exponent * math.log2(max(base, 1.0))
    if num_bits > 53.0:
        raise Untraceable("a power of whole numbers: write float()")
    if not isinstance(y, float):
        return Apply("pow", x, y)
    if y in (0.0, 1.0, 2.0, 3.0, 4.0):
        result: Any = 1.0
        for _ in range(int(y)):
            result = x * result
        return result
    if y == 0.5:
        return Apply("sqrt", x)
    return Apply("pow", x, y)


def _Comparison(operation: str, a: Any, b: Any) -> Any:
    """Returns whether a comparison holds."""
    x = _Operand(a)
    y = _Operand(b)
    return NotImplemented if x is None or y is None else Apply(operation, x, y)


def Both(a: Any, b: Any) -> Any:
    """Returns whether both of two hold; one of them is a Number."""
    if not (IsBoolean(a) and IsBoolean(b)):
        return NotImplemented
    for x, y in ((a, b), (b, a)):
        if not isinstance(x, Number):
            return y if x else False
    return Apply("and", a, b)


def Either(a: Any, b: Any) -> Any:
    """Returns whether one of two holds; one of them is a Number."""
    if not (IsBoolean(a) and IsBoolean(b)):
        return NotImplemented
    for x, y in ((a, b), (b, a)):
        if not isinstance(x, Number):
            return True if x else y
    return Apply("or", a, b)


class _Dispatched:
    """A value that numpy hands back to this module."""

    __slots__ = ()

    def __array_ufunc__(self, *arguments: Any, **keywords: Any) -> Any:
        return CallUfunc(*arguments, **keywords)

    def __array_function__(self, *arguments: Any) -> Any:
        return CallFunction(*arguments)


class Number(_Dispatched):
    """A value that a graph computes.

    Attributes:
        graph: The tracing.Graph.
        ref: The node.
        is_boolean: Whether it is a yes or no.
        limit: The largest magnitude of a whole number, also inf; None for others.
    """

    __slots__ = ("graph", "is_boolean", "limit", "ref")

    def __init__(
        self,
        graph: Any,
        ref: Ref,
        is_boolean: bool = False,
        limit: float | None = None,
    ):
        self.graph = graph
        self.ref = ref
        self.is_boolean = is_boolean
        self.limit = limit

    def __bool__(self) -> bool:
        """Returns the answer on the way that is being traced."""
        return bool(self.graph.Decide(AsBoolean(self).ref))

    def __repr__(self) -> str:
        raise Untraceable("it makes text of what depends on numbers")

    __hash__ = None  # type: ignore[assignment]

    def __add__(self, other: Any) -> Any:
        return _Arithmetic("add", self, other)

    def __radd__(self, other: Any) -> Any:
        return _Arithmetic("add", other, self)

    def __sub__(self, other: Any) -> Any:
        return _Arithmetic("sub", self, other)

    def __rsub__(self, other: Any) -> Any:
        return _Arithmetic("sub", other, self)

    def __mul__(self, other: Any) -> Any:
        return _Arithmetic("mul", self, other)

    def __rmul__(self, other: Any) -> Any:
        return _Arithmetic("mul", other, self)

    def __truediv__(self, other: Any) -> Any:
        return _Quotient(self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return _Quotient(other, self)

    def __pow__(self, other: Any) -> Any:
        return _Power(self, other)

    def __rpow__(self, other: Any) -> Any:
        return _Power(other, self)

    def __lt__(self, other: Any) -> Any:
        return _Comparison("lt", self, other)

    def __le__(self, other: Any) -> Any:
        return _Comparison("le", self, other)

    def __gt__(self, other: Any) -> Any:
        return _Comparison("gt", self, other)

    def __ge__(self, other: Any) -> Any:
        return _Comparison("ge", self, other)

    def __eq__(self, other: object) -> Any:
        return _Comparison("eq", self, other)

    def __ne__(self, other: object) -> Any:
        return _Comparison("ne", self, other)

    def __and__(self, other: Any) -> Any:
        return Both(self, other)

    def __rand__(self, other: Any) -> Any:
        return Both(other, self)

    def __or__(self, other: Any) -> Any:
        return Either(self, other)

    def __ror__(self, other: Any) -> Any:
        return Either(other, self)

    def __invert__(self) -> Any:
        raise Untraceable("~ of a number, which Python and numpy take for two; use not")

    def __neg__(self) -> Any:
        if self.is_boolean:
            raise Untraceable("the negative of a comparison: write float()")
        node = self.graph.nodes[self.ref.place]
        if node.operation == "neg":
            return Number(self.graph, node.arguments[0], limit=self.limit)
        return Number(self.graph, self.graph.Add("neg", self).ref, limit=self.limit)

    def __pos__(self) -> "Number":
        return self

    def __abs__(self) -> "Number":
        if self.is_boolean:
            return self
        return Number(self.graph, self.graph.Add("fabs", self).ref, limit=self.limit)

    def _RefuseRemainder(self, *others: Any) -> NoReturn:
        raise Untraceable("a remainder, or a number that is rounded")

    __mod__ = __rmod__ = __floordiv__ = __rfloordiv__ = _RefuseRemainder
    __divmod__ = __rdivmod__ = _RefuseRemainder
    __round__ = __floor__ = __ceil__ = _RefuseRemainder


class Table(np.ndarray):
    """An array whose indices may be Numbers and arrays of them."""

    def __getitem__(self, key: Any) -> Any:
        keys = key if isinstance(key, tuple) else (key,)
        if any(isinstance(item, Number) for item in keys):
            return self._Selected(keys)
        return super().__getitem__(_Masked(key))

    def _Selected(self, keys: tuple[Any, ...]) -> Any:
        """Returns the row that a Number says; nothing finite if there is none."""
        index, *others = keys
        is_number = isinstance(index, Number) and not index.is_boolean
        if not is_number:
            raise Untraceable("an index behind another one depends on numbers")
        plain = np.asarray(self)
        if plain.dtype.kind in "iu" and plain.dtype != np.int64:
            raise Untraceable("an element of whole numbers of a few bits")
        rows = [self[(i, *others)] for i in range(len(self))]
        index = AsReal(index)
        index = Where(index < 0.0, index + float(len(self)), index)
        result: Any = np.nan
        for i in reversed(range(len(rows))):
            result = Where(index == float(i), rows[i], result)
        if plain.dtype == np.int64 and isinstance(result, Number):
            return AsWhole(result, float(abs(plain).max()))
        return result


def _Masked(key: Any) -> Any:
    """Returns an index with the answers for yes or no; each is a way of its own."""
    if isinstance(key, tuple):
        return tuple(_Masked(item) for item in key)
    if not HasNumbers(key):
        return key
    items = Objects(key)
    if not all(map(IsBoolean, items.flat)):
        raise Untraceable("an array of indices depends on numbers")
    return np.array([bool(x) for x in items.flat], bool).reshape(items.shape)


def _NoType(array: Any) -> Any:
    raise Untraceable("it asks for the type, the memory or the order of numbers")


class Numbers(_Dispatched, Table):
    """An array of `Number`s."""

    dtype = astype = tobytes = data = base = property(_NoType)
    sort = argsort = partition = argpartition = property(_NoType)
    argmax = argmin = searchsorted = property(_NoType)

    def __setitem__(self, key: Any, value: Any) -> None:
        keys = key if isinstance(key, tuple) else (key,)
        if any(isinstance(item, Number) for item in keys):
            raise Untraceable("it writes at an index that depends on numbers")
        if HasNumbers(key) and np.shape(key) == self.shape and np.ndim(value) == 0:
            value = Where(key, value, self)
            key = ...
        key = _Masked(key)
        old = list(Objects(np.asarray(self)[key]).flat)
        new = list(Objects(value).flat)
        # An array of yes and no stays one, and so do whole numbers and others.
        if any(map(IsBoolean, old)):
            if not all(map(IsBoolean, new)):
                raise Untraceable("it writes numbers where yes or no was")
        elif any(LimitOf(x) is not None for x in old):
            if any(LimitOf(x) is None for x in new):
                raise Untraceable("it writes numbers where whole numbers were")
        else:
            value = _REAL(Objects(value))
        super().__setitem__(key, value)


_REAL = np.frompyfunc(AsReal, 1, 1)
_BOOLEAN = np.frompyfunc(AsBoolean, 1, 1)


def Objects(value: Any) -> Any:
    """Returns a value as an array that numpy takes for one of objects."""
    CheckPrecision(value)
    if isinstance(value, np.generic):  # Else its operators call numpy's functions.
        value = value.item()
    return np.asarray(np.asarray(value, object))


def AsNumbers(value: Any) -> Numbers:
    """Returns an array as one that Numbers can be written into."""
    CheckPrecision(value)
    return np.asarray(value, object).view(Numbers)


def _Result(value: Any) -> Any:
    """Returns what numpy made of arrays of objects."""
    if isinstance(value, (tuple, list)):
        return type(value)(_Result(item) for item in value)
    if not isinstance(value, np.ndarray) or value.dtype != object:
        return value
    return AsNumbers(value) if value.ndim else value.item()


def Unified(array: Any) -> Any:
    """Returns an array of one kind of numbers: of yes and no, whole ones, or floats.

    It is the same array where that is so.
    """
    if not isinstance(array, Numbers):
        return array
    kinds = {(IsBoolean(x), LimitOf(x) is None) for x in array.flat}
    return array if len(kinds) < 2 else AsFloats(array)


def AsFloats(array: Any) -> Numbers:
    """Returns a copy of an array in which yes and no and whole numbers are floats."""
    return AsNumbers(_REAL(np.asarray(array)))


# What numpy's own code hands to a ufunc although it means nothing.
_DEFAULTS = {"dtype": None, "where": True, "keepdims": False}


def CallUfunc(
    ufunc: Any, method: str, *inputs: Any, out: Any = None, **keywords: Any
) -> Any:
    """Calls a ufunc of numpy, as __array_ufunc__ has it."""
    if method == "reduce":
        result = _Reduced(ufunc, inputs[0], **keywords)
    elif method == "__call__" and ufunc in UFUNCS and not keywords:
        result = _Result(UFUNCS[ufunc](*map(Objects, inputs)))
    else:
        raise _IsUnknown(ufunc, keywords)
    if out is None:
        return result
    out[0][...] = result
    return out[0]


def _Reduced(ufunc: Any, value: Any, **keywords: Any) -> Any:
    """Returns what a ufunc makes of the elements along an axis."""
    given = {
        name: option
        for name, option in keywords.items()
        if name not in _DEFAULTS or option is not _DEFAULTS[name]
    }
    axis = given.pop("axis", 0)
    array = Objects(value)
    if ufunc in (np.logical_and, np.logical_or):
        given.pop("dtype", None)
        reduce = ufunc.reduce  # It asks no more elements than it has to, one by one.
        array = _BOOLEAN(array)
    elif ufunc in UFUNCS:
        reduce = UFUNCS[ufunc].reduce
    else:
        raise _IsUnknown(ufunc, keywords)
    if given:
        raise _IsUnknown(ufunc, given)
    if ufunc is np.add:  # The sum of yes and no is their number.
        array = _REAL(array)
    if axis is None:
        return _Result(reduce(array.ravel()))
    return _Result(reduce(array, axis=axis))


def _IsUnknown(ufunc: Any, keywords: dict[str, Any]) -> Untraceable:
    names = ", ".join([*keywords, "..."])
    return Untraceable(f"np.{ufunc.__name__}({names}) is not known")


def CallFunction(
    function: Any, types: Any, arguments: Sequence[Any], keywords: dict[str, Any]
) -> Any:
    """Calls another function of numpy, as __array_function__ has it."""
    if function not in FUNCTIONS:
        raise Untraceable(f"np.{function.__name__}() is not known")
    return FUNCTIONS[function](*arguments, **keywords)


def Structural(function: Any) -> Callable[..., Any]:
    """Returns a function of numpy that does not care what is in an array."""

    def Call(*arguments: Any, **keywords: Any) -> Any:
        arguments = tuple(_Plain(value) for value in arguments)
        keywords = {name: _Plain(value) for name, value in keywords.items()}
        return Unified(_Result(function(*arguments, **keywords)))

    return Call


def _Plain(value: Any) -> Any:
    if isinstance(value, (tuple, list)):
        if any(isinstance(item, (tuple, list, np.ndarray)) for item in value):
            return [_Plain(item) for item in value]
        return Objects(value) if HasNumbers(value) else value
    return Objects(value) if isinstance(value, (Number, Numbers)) else value


def HasNumbers(value: Any) -> bool:
    """Returns whether a value is a Number, or may have one in it."""
    if isinstance(value, np.ndarray):
        return isinstance(value, Numbers) or bool(value.dtype == object)
    if isinstance(value, dict):
        return any(map(HasNumbers, value.values()))
    if isinstance(value, (list, tuple, set)):
        return any(map(HasNumbers, value))
    return isinstance(value, Number)


def Where(condition: Any, a: Any, b: Any) -> Any:
    """Returns a where a condition holds and b elsewhere, element by element."""
    if any(isinstance(item, (np.ndarray, list, tuple)) for item in (condition, a, b)):
        return Unified(_Result(_WHERE(*map(Objects, (condition, a, b)))))
    if not isinstance(condition, Number):
        return a if condition else b
    if IsSame((a, b)):
        return a
    condition = AsBoolean(condition)
    if IsBoolean(a) and IsBoolean(b):
        return (condition & a) | (Not(condition) & b)
    result = condition.graph.Add("select", condition, AsReal(a), AsReal(b))
    return WithLimitOf(result, a, b)


def WithLimitOf(result: Any, a: Any, b: Any) -> Any:
    """Returns the choice between two numbers, as a whole number if both are."""
    first = LimitOf(a)
    second = LimitOf(b)
    if first is None or second is None:
        return result
    return AsWhole(result, max(first, second))


_WHERE = np.frompyfunc(Where, 3, 1)

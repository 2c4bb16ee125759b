"""Symbolic numbers and arrays of them: each records the operation that made it.

See tracing, which makes a graph of that, and traced_numpy, which fills in what numpy's
functions do with them.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

UFUNCS: dict[Any, Any] = {}
"""What computes a ufunc of numpy on arrays of objects."""

FUNCTIONS: dict[Any, Callable[..., Any]] = {}
"""What takes the place of another function of numpy."""


class Untraceable(Exception):
    """A function that does what a graph of operations cannot."""

    function: Any = None  # The outermost one, if it is known.
    place: str = ""  # The function and the line that are to blame.

    def __str__(self) -> str:
        """Returns the place and the reason."""
        return f"{self.place}: {self.args[0]}" if self.place else str(self.args[0])


class Ref(NamedTuple):
    """A node, by its index, as an argument of another one."""

    place: int


def IsBoolean(value: Any) -> bool:
    """Returns whether a number, also one of Python, is a yes or no."""
    if isinstance(value, Number):
        return value.is_boolean
    return isinstance(value, (bool, np.bool_))


def AsReal(value: Any) -> Any:
    """Returns a number of which a yes is 1 and a no is 0."""
    if not isinstance(value, Number):
        return float(value)
    return value.graph.Add("select", value, 1.0, 0.0) if value.is_boolean else value


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
    """Returns whether all are the same number, whatever it is."""
    first = column[0]
    if isinstance(first, Number):
        return all(isinstance(x, Number) and x.ref == first.ref for x in column)
    # As texts, 0.0 is not -0.0, and True is not 1.0.
    return all(not isinstance(x, Number) and repr(x) == repr(first) for x in column)


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

    Where fold() returns a result, that is it, and there is no operation `name`.
    """

    def Operate(self: "Number", other: Any) -> Any:
        if self.is_boolean and IsBoolean(other) and name in ("add", "mul", "sub"):
            if name == "mul":
                return self & other
            raise Untraceable(
                "a sum of two comparisons, which numpy takes for `or`: write float()"
            )
        other = AsReal(other) if isinstance(other, Number) else _Constant(other)
        if other is None:
            return NotImplemented
        a, b = (other, AsReal(self)) if swapped else (AsReal(self), other)
        result = fold(a, b) if fold else None
        return self.graph.Add(name, a, b) if result is None else result

    return Operate


def _FoldProduct(a: Any, b: Any) -> Any:
    for x, y in ((a, b), (b, a)):
        if isinstance(x, float) and abs(x) == 1.0:
            return y if x == 1.0 else -y
        if isinstance(x, float) and x == 0.0 and y.graph.IsFinite(y):
            return 0.0  # Also where it is -0.0.
    return None


def _FoldQuotient(a: Any, b: Any) -> Any:
    is_exact = isinstance(b, float) and abs(b) in (0.5, 1.0, 2.0, 4.0)
    return a * (1 / b) if is_exact else None


def _HasOtherSign(rest: Any, b: Any) -> Any:
    return (rest != 0.0) & (AsReal(rest < 0.0) != AsReal(b < 0.0))


def Remainder(a: Any, b: Any) -> Any:
    """Returns a % b, whose sign is that of b."""
    rest = Apply("fmod", a, b)
    rest = Where(_HasOtherSign(rest, b), rest + b, rest)
    return Where(rest == 0.0, Apply("copysign", rest, b), rest)


def FloorQuotient(a: Any, b: Any) -> Any:
    """Returns a // b."""
    rest = Apply("fmod", a, b)
    quotient = (a - rest) / b
    quotient = Where(_HasOtherSign(rest, b), quotient - 1.0, quotient)
    whole = Apply("floor", quotient)
    whole = Where(quotient - whole > 0.5, whole + 1.0, whole)
    whole = Where(whole == 0.0, Apply("copysign", whole, a / b), whole)
    return whole if isinstance(b, float) else Where(b == 0.0, a / b, whole)


def Apply(operation: str, *values: Any) -> Any:
    """Returns the value of an operation, of which one argument is a Number."""
    graph = next(value.graph for value in values if isinstance(value, Number))
    return graph.Add(operation, *values)


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
    """

    __slots__ = ("graph", "is_boolean", "ref")

    def __init__(self, graph: Any, ref: Ref, is_boolean: bool = False):
        self.graph, self.ref, self.is_boolean = graph, ref, is_boolean

    def __bool__(self) -> bool:
        """Returns the answer on the way that is being traced."""
        return bool(self.graph.Decide(AsBoolean(self).ref))

    def __repr__(self) -> str:
        raise Untraceable("it makes text of what depends on numbers")

    __hash__ = None  # type: ignore[assignment]

    def __and__(self, other: Any) -> Any:
        return self._Logical("and", other)

    def __or__(self, other: Any) -> Any:
        return self._Logical("or", other)

    def __xor__(self, other: Any) -> Any:
        both = IsBoolean(self) and IsBoolean(other)
        return AsReal(self) != AsReal(other) if both else NotImplemented

    __rand__, __ror__, __rxor__ = __and__, __or__, __xor__

    def _Logical(self, name: str, other: Any) -> Any:
        if not (IsBoolean(self) and IsBoolean(other)):
            return NotImplemented
        if not isinstance(other, Number):
            is_and = name == "and"
            return self if bool(other) == is_and else bool(other)
        return self.graph.Add(name, self, other)

    def __invert__(self) -> Any:
        raise Untraceable("~ of a number, which Python and numpy take for two; use not")

    def __neg__(self) -> Any:
        if self.is_boolean:
            raise Untraceable("the negative of a comparison: write float()")
        node = self.graph.nodes[self.ref.place]
        if node.operation == "neg":
            return Number(self.graph, node.arguments[0])
        return self.graph.Add("neg", self)

    def __pos__(self) -> "Number":
        return self

    def __abs__(self) -> "Number":
        return self if IsBoolean(self) else self.graph.Add("fabs", self)

    def __pow__(self, other: Any) -> Any:
        power = other if isinstance(other, Number) else _Constant(other)
        if power is None:
            return NotImplemented
        if isinstance(power, float) and power in (0.0, 1.0, 2.0, 3.0, 4.0):
            result: Any = 1.0
            for _ in range(int(power)):
                result = AsReal(self) * result
            return result
        if isinstance(power, float) and power == 0.5:
            return self.graph.Add("sqrt", self)
        return self.graph.Add("pow", self, power)

    def __round__(self, decimals: int | None = None) -> Any:
        own: Any = self
        scale = 10.0 ** (decimals or 0)
        whole = self.graph.Add("rint", own * scale)
        # Whole numbers of Python's have no -0.0.
        return whole + 0.0 if decimals is None else whole / scale

    def conjugate(self) -> "Number":
        """Returns the number itself."""
        return self

    @property
    def size(self) -> int:
        """One, as numpy's numbers have it."""
        return 1


for _name, _operation, _fold in (
    ("add", "add", None), ("sub", "sub", None),
    ("mul", "mul", _FoldProduct), ("truediv", "div", _FoldQuotient),
    ("mod", "fmod", Remainder), ("floordiv", "floor", FloorQuotient),
):  # fmt: skip
    setattr(Number, f"__{_name}__", _Operator(_operation, _fold))
    setattr(Number, f"__r{_name}__", _Operator(_operation, _fold, swapped=True))
for _name in ("lt", "le", "gt", "ge", "eq", "ne"):
    setattr(Number, f"__{_name}__", _Operator(_name))
setattr(Number, "__rpow__", _Operator("pow", swapped=True))  # noqa: B010


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
        rows = [self[(i, *others)] for i in range(len(self))]
        index = Where(index < 0.0, index + len(self), index)
        result: Any = np.nan
        for i in reversed(range(len(rows))):
            result = Where(index == float(i), rows[i], result)
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

    dtype = tobytes = data = base = property(_NoType)
    argsort = partition = argpartition = property(_NoType)

    def __setitem__(self, key: Any, value: Any) -> None:
        keys = key if isinstance(key, tuple) else (key,)
        if any(isinstance(item, Number) for item in keys):
            raise Untraceable("it writes at an index that depends on numbers")
        if HasNumbers(key) and np.shape(key) == self.shape and np.ndim(value) == 0:
            key, value = ..., Where(key, value, self)
        key = _Masked(key)
        # An array of yes and no stays one, and one of numbers too.
        if any(map(IsBoolean, Objects(np.asarray(self)[key]).flat)):
            if not all(map(IsBoolean, Objects(value).flat)):
                raise Untraceable("it writes numbers where yes or no was")
        else:
            value = _REAL(Objects(value))
        super().__setitem__(key, value)

    def astype(  # type: ignore[override]
        self, kind: Any, **keywords: Any
    ) -> Any:
        """Returns the numbers as others of Python's."""
        convert = FUNCTIONS.get(kind)
        if convert is None or keywords:
            raise Untraceable(f"astype({kind})")
        result = AsNumbers(np.frompyfunc(convert, 1, 1)(np.asarray(self)))
        # What is written into an array of whole numbers would be cut off.
        result.flags.writeable = convert is FUNCTIONS[float]
        return result

    def sort(self, *arguments: Any) -> None:  # type: ignore[override]
        """Sorts the elements in place."""
        self[...] = FUNCTIONS[np.sort](self, *arguments)


def _Method(name: str) -> Callable[..., Any]:
    return lambda self, *a, **k: FUNCTIONS[getattr(np, name)](self, *a, **k)


for _name in ("argmax", "argmin", "clip", "mean", "round"):
    setattr(Numbers, _name, _Method(_name))

_REAL = np.frompyfunc(AsReal, 1, 1)
_BOOLEAN = np.frompyfunc(AsBoolean, 1, 1)


def Objects(value: Any) -> Any:
    """Returns a value as an array that numpy takes for one of objects."""
    if isinstance(value, np.generic):  # Else its operators call numpy's functions.
        value = value.item()
    return np.asarray(np.asarray(value, object))


def AsNumbers(value: Any) -> Numbers:
    """Returns an array as one that Numbers can be written into."""
    return np.asarray(value, object).view(Numbers)


def _Result(value: Any) -> Any:
    """Returns what numpy made of arrays of objects."""
    if isinstance(value, (tuple, list)):
        return type(value)(_Result(item) for item in value)
    if not isinstance(value, np.ndarray) or value.dtype != object:
        return value
    return AsNumbers(value) if value.ndim else value.item()


def Unified(array: Any) -> Any:
    """Returns an array in which yes and no are numbers if anything else is."""
    if not isinstance(array, Numbers) or len(set(map(IsBoolean, array.flat))) < 2:
        return array
    return AsNumbers(_REAL(np.asarray(array)))


_DEFAULTS = {"dtype": None, "where": True, "keepdims": False}


def CallUfunc(
    ufunc: Any, method: str, *inputs: Any, out: Any = None, **keywords: Any
) -> Any:
    """Calls a ufunc of numpy, as __array_ufunc__ has it."""
    traced = UFUNCS.get(ufunc)
    is_along_axis = method in ("reduce", "accumulate")
    if is_along_axis and ufunc in (np.logical_and, np.logical_or):
        keywords.pop("dtype", None)
        traced = ufunc  # It asks no more elements than it has to, one by one.
        inputs = tuple(_BOOLEAN(Objects(value)) for value in inputs)
    keywords = {
        k: x for k, x in keywords.items() if x is not _DEFAULTS.get(k, keywords)
    }
    known = {"axis", "keepdims"} if is_along_axis else set()
    if traced is None or not keywords.keys() <= known:
        names = ", ".join([*keywords, "..."])
        raise Untraceable(f"np.{ufunc.__name__}({names}) is not known")
    arrays = [Objects(value) for value in inputs]
    if is_along_axis:
        if ufunc in (np.add, np.multiply):  # The sum of yes and no is their number.
            arrays = [_REAL(array) for array in arrays]
        if keywords == {"axis": None}:
            arrays, keywords = [arrays[0].ravel()], {}
    result = _Result(getattr(traced, method)(*arrays, **keywords))
    if out is None:
        return result
    out[0][...] = result
    return out[0]


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
    return condition.graph.Add("select", condition, AsReal(a), AsReal(b))


_WHERE = np.frompyfunc(Where, 3, 1)

"""Functions of numpy, math and Python on the Numbers of a graph.

A function of numpy that is not defined here is refused when it is called with Numbers.
"""

import builtins
import copy
import math
import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from teleop_drake.loops.jit.symbolic_arrays import (
    BOOLEAN,
    REAL,
    AsFloats,
    AsNumbers,
    HasNumbers,
    Interp,
    Inverse,
    IsClose,
    Numbers,
    Objects,
    Remainder,
    Result,
    Search,
    Sign,
    Solve,
    Unified,
    Where,
)
from teleop_drake.loops.jit.symbols import (
    NUMPY,
    Apply,
    AsBoolean,
    AsReal,
    AsWhole,
    IsBoolean,
    KindOf,
    Not,
    Number,
    Untraceable,
)

# Functions of single numbers.


def _Operation(name: str, usual: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a function that records an operation if an argument is a Number.

    Args:
        name: The name of the operation in the graph.
        usual: The function for plain numbers.
    """

    def Of(*values: Any) -> Any:
        values = tuple(v.item() if isinstance(v, np.ndarray) else v for v in values)
        return Apply(name, *values) if HasNumbers(values) else usual(*values)

    return Of


def _Better(is_better: Callable[..., Any]) -> Callable[..., Any]:
    """Returns numpy's minimum() or maximum() of two numbers."""
    # The result is nan if a or b is nan: `a != a` holds for nan.
    return lambda a, b: Where(is_better(a, b) | (a != a), a, b)


def _Opposite(a: Any) -> Any:
    if not IsBoolean(a):
        raise Untraceable("~ of a number")
    return Not(a)


def _Scaled(factor: float) -> Callable[..., Any]:
    return lambda a: a * factor


def _Logical(combine: Callable[..., Any]) -> Callable[..., Any]:
    """Returns numpy's logical_and() or logical_or() of two numbers."""
    return lambda a, b: combine(AsBoolean(a), AsBoolean(b))


def _Best(usual: Callable[..., Any], is_better: Callable[..., Any]) -> Any:
    """Returns Python's min() or max(), extended to Numbers."""

    def Call(*values: Any, **keywords: Any) -> Any:
        if not HasNumbers(values):
            return usual(*values, **keywords)
        if keywords:
            raise Untraceable(f"{usual.__name__}() with a key")
        best, *others = values[0] if len(values) == 1 else values
        for value in others:
            best = Where(is_better(value, best), value, best)
        return best

    return Call


def _Float(value: Any = 0.0) -> Any:
    if isinstance(value, np.ndarray):
        value = value.item()
    return AsReal(value) if isinstance(value, Number) else float(value)


def _Whole(value: Any = 0, *base: Any) -> Any:
    if isinstance(value, np.ndarray):
        value = value.item()
    if not isinstance(value, Number):
        return int(value, *base)
    if value.kind is int:
        return value
    if value.kind is bool:
        return AsWhole(value)
    # Python's whole numbers have no -0.0.
    return AsWhole(Apply("trunc", value) + 0.0)


# Functions of arrays.


def _ZerosLike(array: Any) -> Any:
    if any(KindOf(x) is not float for x in Objects(array).flat):
        raise Untraceable("np.zeros_like() of something else than floats")
    return AsNumbers(np.zeros(np.shape(array)))


def _Array(usual: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a function that makes an array into which Numbers can be written."""

    def Call(*arguments: Any, **keywords: Any) -> Any:
        # Python's types, such as float, have replacements in traced code.
        arguments = tuple(map(_UsualType, arguments))
        keywords = {name: _UsualType(value) for name, value in keywords.items()}
        if HasNumbers(arguments):
            return OfNumbers(*arguments, **keywords)
        array = usual(*arguments, **keywords)
        return AsNumbers(array) if array.dtype.kind in "fc" else array

    def OfNumbers(value: Any, dtype: Any = None, **keywords: Any) -> Any:
        is_known = usual in (np.array, np.asarray)
        if not is_known or dtype not in (None, float, np.float64):
            raise Untraceable(f"np.{usual.__name__}() of what depends on numbers")
        array = Unified(usual(value, dtype=object, **keywords).view(Numbers))
        has_floats = all(KindOf(x) is float for x in array.flat)
        return array if dtype is None or has_floats else AsFloats(array)

    return Call


def _UsualType(value: Any) -> Any:
    """Returns Python's type for its replacement, and any other value unchanged."""
    has_hash = callable(value) and type(value).__hash__ is not None
    return _USUAL.get(value, value) if has_hash else value


def _Clip(a: Any, lower: Any, upper: Any) -> Any:
    return np.minimum(np.maximum(AsNumbers(a), lower), upper)


def _SearchSorted(a: Any, x: Any, side: str = "left") -> Any:
    found = Search(a, x, side)
    if found is not None:
        return found
    count: Any = 0.0
    for item in a:
        is_before = item <= x if side == "right" else item < x
        # For numpy, nan is larger than all numbers and equal to nan.
        is_last = x != x if side == "right" else (x != x) & (item == item)
        count = count + Where(is_before | is_last, 1.0, 0.0)
    return count


def _Norm(a: Any) -> Any:
    """Returns the Euclidean norm of a vector, or the Frobenius norm of a matrix."""
    a = AsNumbers(a)
    return (a * a).sum() ** 0.5


# Numpy's dispatch to functions of Numbers.

# Keyword arguments that numpy's own code passes with these values, without effect.
_DEFAULTS = {"where": True, "keepdims": False}


def _CallUfunc(
    ufunc: Any, method: str, *inputs: Any, out: Any = None, **keywords: Any
) -> Any:
    """Calls a ufunc of numpy; the arguments are those of __array_ufunc__()."""
    if method == "reduce":
        result = _Reduced(ufunc, inputs[0], **keywords)
    elif method == "__call__" and ufunc in UFUNCS and not keywords:
        result = Result(UFUNCS[ufunc](*map(Objects, inputs)))
    else:
        raise _IsUnknown(ufunc, keywords)
    if out is None:
        return result
    out[0][...] = result
    return out[0]


def _Reduced(
    ufunc: Any, value: Any, axis: int | None = 0, dtype: Any = None, **keywords: Any
) -> Any:
    """Returns the reduction of an array by a ufunc along an axis."""
    is_logical = ufunc in (np.logical_and, np.logical_or)
    is_known = ufunc in UFUNCS and (is_logical or dtype is None)
    if not is_known or any(x is not _DEFAULTS.get(n, n) for n, x in keywords.items()):
        raise _IsUnknown(ufunc, keywords)
    array = Objects(value)
    reduce = UFUNCS[ufunc].reduce
    if is_logical:
        array = BOOLEAN(array)
    if ufunc is np.add:  # In a sum, True counts 1.
        array = REAL(array)
    if axis is None:
        return Result(reduce(array.ravel()))
    return Result(reduce(array, axis=axis))


def _IsUnknown(ufunc: Any, keywords: dict[str, Any]) -> Untraceable:
    names = ", ".join([*keywords, "..."])
    return Untraceable(f"np.{ufunc.__name__}({names}) is not known")


def _CallFunction(
    function: Any, types: Any, arguments: Sequence[Any], keywords: dict[str, Any]
) -> Any:
    """Calls another function of numpy, with the arguments of __array_function__()."""
    if function not in FUNCTIONS:
        raise Untraceable(f"np.{function.__name__}() is not known")
    return FUNCTIONS[function](*arguments, **keywords)


def _Structural(function: Any) -> Callable[..., Any]:
    """Returns a function of numpy that is called with plain arrays of objects."""

    def Call(*arguments: Any, **keywords: Any) -> Any:
        arguments = tuple(_Plain(value) for value in arguments)
        keywords = {name: _Plain(value) for name, value in keywords.items()}
        return Unified(Result(function(*arguments, **keywords)))

    return Call


def _Plain(value: Any) -> Any:
    if not HasNumbers(value):
        return value
    if isinstance(value, (tuple, list)) and any(np.ndim(item) for item in value):
        return [_Plain(item) for item in value]
    return Objects(value)


NUMPY["ufunc"] = _CallUfunc
NUMPY["function"] = _CallFunction
NUMPY["remainder"] = Remainder

# The tables. First the operations of a graph, by their names in numpy; the values are
# their names in `math` and in the graph.
OPERATIONS = {
    "arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2",
    "sin": "sin", "cos": "cos", "tan": "tan", "sinh": "sinh", "cosh": "cosh",
    "tanh": "tanh", "exp": "exp", "log": "log", "sqrt": "sqrt",
}  # fmt: skip

_ELEMENTWISE: dict[Any, Callable[..., Any]] = {
    **{
        getattr(np, usual): _Operation(name, getattr(np, usual))
        for usual, name in OPERATIONS.items()
    },
    np.floor: _Operation("floor", np.floor),
    np.ceil: _Operation("ceil", np.ceil), np.trunc: _Operation("trunc", np.trunc),
    np.sign: Sign, np.remainder: Remainder,
    np.fmod: _Operation("fmod", np.fmod), np.hypot: _Operation("hypot", np.hypot),
    np.deg2rad: _Scaled(math.pi / 180), np.rad2deg: _Scaled(180 / math.pi),
    np.radians: _Scaled(math.pi / 180), np.degrees: _Scaled(180 / math.pi),
    np.less: operator.lt, np.less_equal: operator.le,
    np.greater: operator.gt, np.greater_equal: operator.ge,
    np.equal: operator.eq, np.not_equal: operator.ne,
    np.logical_and: _Logical(operator.and_), np.logical_or: _Logical(operator.or_),
    np.logical_not: Not,
    np.minimum: _Better(operator.lt), np.maximum: _Better(operator.gt),
    np.invert: _Opposite,
}  # fmt: skip
# On arrays of objects, these ufuncs call Python's operators.
_OF_OPERATORS = (
    np.absolute, np.add, np.bitwise_and, np.bitwise_or, np.divide, np.matmul,
    np.multiply, np.negative, np.positive, np.power, np.square, np.subtract,
)  # fmt: skip
UFUNCS: dict[Any, Any] = {
    **{ufunc: ufunc for ufunc in _OF_OPERATORS},
    **{
        ufunc: np.frompyfunc(function, ufunc.nin, 1)
        for ufunc, function in _ELEMENTWISE.items()
    },
}
"""The functions that compute the ufuncs of numpy on arrays of objects."""

# Functions of numpy that work on arrays of objects.
_STRUCTURAL = (
    np.append, np.block, np.concatenate, np.copy, np.cross, np.diag, np.dot, np.hstack,
    np.ndim, np.outer, np.ravel, np.reshape, np.shape, np.size, np.split, np.stack,
    np.trace, np.transpose, np.vstack,
)  # fmt: skip


def _Method(name: str) -> Callable[..., Any]:
    """Returns a function that calls a method of its first argument, an array."""
    return lambda array, *options, **keywords: getattr(AsNumbers(array), name)(
        *options, **keywords
    )


FUNCTIONS: dict[Any, Callable[..., Any]] = {
    **{function: _Structural(function) for function in _STRUCTURAL},
    np.sum: _Method("sum"), np.any: _Method("any"), np.all: _Method("all"),
    np.max: _Method("max"), np.min: _Method("min"), np.squeeze: _Method("squeeze"),
    np.mean: lambda a: AsNumbers(a).sum() / np.size(a),
    np.isclose: IsClose, np.interp: Interp,
    np.zeros_like: _ZerosLike,
    np.where: Where, np.clip: _Clip, np.searchsorted: _SearchSorted,
    np.linalg.solve: Solve, np.linalg.inv: Inverse, np.linalg.norm: _Norm,
}  # fmt: skip
"""The replacements of other functions of numpy."""


class Replacement:
    """The replacement of a function, which equals it and has its attributes."""

    def __init__(self, function: Any, name: str = ""):
        self._function = function
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        return getattr(self._function, attribute)

    def __eq__(self, other: Any) -> bool:
        return bool(self._function == other)

    def __hash__(self) -> int:
        return hash(self._function)


class OfNumpy(Replacement):
    """A function of numpy that also takes lists of Numbers."""

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """Calls the function."""
        function = self._function
        if not (HasNumbers(arguments) or HasNumbers(keywords)):
            return function(*arguments, **keywords)
        if not isinstance(function, np.ufunc):
            return _CallFunction(function, None, arguments, keywords)
        if "out" in keywords:
            keywords["out"] = (keywords["out"],)
        return _CallUfunc(function, "__call__", *arguments, **keywords)


class Refusing(Replacement):
    """A function that is refused with Numbers."""

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """Calls the function unless an argument contains Numbers."""
        if HasNumbers(arguments) or HasNumbers(keywords):
            raise Untraceable(f"a call of {self._name}()")
        return self._function(*arguments, **keywords)


class Refused(Replacement):
    """A function that is refused in any case."""

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """Refuses the call."""
        raise Untraceable(f"a call of {self._name}()")

    def __getattr__(self, attribute: str) -> Any:
        raise Untraceable(f"a use of {self._name}.{attribute}")


def _IsInstance(value: Any, kinds: Any) -> bool:
    if isinstance(value, Number):
        raise Untraceable("isinstance() of what depends on numbers")
    kinds = kinds if isinstance(kinds, tuple) else (kinds,)
    return isinstance(value, tuple(map(_UsualType, kinds)))


def _Log(value: Any, *base: Any) -> Any:
    if base and HasNumbers((value, *base)):
        raise Untraceable("math.log() with a base")
    return _ELEMENTWISE[np.log](value) if not base else math.log(value, *base)


def _OfPlain(usual: Callable[..., Any], own: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a function of `math`, extended to Numbers by another function."""
    return lambda *values: own(*values) if HasNumbers(values) else usual(*values)


_ARRAYS = (
    np.array, np.asarray, np.empty, np.eye, np.full, np.ones, np.zeros,
)  # fmt: skip

# The replacements of Python's functions that take Numbers.
_OF_PYTHON: dict[Any, Any] = {
    float: _Float,
    int: _Whole,
    min: _Best(min, operator.lt),
    max: _Best(max, operator.gt),
    isinstance: _IsInstance,
}

REPLACED: dict[Any, Any] = {
    **{
        getattr(math, name): _Operation(name, getattr(math, name))
        for name in OPERATIONS.values()
    },
    math.log: _Log,
    math.hypot: _OfPlain(math.hypot, np.hypot),
    math.fmod: _OfPlain(math.fmod, np.fmod),
    math.fabs: _OfPlain(math.fabs, abs), copy.copy: lambda value: value.copy(),
    math.radians: _OfPlain(math.radians, np.deg2rad),
    math.degrees: _OfPlain(math.degrees, np.rad2deg),
    **{function: _Array(function) for function in _ARRAYS},
    **_OF_PYTHON,
    np.float64: _Float,
    np.datetime64: Refused(np.datetime64, "np.datetime64"),
}  # fmt: skip
"""The replacements of functions that numpy does not dispatch to Numbers."""

# Python's functions that are refused with Numbers, and those that are always refused,
# because they have effects or would show that a value from outside has a replacement.
_KNOWS_NO_NUMBERS = ("hasattr", "getattr")
_REFUSED = (
    "breakpoint", "callable", "compile", "dir", "eval", "exec", "globals", "id",
    "input", "locals", "next", "open", "print", "type", "vars",
)  # fmt: skip
BUILTINS: dict[str, Any] = {
    **vars(builtins),
    **{name: Refusing(getattr(builtins, name), name) for name in _KNOWS_NO_NUMBERS},
    **{name: Refused(None, name) for name in _REFUSED},
    **{usual.__name__: own for usual, own in _OF_PYTHON.items()},
}
"""Python's built-in functions, with replacements, for traced code."""

_USUAL = {own: usual for usual, own in _OF_PYTHON.items()}

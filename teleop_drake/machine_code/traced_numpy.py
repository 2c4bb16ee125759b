"""Functions of numpy, math and Python on the Numbers of a graph.

A function of numpy that is not here is refused when it gets Numbers.
"""

import builtins
import math
import operator
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from teleop_drake.machine_code.symbols import (
    FUNCTIONS,
    UFUNCS,
    Apply,
    AsBoolean,
    AsNumbers,
    AsReal,
    CallFunction,
    CallUfunc,
    HasNumbers,
    IsBoolean,
    Not,
    Number,
    Numbers,
    Objects,
    Structural,
    Unified,
    Untraceable,
    Where,
)

# Rounds of rotations by Jacobi's methods: they converge quadratically. With two axes
# one rotation is exact.
_SWEEPS = {1: 0, 2: 1, 3: 5}
_MAX_SWEEPS = 8


# Functions of single numbers.


def _Operation(name: str, usual: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a function that is an operation of the graph, or the usual one."""

    def Of(*values: Any) -> Any:
        values = tuple(v.item() if isinstance(v, np.ndarray) else v for v in values)
        if any(isinstance(value, Number) for value in values):
            return Apply(name, *values)
        return usual(*values)

    return Of


def _Minimum(a: Any, b: Any) -> Any:
    # What is not a number stays so.
    return Where((a < b) | (a != a), a, b)


def _Maximum(a: Any, b: Any) -> Any:
    return Where((a > b) | (a != a), a, b)


def _Clip(a: Any, lower: Any, upper: Any) -> Any:
    a = a if lower is None else _Maximum(a, lower)
    return a if upper is None else _Minimum(a, upper)


def _Sign(a: Any) -> Any:
    return Where(a > 0.0, 1.0, Where(a < 0.0, -1.0, a + 0.0))


def _Log(a: Any, base: Any = None) -> Any:
    return _LOG(a) if base is None else _LOG(a) / _LOG(base)


def _Best(is_better: Callable[[Any, Any], Any], *values: Any) -> Any:
    first, *others = values[0] if len(values) == 1 else values
    for value in others:
        first = Where(is_better(value, first), value, first)
    return first


def _Float(value: Any = 0.0) -> Any:
    if isinstance(value, np.ndarray):
        value = value.item()
    return AsReal(value) if isinstance(value, Number) else float(value)


def _Whole(value: Any = 0, *base: Any) -> Any:
    if isinstance(value, np.ndarray):
        value = value.item()
    is_number = isinstance(value, Number)
    return Apply("trunc", value) + 0.0 if is_number else int(value, *base)


# Functions of arrays.


def _Like(value: Any) -> Callable[..., Any]:
    """Returns a function that fills an array of the shape of another one."""

    def Call(array: Any, fill: Any = value, dtype: Any = None) -> Any:
        if FUNCTIONS.get(dtype, dtype) not in (None, FUNCTIONS[float]) or (
            dtype is None and any(map(IsBoolean, Objects(array).flat))
        ):
            raise Untraceable("an array of something else than numbers")
        result = AsNumbers(np.empty(np.shape(array), object))
        result[...] = fill
        return result

    return Call


def _Array(usual: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a function that makes an array into which Numbers can be written."""

    def Call(*arguments: Any, **keywords: Any) -> Any:
        # The types of Python may have been replaced.
        arguments, keywords = (
            _WithTypes(arguments),
            dict(zip(keywords, _WithTypes(keywords.values()), strict=True)),
        )
        if HasNumbers(arguments):
            is_known = usual in (np.array, np.asarray, np.ascontiguousarray)
            kinds = keywords.pop("dtype", None), *arguments[1:]
            if not is_known or any(x not in (None, float, np.float64) for x in kinds):
                raise Untraceable(f"np.{usual.__name__}() of what depends on numbers")
            array = usual(arguments[0], dtype=object, **keywords)
            return Unified(array.view(Numbers))
        array = usual(*arguments, **keywords)
        return AsNumbers(array) if array.dtype.kind == "f" else array

    return Call


def _WithTypes(values: Any) -> Any:
    """Returns values in which Python's types stand for themselves."""
    return tuple(_USUAL.get(x, x) if callable(x) else x for x in values)


def _Full(shape: Any, fill: Any, dtype: Any = None) -> Any:
    if HasNumbers(fill):
        return _Like(0.0)(np.empty(shape), fill, dtype)
    return _Array(np.full)(shape, fill, dtype=dtype)


def _Interp(x: Any, xp: Any, fp: Any, left: Any = None, right: Any = None) -> Any:
    xp, fp = AsNumbers(xp), AsNumbers(fp)
    result: Any = fp[0] if left is None else left
    for i in range(len(xp) - 1):
        slope = (fp[i + 1] - fp[i]) / (xp[i + 1] - xp[i])
        result = Where(x >= xp[i], slope * (x - xp[i]) + fp[i], result)
    result = Where(x >= xp[-1], fp[-1], result)
    result = result if right is None else Where(x > xp[-1], right, result)
    return Where(x == x, result, x)


def _SearchSorted(a: Any, x: Any, side: str = "left") -> Any:
    count: Any = 0.0
    for item in a:
        count = count + Where(item <= x if side == "right" else item < x, 1.0, 0.0)
    return count


def _Mean(a: Any, *arguments: Any, **keywords: Any) -> Any:
    total = np.sum(AsNumbers(a), *arguments, **keywords)
    return total * (np.size(total) / np.size(a))


def _Round(a: Any, decimals: int = 0) -> Any:
    return np.frompyfunc(round, 2, 1)(Objects(a), decimals)


def _Square(A: Any) -> Any:
    """Returns a copy of a square matrix."""
    A = AsNumbers(np.array(Objects(A)))
    if A.ndim != 2 or len(A) != A.shape[1]:
        raise Untraceable("np.linalg of no square matrix")
    return A


def _Eliminated(A: Any, B: Any) -> Any:
    """Returns a matrix as an upper triangle, B after the same steps, and the sign."""
    A, B, sign = _Square(A), AsNumbers(np.array(Objects(B))), 1.0
    for i in range(len(A)):
        for j in range(i + 1, len(A)):
            is_larger = abs(A[j, i]) > abs(A[i, i])
            sign = Where(is_larger, -sign, sign)
            for M in (A, B):
                upper = Where(is_larger, M[j], M[i])
                M[j], M[i] = Where(is_larger, M[i], M[j]), upper
        for j in range(i + 1, len(A)):
            factor = A[j, i] / Where(A[i, i] == 0.0, 1.0, A[i, i])
            A[j], B[j] = A[j] - factor * A[i], B[j] - factor * B[i]
    return A, B, sign


def _Solve(A: Any, B: Any) -> Any:
    """Returns A^-1 B by Gauss's elimination, with pivots."""
    A, B, _ = _Eliminated(A, B)
    for i in reversed(range(len(A))):
        for j in range(i + 1, len(A)):
            B[i] = B[i] - A[i, j] * B[j]
        B[i] = B[i] * (1.0 / A[i, i])
    return B


def _Determinant(A: Any) -> Any:
    A, _, sign = _Eliminated(A, A)
    return sign * np.prod(np.diag(A))


def _Rotation(off_diagonal: Any, difference: Any) -> tuple[Any, Any]:
    """Returns cosine and sine of the rotation that makes [a, c; c, b] diagonal."""
    is_needed = off_diagonal != 0.0
    zeta = difference / (2.0 * Where(is_needed, off_diagonal, 1.0))
    root = abs(zeta) + (zeta * zeta + 1.0) ** 0.5
    tangent = Where(zeta < 0.0, -1.0, 1.0) / root
    cosine = 1.0 / (tangent * tangent + 1.0) ** 0.5
    return Where(is_needed, cosine, 1.0), Where(is_needed, tangent * cosine, 0.0)


def _Rotate(M: Any, i: int, j: int, cosine: Any, sine: Any) -> None:
    """Turns two columns into each other."""
    first, second = M[:, i].copy(), M[:, j].copy()
    M[:, i] = cosine * first - sine * second
    M[:, j] = sine * first + cosine * second


def _Pairs(n: int) -> list[tuple[int, int]]:
    sweep = [(i, j) for i in range(n) for j in range(i + 1, n)]
    return sweep * _SWEEPS.get(n, _MAX_SWEEPS)


def _Items(a: Any) -> list[Any]:
    if np.ndim(a) != 1:
        raise Untraceable("the order of numbers in a matrix")
    return list(AsNumbers(a))


def _Bubble(
    is_after: Callable[[Any, Any], Any], keys: list[Any], *others: list[Any]
) -> None:
    """Sorts keys, and others as these, in place."""
    for end in range(len(keys) - 1, 0, -1):
        for k in range(end):
            swap = is_after(keys[k], keys[k + 1])
            for items in (keys, *others):
                first, second = items[k], items[k + 1]
                items[k] = Where(swap, second, first)
                items[k + 1] = Where(swap, first, second)


def _Sort(a: Any) -> Any:
    items = _Items(a)
    # What is not a number is last.
    _Bubble(lambda x, y: (x > y) | ((x != x) & (y == y)), items)
    return AsNumbers(items)


def _PlaceOf(is_better: Callable[[Any, Any], Any]) -> Callable[[Any], Any]:
    """Returns a function that returns the index of the best element."""

    def Call(a: Any) -> Any:
        best, *others = _Items(a)
        place: Any = 0
        for i, item in enumerate(others):
            # What is not a number is best.
            change = is_better(item, best) & (best == best)
            change = change | ((item != item) & (best == best))
            place, best = Where(change, i + 1.0, place), Where(change, item, best)
        return place

    return Call


def _Eigh(A: Any) -> Any:
    """Returns eigenvalues and eigenvectors of a symmetric matrix, by Jacobi."""
    A = np.tril(_Square(A))  # As numpy does, it looks at the lower half.
    A = A + np.tril(A, -1).T
    n = len(A)
    V = AsNumbers(np.eye(n))
    for i, j in _Pairs(n):
        cosine, sine = _Rotation(A[i, j], A[j, j] - A[i, i])
        for M in (A, A.T, V):
            _Rotate(M, i, j, cosine, sine)
    values, vectors = [A[i, i] for i in range(n)], [V[:, i] for i in range(n)]
    _Bubble(operator.gt, values, vectors)
    return AsNumbers(values), np.stack(vectors, axis=1)


def _Svd(A: Any) -> Any:
    """Returns U, sigma and V^T of a square matrix, by one-sided Jacobi."""
    U = _Square(A)
    n = len(U)
    V = AsNumbers(np.eye(n))
    for i, j in _Pairs(n):
        a, b = U[:, i], U[:, j]
        cosine, sine = _Rotation((a * b).sum(), (b * b).sum() - (a * a).sum())
        for M in (U, V):
            _Rotate(M, i, j, cosine, sine)
    sigma = [(U[:, i] * U[:, i]).sum() ** 0.5 for i in range(n)]
    both = [np.concatenate((U[:, i], V[:, i])) for i in range(n)]
    _Bubble(operator.lt, sigma, both)
    columns, sigmas = np.stack(both, axis=1), AsNumbers(sigma)
    # No column of U follows from one of zeros.
    is_regular = sigmas > n * np.finfo(float).eps * sigmas[0]
    return columns[:n] / Where(is_regular, sigmas, np.nan), sigmas, columns[n:].T


def _Norm(a: Any, ord: Any = None, axis: Any = None, keepdims: bool = False) -> Any:
    a = AsNumbers(a)
    if ord is None and axis is None:
        a = a.ravel() if not keepdims else a
    elif not isinstance(axis, int) and (a.ndim != 1 or axis is not None):
        raise Untraceable("np.linalg.norm of a matrix")
    axis = -1 if axis is None else axis
    if ord in (1, math.inf):
        combined = abs(a).sum if ord == 1 else abs(a).max
        return combined(axis=axis, keepdims=keepdims)
    if ord not in (None, 2) or (keepdims and a.ndim != 1):
        raise Untraceable(f"np.linalg.norm with ord={ord}")
    return (a * a).sum(axis=axis, keepdims=keepdims) ** 0.5


# The tables. First the operations of a graph, by numpy's names.
_OPERATIONS = {
    "arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2",
} | {
    name: name
    for name in (
        "sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "floor",
        "ceil", "trunc", "rint", "copysign", "fmod",
    )
}  # fmt: skip
_ELEMENTWISE: dict[str, Callable[..., Any]] = {
    usual: _Operation(name, getattr(np, usual)) for usual, name in _OPERATIONS.items()
}
_SQRT, _LOG = _ELEMENTWISE["sqrt"], _ELEMENTWISE["log"]
_SPECIAL: dict[str, Callable[..., Any]] = {
    "hypot": lambda *values: _SQRT(sum((x * x for x in values), 0.0)),
    "isnan": lambda a: a != a,
    "isinf": lambda a: abs(AsReal(a)) == math.inf,
    "isfinite": lambda a: abs(AsReal(a)) < math.inf,
    "radians": lambda a: a * (math.pi / 180),
    "degrees": lambda a: a * (180 / math.pi),
    "fabs": abs,
}
_ELEMENTWISE |= {
    "less": operator.lt, "less_equal": operator.le, "greater": operator.gt,
    "greater_equal": operator.ge, "equal": operator.eq, "not_equal": operator.ne,
    "subtract": operator.sub, "divide": operator.truediv, "power": operator.pow,
    "remainder": operator.mod, "floor_divide": operator.floordiv,
    "bitwise_and": operator.and_, "bitwise_or": operator.or_,
    "bitwise_xor": operator.xor,
    "logical_and": lambda a, b: AsBoolean(a) & AsBoolean(b),
    "logical_or": lambda a, b: AsBoolean(a) | AsBoolean(b),
    "minimum": _Minimum, "maximum": _Maximum,
    "negative": operator.neg, "positive": operator.pos,
    "absolute": abs, "square": lambda a: a * a,
    "reciprocal": lambda a: 1.0 / a, "sign": _Sign, "invert": Not, "logical_not": Not,
    "conjugate": lambda a: a, "deg2rad": _SPECIAL["radians"],
    "rad2deg": _SPECIAL["degrees"], **_SPECIAL,
}  # fmt: skip
UFUNCS |= {
    getattr(np, name): np.frompyfunc(function, getattr(np, name).nin, 1)
    for name, function in _ELEMENTWISE.items()
} | {ufunc: ufunc for ufunc in (np.add, np.multiply, np.matmul, np.vecdot)}
_CLIP = np.frompyfunc(_Clip, 3, 1)

# What does not care about what is in an array.
_STRUCTURAL = (
    "append", "array_split", "argwhere", "atleast_1d", "atleast_2d", "block",
    "broadcast_to", "column_stack", "concatenate", "copy", "cross", "delete", "diag",
    "diagonal", "diff", "dot", "einsum", "expand_dims", "flatnonzero", "flip", "fliplr",
    "flipud", "hstack", "inner", "insert", "kron", "moveaxis", "ndim", "nonzero",
    "outer", "polyval", "ravel", "repeat", "reshape", "roll", "shape", "size", "split",
    "squeeze", "stack", "swapaxes", "tensordot", "tile", "trace", "transpose", "tril",
    "triu", "vdot", "vstack",
)  # fmt: skip
_METHODS = "sum", "prod", "max", "min", "any", "all", "cumsum", "cumprod"


def _Method(name: str) -> Callable[..., Any]:
    return lambda a, *others, **k: getattr(AsNumbers(a), name)(*others, **k)


def _Through(ufunc: Any) -> Callable[..., Any]:
    """Returns a function of arrays that computes elements one by one."""

    def Call(*values: Any, out: Any = None) -> Any:
        result = AsNumbers(ufunc(*map(Objects, values)))
        if out is None:
            return result if result.ndim else result.item()
        out[...] = result
        return out

    return Call


FUNCTIONS |= {
    **{getattr(np, name): Structural(getattr(np, name)) for name in _STRUCTURAL},
    **{getattr(np, name): _Method(name) for name in _METHODS},
    np.zeros_like: _Like(0.0), np.empty_like: _Like(0.0), np.ones_like: _Like(1.0),
    np.full_like: _Like(None), np.where: Where, np.clip: _Through(_CLIP),
    np.round: _Through(_Round), np.sort: _Sort, np.argmax: _PlaceOf(operator.gt),
    np.argmin: _PlaceOf(operator.lt), np.mean: _Mean,
    np.interp: _Interp, np.searchsorted: _SearchSorted,
    np.count_nonzero: lambda a: (AsNumbers(a) != 0.0).sum(),
    np.linalg.solve: _Solve, np.linalg.inv: lambda A: _Solve(A, np.eye(len(A))),
    np.linalg.det: _Determinant, np.linalg.eigh: _Eigh, np.linalg.svd: _Svd,
    np.linalg.norm: _Norm,
}  # fmt: skip


class OfNumpy:
    """A function of numpy, for which a list of Numbers is an array, too."""

    def __init__(self, function: Any):
        self._function = function

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """Calls the function."""
        function = self._function
        if not (HasNumbers(arguments) or HasNumbers(keywords)):
            return function(*arguments, **keywords)
        if not isinstance(function, np.ufunc):
            return CallFunction(function, None, arguments, keywords)
        if "out" in keywords:
            keywords["out"] = (keywords["out"],)
        return CallUfunc(function, "__call__", *arguments, **keywords)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._function, name)


def Refusing(function: Any, name: str, always: bool = False) -> Callable[..., Any]:
    """Returns a function that is the usual one where there are no Numbers."""

    def Call(*arguments: Any, **keywords: Any) -> Any:
        if always or HasNumbers(arguments) or HasNumbers(keywords):
            raise Untraceable(f"a call of {name}()")
        return function(*arguments, **keywords)

    return Call


def _OrElse(
    usual: Callable[..., Any], traced: Callable[..., Any]
) -> Callable[..., Any]:
    """Returns a function that is the usual one where there are no Numbers."""

    def Call(*arguments: Any, **keywords: Any) -> Any:
        function = traced if HasNumbers(arguments) else usual
        return function(*arguments, **keywords)

    return Call


def _IsInstance(value: Any, kinds: Any) -> bool:
    if isinstance(value, Number):
        raise Untraceable("isinstance() of what depends on numbers")
    kinds = kinds if isinstance(kinds, tuple) else (kinds,)
    return isinstance(value, _WithTypes(kinds))


_MATH = {
    name: _Operation(name, getattr(math, name))
    for name in _OPERATIONS.values()
    if name != "rint"
} | {
    **{name: _OrElse(getattr(math, name), _SPECIAL[name]) for name in _SPECIAL},
    # Python's whole numbers have no -0.0.
    "floor": _OrElse(math.floor, lambda a: _ELEMENTWISE["floor"](a) + 0.0),
    "ceil": _OrElse(math.ceil, lambda a: _ELEMENTWISE["ceil"](a) + 0.0),
    "trunc": _OrElse(math.trunc, _Whole),
    "log": _OrElse(math.log, _Log), "pow": _OrElse(math.pow, operator.pow),
}  # fmt: skip

REPLACED: dict[Any, Any] = {
    **{getattr(math, name): function for name, function in _MATH.items()},
    **{
        getattr(np, name): _Array(getattr(np, name))
        for name in (
            "array", "asarray", "ascontiguousarray", "empty", "eye", "identity", "ones",
            "zeros", "linspace", "arange",
        )
    },
    np.full: _Full,
    float: _Float, np.float64: _Float, int: _Whole,
    min: _OrElse(min, partial(_Best, operator.lt)),
    max: _OrElse(max, partial(_Best, operator.gt)),
    isinstance: _IsInstance,
}  # fmt: skip
"""What takes the place of functions that numpy does not let us replace."""

FUNCTIONS |= {
    float: _Float, np.float64: _Float, _Float: _Float, int: _Whole, _Whole: _Whole,
    bool: AsBoolean, np.bool_: AsBoolean,
}  # fmt: skip
BUILTINS: dict[str, Any] = {
    **vars(builtins),
    **{
        name: Refusing(getattr(builtins, name), name)
        for name in (
            "type", "hasattr", "getattr", "id", "hash", "callable", "repr", "str",
            "format", "print", "vars", "dir", "complex", "divmod",
        )
    },
    **{
        name: Refusing(None, name, always=True)
        for name in (
            "compile", "eval", "exec", "globals", "input", "locals",
            "next", "open",
        )
    },
    **{function.__name__: REPLACED[function] for function in (float, int, min, max)},
    "isinstance": _IsInstance,
}  # fmt: skip
"""Python's own functions."""

_USUAL = {
    function: getattr(builtins, name)
    for name, function in BUILTINS.items()
    if function is not getattr(builtins, name)
}

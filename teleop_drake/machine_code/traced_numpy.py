"""What functions of numpy, math and Python do with the Numbers of a graph.

Most functions of numpy work on arrays of Numbers as they are. Here are those that would
ask an array what its numbers are, or hand it to LAPACK.
"""

import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np

from teleop_drake.machine_code.symbols import (
    AsNumbers,
    HasNumbers,
    Number,
    Numbers,
    Untraceable,
    Where,
)

# Rounds of rotations by Jacobi's methods: they converge quadratically. With two axes
# one rotation is exact.
_SWEEPS = {1: 0, 2: 1, 3: 5}
_MAX_SWEEPS = 8


class _Module:
    """A module of which some functions are replaced."""

    def __init__(self, module: ModuleType, functions: dict[str, Any]):
        self._module, self._functions = module, functions

    def __getattr__(self, name: str) -> Any:
        return self._functions.get(name) or getattr(self._module, name)


def _OrElse(
    usual: Callable[..., Any], traced: Callable[..., Any]
) -> Callable[..., Any]:
    """Returns a function that is the usual one where there are no Numbers."""

    def Call(*arguments: Any, **keywords: Any) -> Any:
        if HasNumbers(arguments):
            return traced(*arguments, **keywords)
        return usual(*arguments, **keywords)

    return Call


def _Filled(usual: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a function that makes an array into which Numbers can be written."""

    def Call(*arguments: Any, **keywords: Any) -> Any:
        if HasNumbers(arguments):
            keywords.pop("dtype", None)
        array = usual(*arguments, **keywords)
        return AsNumbers(array) if array.dtype.kind in "fO" else array

    return Call


def _ZerosLike(array: Any, **keywords: Any) -> Any:
    return AsNumbers(np.zeros(np.shape(array)))


def _OnesLike(array: Any, **keywords: Any) -> Any:
    return AsNumbers(np.ones(np.shape(array)))


def _FullLike(array: Any, value: Any, **keywords: Any) -> Any:
    return AsNumbers(np.full(np.shape(array), value, object))


def _Minimum(a: Any, b: Any) -> Any:
    # What is not a number stays so.
    a, b = AsNumbers(a), AsNumbers(b)
    return _Scalar(Where((a < b) | (a != a), a, b))


def _Maximum(a: Any, b: Any) -> Any:
    a, b = AsNumbers(a), AsNumbers(b)
    return _Scalar(Where((a > b) | (a != a), a, b))


def _Clip(a: Any, lower: Any, upper: Any) -> Any:
    return _Minimum(_Maximum(a, lower), upper)


def _Sign(a: Any) -> Any:
    a = AsNumbers(a)
    return _Scalar(Where(a > 0.0, 1.0, Where(a < 0.0, -1.0, 0.0)))


def _IsFinite(a: Any) -> Any:
    return _Scalar(abs(AsNumbers(a)) < math.inf)


def _Scalar(value: Any) -> Any:
    """Returns the element of an array without dimensions."""
    return value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value


def _SearchSorted(a: Any, x: Any, side: str = "left") -> Any:
    count: Any = 0.0
    for item in a:
        count = count + Where(item <= x if side == "right" else item < x, 1.0, 0.0)
    return count


def _Smallest(*values: Any) -> Any:
    values = tuple(values[0]) if len(values) == 1 else values
    result = values[0]
    for value in values[1:]:
        result = Where(value < result, value, result)
    return result


def _Largest(*values: Any) -> Any:
    values = tuple(values[0]) if len(values) == 1 else values
    result = values[0]
    for value in values[1:]:
        result = Where(value > result, value, result)
    return result


def _Whole(value: Any) -> Any:
    return _Float(value).trunc()


def _Float(value: Any) -> Any:
    return value.item() if isinstance(value, np.ndarray) else value


def _Solve(A: Any, B: Any) -> Any:
    """Returns A^-1 B by Gauss and Jordan, with pivots."""
    A = np.array(A, object).view(Numbers)
    is_vector = np.ndim(B) == 1
    B = np.array(B, object).view(Numbers).reshape(len(A), -1)
    n = len(A)
    for i in range(n):
        for j in range(i + 1, n):
            is_larger = abs(A[j, i]) > abs(A[i, i])
            for M in (A, B):
                upper = Where(is_larger, M[j], M[i])
                M[j], M[i] = Where(is_larger, M[i], M[j]), upper
        scale = 1.0 / A[i, i]
        A[i], B[i] = A[i] * scale, B[i] * scale
        for j in range(n):
            if j != i:
                factor = A[j, i]
                A[j], B[j] = A[j] - factor * A[i], B[j] - factor * B[i]
    return B[:, 0] if is_vector else B


def _Inverse(A: Any) -> Any:
    return _Solve(A, np.eye(len(A)))


def _Rotation(off_diagonal: Any, difference: Any) -> tuple[Any, Any]:
    """Returns cosine and sine of the rotation that makes [a, c; c, b] diagonal.

    Args:
        off_diagonal: c.
        difference: b - a.
    """
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


def _Sorted(keys: list[Any], columns: list[Any], is_ascending: bool) -> None:
    """Sorts columns by their keys, in place."""
    for end in range(len(keys) - 1, 0, -1):
        for k in range(end):
            swap = keys[k] > keys[k + 1] if is_ascending else keys[k] < keys[k + 1]
            for items in (keys, columns):
                first, second = items[k], items[k + 1]
                items[k] = Where(swap, second, first)
                items[k + 1] = Where(swap, first, second)


def _Eigh(A: Any) -> Any:
    """Returns eigenvalues and eigenvectors of a symmetric matrix, by Jacobi."""
    n = len(A)
    A, V = np.array(A, object).view(Numbers), AsNumbers(np.eye(n))
    for i, j in _Pairs(n):
        cosine, sine = _Rotation(A[i, j], A[j, j] - A[i, i])
        for M in (A, A.T, V):
            _Rotate(M, i, j, cosine, sine)
    values, vectors = [A[i, i] for i in range(n)], [V[:, i] for i in range(n)]
    _Sorted(values, vectors, True)
    return AsNumbers(values), np.stack(vectors, axis=1).view(Numbers)


def _Svd(A: Any) -> Any:
    """Returns U, sigma and V^T of a regular square matrix, by one-sided Jacobi."""
    n = len(A)
    U, V = np.array(A, object).view(Numbers), AsNumbers(np.eye(n))
    for i, j in _Pairs(n):
        a, b = U[:, i], U[:, j]
        cosine, sine = _Rotation((a * b).sum(), (b * b).sum() - (a * a).sum())
        for M in (U, V):
            _Rotate(M, i, j, cosine, sine)
    sigma = [(U[:, i] * U[:, i]).sum() ** 0.5 for i in range(n)]
    both = [np.concatenate((U[:, i] / sigma[i], V[:, i])) for i in range(n)]
    _Sorted(sigma, both, False)
    columns = np.stack(both, axis=1).view(Numbers)
    return columns[:n], AsNumbers(sigma), columns[n:].T


def _Norm(a: Any) -> Any:
    a = AsNumbers(a)
    if a.ndim != 1:
        raise Untraceable("np.linalg.norm of a matrix")
    return (a * a).sum() ** 0.5


def _Unknown(name: str) -> Callable[..., Any]:
    def Call(*arguments: Any, **keywords: Any) -> Any:
        raise Untraceable(f"{name} of what depends on numbers")

    return Call


def _Elementwise(name: str) -> Callable[..., Any]:
    """Returns one of numpy's functions for arrays with Numbers and others."""
    usual = getattr(np, name)

    def Of(value: Any) -> Any:
        is_number = isinstance(value, Number)
        return getattr(value, name)() if is_number else float(usual(value))

    return lambda a: _Scalar(np.frompyfunc(Of, 1, 1)(AsNumbers(a)))


_LINALG = {
    name: _OrElse(getattr(np.linalg, name), _Unknown(f"np.linalg.{name}"))
    for name in ("cholesky", "det", "eig", "eigvals", "eigvalsh", "lstsq", "pinv", "qr")
} | {
    "inv": _OrElse(np.linalg.inv, _Inverse),
    "solve": _OrElse(np.linalg.solve, _Solve),
    "eigh": _OrElse(np.linalg.eigh, _Eigh),
    "svd": _OrElse(np.linalg.svd, _Svd),
    "norm": _OrElse(np.linalg.norm, _Norm),
}
_ELEMENTWISE = (
    "sqrt", "exp", "log", "sin", "cos", "tan", "arctan", "tanh", "floor", "trunc"
)  # fmt: skip
_NUMPY = {
    name: _OrElse(getattr(np, name), _Elementwise(name)) for name in _ELEMENTWISE
} | {
    name: _Filled(getattr(np, name))
    for name in (
        "array", "asarray", "ascontiguousarray", "column_stack", "concatenate", "diag",
        "empty", "eye", "full", "identity", "ones", "outer", "stack", "zeros",
    )
} | {
    "zeros_like": _OrElse(np.zeros_like, _ZerosLike),
    "empty_like": _OrElse(np.empty_like, _ZerosLike),
    "ones_like": _OrElse(np.ones_like, _OnesLike),
    "full_like": _OrElse(np.full_like, _FullLike),
    "where": _OrElse(np.where, Where),
    "minimum": _OrElse(np.minimum, _Minimum),
    "maximum": _OrElse(np.maximum, _Maximum),
    "clip": _OrElse(np.clip, _Clip),
    "sign": _OrElse(np.sign, _Sign),
    "isfinite": _OrElse(np.isfinite, _IsFinite),
    "searchsorted": _OrElse(np.searchsorted, _SearchSorted),
    "float64": _OrElse(np.float64, _Float),
    "linalg": _Module(np.linalg, _LINALG),
}  # fmt: skip


def _Method(name: str) -> Callable[..., Any]:
    return lambda x: getattr(_Float(x), name)()


_MATH = {
    "sqrt": _OrElse(math.sqrt, _Method("sqrt")),
    "exp": _OrElse(math.exp, _Method("exp")),
    "log": _OrElse(math.log, _Method("log")),
    "sin": _OrElse(math.sin, _Method("sin")),
    "cos": _OrElse(math.cos, _Method("cos")),
    "tan": _OrElse(math.tan, _Method("tan")),
    "atan": _OrElse(math.atan, _Method("arctan")),
    "tanh": _OrElse(math.tanh, _Method("tanh")),
    "floor": _OrElse(math.floor, _Method("floor")),
    "fabs": abs,
    "pow": _OrElse(math.pow, lambda a, b: a**b),
    "isfinite": _OrElse(math.isfinite, _IsFinite),
}

MODULES: dict[Any, Any] = {np: _Module(np, _NUMPY), math: _Module(math, _MATH)}
"""What takes the place of modules; see Trace()."""

FUNCTIONS: dict[str, Callable[..., Any]] = {
    "int": _OrElse(int, _Whole),
    "float": _OrElse(float, _Float),
    "min": _OrElse(min, _Smallest),
    "max": _OrElse(max, _Largest),
}
"""What takes the place of Python's own functions; see Trace()."""

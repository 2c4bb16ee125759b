"""Machine code of pure functions, and of the functions that they call."""

import ast
import functools
import inspect
import textwrap
from collections.abc import Callable, Iterator
from types import FunctionType
from typing import Any

import numpy as np


@functools.cache
def jit(function: FunctionType) -> Callable[..., Any]:
    """Returns a function as numba compiles it when it is called from compiled code.

    Products `a @ b` become loops, and so do inverses: with the few axes of a robot,
    BLAS and LAPACK take several times as long to be called as to calculate. The result
    is the same to within rounding.

    Args:
        function: In the part of Python and numpy that numba knows.
    """
    import numba

    # numba looks for the module of what it has kept; a user's may be a notebook.
    names = dict(function.__globals__) | {"__name__": __name__}
    for name, helper in helpers(function):
        names[name] = jit(helper)
    dispatcher: Callable[..., Any] = numba.njit(_with_loops(function, names))
    return dispatcher


def helpers(function: FunctionType) -> Iterator[tuple[str, FunctionType]]:
    """Yields the functions in Python that a function calls by their global names.

    Args:
        function: The function.
    """
    for name in function.__code__.co_names:
        helper = function.__globals__.get(name)
        if isinstance(helper, FunctionType):
            yield name, helper


def _with_loops(function: FunctionType, names: dict[str, Any]) -> Callable[..., Any]:
    """Returns a copy of a function with other global names and without `@`."""
    try:
        source = textwrap.dedent(inspect.getsource(function))
        tree = ast.parse(source)
    except (OSError, SyntaxError):  # Not from a file: it stays as it is.
        tree = ast.Module([], [])
    if not any(isinstance(node, ast.MatMult) for node in ast.walk(tree)) and (
        "inv" not in function.__code__.co_names
    ):
        return FunctionType(
            function.__code__,
            names,
            function.__name__,
            function.__defaults__,
            function.__closure__,
        )
    names[_PRODUCT], names[_INVERSE] = _product(), _inverse()
    tree = ast.fix_missing_locations(_WithLoops().visit(tree))
    exec(compile(tree, function.__code__.co_filename, "exec"), names)
    copy: Callable[..., Any] = names[function.__name__]
    return copy


_PRODUCT, _INVERSE = "_product", "_inverse"


class _WithLoops(ast.NodeTransformer):
    """Turns `a @ b` and `np.linalg.inv(a)` into calls of loops."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if not isinstance(node.op, ast.MatMult):
            return node
        function = ast.Name(_PRODUCT, ast.Load())
        return ast.copy_location(ast.Call(function, [node.left, node.right], []), node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if ast.unparse(node.func) == "np.linalg.inv":
            node.func = ast.Name(_INVERSE, ast.Load())
        return node


@functools.cache
def _product() -> Callable[..., Any]:
    """Returns the product of arrays of one or two dimensions, for compiled code."""
    from numba.extending import overload

    def product(a: Any, b: Any) -> Any:
        return a @ b

    @overload(product)
    def _compiled_product(a: Any, b: Any) -> Any:
        if (a.ndim, b.ndim) == (1, 1):
            return _dot
        if (a.ndim, b.ndim) == (2, 1):
            return _matrix_times_vector
        if (a.ndim, b.ndim) == (1, 2):
            return _vector_times_matrix
        return _matrix_product

    return product


def _dot(a: Any, b: Any) -> Any:
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


def _matrix_times_vector(a: Any, b: Any) -> Any:
    result = np.empty(a.shape[0])
    for i in range(a.shape[0]):
        total = 0.0
        for j in range(a.shape[1]):
            total += a[i, j] * b[j]
        result[i] = total
    return result


def _vector_times_matrix(a: Any, b: Any) -> Any:
    result = np.zeros(b.shape[1])
    for i in range(b.shape[0]):
        for j in range(b.shape[1]):
            result[j] += a[i] * b[i, j]
    return result


def _matrix_product(a: Any, b: Any) -> Any:
    result = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            for k in range(b.shape[1]):
                result[i, k] += a[i, j] * b[j, k]
    return result


@functools.cache
def _inverse() -> Callable[..., Any]:
    """Returns the inverse of a matrix by Gauss and Jordan, with pivots, as loops."""
    import numba

    def inverse(a: Any) -> Any:
        n = a.shape[0]
        left, right = a.copy(), np.zeros((n, n))
        for i in range(n):
            right[i, i] = 1.0
        for i in range(n):
            pivot = i
            for j in range(i + 1, n):
                if abs(left[j, i]) > abs(left[pivot, i]):
                    pivot = j
            if left[pivot, i] == 0.0:
                raise np.linalg.LinAlgError("Singular matrix")
            for k in range(n):
                left[i, k], left[pivot, k] = left[pivot, k], left[i, k]
                right[i, k], right[pivot, k] = right[pivot, k], right[i, k]
            scale = 1.0 / left[i, i]
            for k in range(n):
                left[i, k] *= scale
                right[i, k] *= scale
            for j in range(n):
                factor = left[j, i]
                if j != i and factor != 0.0:
                    for k in range(n):
                        left[j, k] -= factor * left[i, k]
                        right[j, k] -= factor * right[i, k]
        return right

    dispatcher: Callable[..., Any] = numba.njit(inverse)
    return dispatcher

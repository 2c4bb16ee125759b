"""Machine code for laws, where numba is installed (the extra `fast`)."""

import ast
import functools
import importlib.util
import inspect
from collections.abc import Callable
from types import FunctionType
from typing import Any, TypeVar, cast

import numpy as np

Law = TypeVar("Law", bound=Callable[..., Any])


@functools.cache
def compiled(law: Law) -> Law:
    """Returns a law as machine code if numba is installed, otherwise the law itself.

    The result takes positional arguments, and is the same function of them to within
    rounding. It is compiled at the first call and kept on disk beside the law, or in
    the user's cache where that is not possible. NUMBA_DISABLE_JIT=1 turns it off.

    Args:
        law: A function of numbers, arrays and tuples of these, in the part of Python
            that numba knows. The functions of this package that it calls are in its
            own file: only changes to that file make numba compile it anew (and not
            changes to the products below).
    """
    if any(importlib.util.find_spec(name) is None for name in ("numba", "scipy")):
        return law  # numba's linear algebra is scipy's.
    import numba

    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined, unused-ignore]
        return law
    return cast(Law, numba.njit(cache=True)(_with_compiled_helpers(law)))


def _with_compiled_helpers(law: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a copy of a function that calls compiled functions.

    And whose products `a @ b` are loops: with the few axes of a robot, BLAS takes
    several times as long to be called as to multiply.
    """
    assert isinstance(law, FunctionType)
    names = dict(law.__globals__) | {_PRODUCT: _product()}
    for name in law.__code__.co_names:
        helper = names.get(name)
        if isinstance(helper, FunctionType):
            assert helper.__module__ == law.__module__, helper
            names[name] = compiled(helper)
    tree = _WithProducts().visit(ast.parse(inspect.getsource(law)))
    ast.increment_lineno(
        ast.fix_missing_locations(tree), law.__code__.co_firstlineno - 1
    )
    # By its file and line numba finds what it has on disk.
    exec(compile(tree, law.__code__.co_filename, "exec"), names)
    copy = names[law.__name__]
    return functools.update_wrapper(copy, law)


class _WithProducts(ast.NodeTransformer):
    """Turns `a @ b` into a call."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if not isinstance(node.op, ast.MatMult):
            return node
        function = ast.Name(_PRODUCT, ast.Load())
        return ast.copy_location(ast.Call(function, [node.left, node.right], []), node)


_PRODUCT = "_product"


@functools.cache
def _product() -> Callable[..., Any]:
    """Returns the product of arrays of one or two dimensions, for compiled laws."""
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
        return _matrix_times_matrix

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


def _matrix_times_matrix(a: Any, b: Any) -> Any:
    result = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            for k in range(b.shape[1]):
                result[i, k] += a[i, j] * b[j, k]
    return result

"""Functions of numpy on Numbers, written with others that are known."""

import math
from typing import Any

import numpy as np

from teleop_drake.loops.jit.symbolic_arrays import AsNumbers, Objects, Where
from teleop_drake.loops.jit.symbols import AsWhole, KindOf, Number, Untraceable


def Solve(A: Any, B: Any) -> Any:
    """Returns A^-1 B by Gaussian elimination with partial pivoting."""
    A = Objects(A)
    B = Objects(B)
    n = len(A)
    if A.ndim != 2 or n != A.shape[1]:
        raise Untraceable("np.linalg of a matrix that is not square")
    # The augmented matrix [A B]. A plant without joints has n = 0.
    rows = AsNumbers(np.hstack((A, B.reshape(n, math.prod(B.shape[1:])))))
    for i in range(n):
        # Exchanges move the largest element of column i at or below row i to row i.
        for j in range(i + 1, n):
            is_larger = abs(rows[j, i]) > abs(rows[i, i])
            upper = Where(is_larger, rows[j], rows[i])
            rows[j] = Where(is_larger, rows[i], rows[j])
            rows[i] = upper
        for j in range(i + 1, n):
            pivot = Where(rows[i, i] == 0.0, 1.0, rows[i, i])
            rows[j] = rows[j] - rows[j, i] / pivot * rows[i]
    # Back substitution.
    solution = rows[:, n:]
    for i in reversed(range(n)):
        for j in range(i + 1, n):
            solution[i] = solution[i] - rows[i, j] * solution[j]
        solution[i] = solution[i] * (1.0 / rows[i, i])
    return solution.reshape(B.shape)


def Inverse(A: Any) -> Any:
    """Returns A^-1."""
    return Solve(A, np.eye(len(A)))


def Sign(a: Any) -> Any:
    """Returns 1, -1, 0 or nan."""
    return Where(a > 0.0, 1.0, Where(a < 0.0, -1.0, a * 0.0))


def Remainder(a: Any, b: Any) -> Any:
    """Returns Python's a % b, exactly; its sign is that of b."""
    rest = np.fmod(a, b)
    zero = Where(b < 0.0, -0.0, 0.0)
    other = Where((rest < 0.0) == (b < 0.0), rest, rest + b)
    result = Where(rest == 0.0, zero, other)
    if float in (KindOf(a), KindOf(b)) or not isinstance(result, Number):
        return result
    return AsWhole(result)


def IsClose(a: Any, b: Any, rtol: float = 1e-5, atol: float = 1e-8) -> Any:
    """Returns numpy's isclose() of two numbers or arrays."""
    return (abs(a - b) <= atol + rtol * abs(b)) | (a == b)


def Interp(x: Any, xp: Any, fp: Any) -> Any:
    """Returns the linear interpolation of a table; its ends outside of it."""
    result = fp[0]
    for k in range(len(xp) - 1):
        slope = (fp[k + 1] - fp[k]) / (xp[k + 1] - xp[k])
        result = Where(x >= xp[k], fp[k] + slope * (x - xp[k]), result)
    return Where(x != x, x, Where(x >= xp[-1], fp[-1], result))

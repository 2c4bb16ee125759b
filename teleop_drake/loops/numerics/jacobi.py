"""Singular value decomposition of small matrices by Jacobi's method.

Unlike LAPACK's functions, this one is a fixed sequence of operations. Compiled and in
Python it therefore returns the same vectors with the same signs.
"""

from typing import Any

import numpy as np

from teleop_drake.loops.framework.arrays import Array

# The number of sweeps over all pairs of axes, by the number of axes, and for more axes.
# The sweeps converge quadratically; with two axes a single rotation is exact.
_SWEEPS = {1: 0, 2: 1, 3: 5}
_MAX_SWEEPS = 8

_EPSILON = float(np.finfo(float).eps)

# An off-diagonal element below this share of the difference of the diagonal elements
# needs no rotation. For any other one the square of zeta below does not overflow.
_NEGLIGIBLE = 1e-150


def singular_values(matrix: Array) -> tuple[Array, Array, Array]:
    """Returns U (n, n), the singular values sigma (n) and V^T (n, n) of a matrix.

    The singular values are not sorted. A column of U whose singular value vanishes is
    undetermined, and is returned as nan.

    Args:
        matrix: The matrix U diag(sigma) V^T (n, n).
    """
    # The rotations make the columns of U orthogonal; their lengths are then sigma.
    U = matrix.copy()
    V = np.eye(len(U))
    for i, j in _pairs(len(U)):
        a = U[:, i]
        b = U[:, j]
        cosine, sine = _rotation((a * b).sum(), (b * b).sum() - (a * a).sum())
        for M in (U, V):
            _rotate(M, i, j, cosine, sine)
    sigma = np.sqrt((U * U).sum(axis=0))
    is_regular = sigma > len(U) * _EPSILON * np.linalg.norm(sigma)
    return U / np.where(is_regular, sigma, np.nan), sigma, V.T


def _pairs(n: int) -> list[tuple[int, int]]:
    """Returns the pairs of axes to rotate, in the order of the rotations."""
    sweep = [(i, j) for i in range(n) for j in range(i + 1, n)]
    return sweep * _SWEEPS.get(n, _MAX_SWEEPS)


def _rotation(off_diagonal: float, difference: float) -> tuple[Any, Any]:
    """Returns cosine and sine of the rotation that makes [a, c; c, b] diagonal.

    Args:
        off_diagonal: c.
        difference: b - a.
    """
    # The comparison is false for a nan, which therefore propagates into the result.
    is_small = np.abs(off_diagonal) <= _NEGLIGIBLE * np.abs(difference)
    is_needed = np.logical_not(is_small)
    zeta = difference / (2.0 * np.where(is_needed, off_diagonal, 1.0))
    root = np.abs(zeta) + np.sqrt(zeta * zeta + 1.0)
    tangent = np.where(zeta < 0.0, -1.0, 1.0) / root
    cosine = 1.0 / np.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    return np.where(is_needed, cosine, 1.0), np.where(is_needed, sine, 0.0)


def _rotate(M: Array, i: int, j: int, cosine: Any, sine: Any) -> None:
    """Rotates two columns of a matrix in their plane, in place."""
    first = M[:, i].copy()
    second = M[:, j].copy()
    M[:, i] = cosine * first - sine * second
    M[:, j] = sine * first + cosine * second

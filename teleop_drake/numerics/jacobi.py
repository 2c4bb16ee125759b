"""Singular values of small matrices, by rotations of two axes (Jacobi).

Unlike LAPACK's, the function is a fixed sequence of operations. In machine code it
returns the same vectors with the same signs as in Python.
"""

from typing import Any

import numpy as np

from teleop_drake.arrays import Array

# Rounds of rotations: they converge quadratically. With two axes one rotation is exact.
_SWEEPS = {1: 0, 2: 1, 3: 5}
_MAX_SWEEPS = 8

_EPSILON = float(np.finfo(float).eps)

# As a share of the difference on the diagonal. Its square is no infinite number.
_NEGLIGIBLE = 1e-150


def singular_values(matrix: Array) -> tuple[Array, Array, Array]:
    """Returns U (n, n), singular values (n), in no order, and V^T (n, n) of a matrix.

    A column of U whose singular value vanishes is nan: nothing determines it.

    Args:
        matrix: (n, n) = U diag(sigma) V^T.
    """
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
    """Returns the pairs of axes to turn, one after another."""
    sweep = [(i, j) for i in range(n) for j in range(i + 1, n)]
    return sweep * _SWEEPS.get(n, _MAX_SWEEPS)


def _rotation(off_diagonal: float, difference: float) -> tuple[Any, Any]:
    """Returns cosine and sine of the rotation that makes [a, c; c, b] diagonal.

    Args:
        off_diagonal: c.
        difference: b - a.
    """
    # Less than that turns nothing. What is not a number stays so.
    is_small = np.abs(off_diagonal) <= _NEGLIGIBLE * np.abs(difference)
    is_needed = np.logical_not(is_small)
    zeta = difference / (2.0 * np.where(is_needed, off_diagonal, 1.0))
    root = np.abs(zeta) + np.sqrt(zeta * zeta + 1.0)
    tangent = np.where(zeta < 0.0, -1.0, 1.0) / root
    cosine = 1.0 / np.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    return np.where(is_needed, cosine, 1.0), np.where(is_needed, sine, 0.0)


def _rotate(M: Array, i: int, j: int, cosine: Any, sine: Any) -> None:
    """Turns two columns into each other, in place."""
    first = M[:, i].copy()
    second = M[:, j].copy()
    M[:, i] = cosine * first - sine * second
    M[:, j] = sine * first + cosine * second

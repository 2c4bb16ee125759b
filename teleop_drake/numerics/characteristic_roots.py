"""Characteristic roots of a loop with a delay, by collocation.

    dx/dt = A x + B w,    u = C x + D w,    w(t) = u(t - T)                      (1)

The state of (1) is x and what is under way in the delay, U(theta) = u(t + theta) for
-T <= theta <= 0. It obeys dU/dt = dU/dtheta with U(0) = C x + D U(-T). With U
represented by its values at the Chebyshev points, this becomes an ordinary eigenvalue
problem whose eigenvalues converge to the roots of

    det [ s I - A,  -B e^(-s T) ;  -C,  I - D e^(-s T) ] = 0                     (2)

faster than any power of the number of points, those near the origin first. Each is
then polished by Newton's method on (2).

Source: D. Breda, S. Maset and R. Vermiglio, "Pseudospectral differencing methods for
characteristic roots of delay differential equations", SIAM J. Sci. Comput. 27 (2005),
and, with the delay as a transport equation, "Stability of Linear Delay Differential
Equations", Springer (2015).

The number of points is chosen such that no root near or right of the imaginary axis is
too fast for them, up to 200 points: 300 radians within the delay. Faster ones may be
missed.

Nothing here is shared with delay_margin, so that each can check the other.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.arrays import Array, ComplexArray
from teleop_drake.validation import CheckNumber

# More points than this would take seconds.
_MAX_POINTS = 200

# What so many points do not find lies far to the left.
_ENOUGH_POINTS = 80

# Where the gain from w back to u is less than this, there is no root worth finding.
_LEAST_GAIN = 0.5


def characteristic_roots(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike,
    *,
    delay: float,
    count: int = 8,
) -> ComplexArray:
    """Returns the rightmost roots of (2), by descending real part.

    dx/dt = A0 x + A1 x(t - T) is A = A0, B = A1, C = I, D = 0; negative feedback
    around G has C and D with their signs changed.

    Args:
        A: (n, n).
        B: (n, m).
        C: (m, n).
        D: (m, m). With a spectral radius of 1 or more the rightmost roots lie at
            infinity, and what is returned are some of the others.
        delay: T >= 0 in s.
        count: How many roots, at most; of a complex pair both are returned.

    Returns:
        The roots in 1/s. There are fewer than `count` if the others lie too far to the
        left to be found; the rightmost one is the first to be.

    Raises:
        ValueError: If the delay is negative or not finite.
    """
    A, B, C, D = (np.atleast_2d(np.array(x, dtype=float)) for x in (A, B, C, D))
    m = len(D)
    CheckNumber("delay", delay, "s", minimum=0)
    if delay == 0 or m == 0:
        closed = A + B @ np.linalg.solve(np.eye(m) - D, C)
        return _rightmost(np.linalg.eigvals(closed).astype(complex), count)
    num_points = _num_points(A, B, C, D, delay)
    while True:
        raw = _rightmost(_collocation_roots(A, B, C, D, delay, num_points), count)
        roots = np.array([_polish(s, A, B, C, D, delay) for s in raw])
        # A root of the problem is one that Newton's method hardly has to move. Others
        # are of the discretisation's own making.
        is_found = np.abs(roots - raw) * delay < 1e-3 * (1 + np.abs(raw) * delay)
        if is_found.all() or num_points >= _ENOUGH_POINTS:
            return _rightmost(roots[is_found], count)
        num_points *= 2


def _num_points(A: Array, B: Array, C: Array, D: Array, delay: float) -> int:
    """Returns how many points it takes to resolve all roots near the axis.

    There |C (s I - A)^-1 B + D| >= 1, so their frequency is limited, and a polynomial
    needs more than half a point for each radian that such a root turns in the delay.
    """
    n = len(A)
    high = np.linalg.norm(A, 2) + 2 * np.linalg.norm(B, 2) * np.linalg.norm(C, 2)
    if n == 0 or high == 0:
        return 20
    w = np.geomspace(1e-3 * high, high, 200)
    resolvent = 1j * w[:, None, None] * np.eye(n) - A
    gains = C @ np.linalg.solve(resolvent, np.broadcast_to(B + 0j, (len(w), *B.shape)))
    is_large = np.linalg.norm(gains, ord=2, axis=(1, 2)) >= _LEAST_GAIN
    fastest = float(w[is_large].max(initial=0.0))
    return min(20 + math.ceil(0.6 * fastest * delay), _MAX_POINTS)


def _rightmost(roots: ComplexArray, count: int) -> ComplexArray:
    """Returns the first roots by real part; a pair is not torn apart."""
    roots = roots[np.lexsort((-roots.imag, -np.round(roots.real, 12)))]
    if 0 < count < len(roots) and roots[count - 1].imag > 0:
        count += 1
    return roots[:count]


def _differentiation_matrix(num_points: int) -> Array:
    """Returns d/dx on the Chebyshev points on [-1, 1], descending."""
    k = np.arange(num_points + 1)
    x = np.cos(np.pi * k / num_points)
    weights = np.where((k == 0) | (k == num_points), 2.0, 1.0) * (-1.0) ** k
    difference = x[:, None] - x + np.eye(num_points + 1)
    matrix = np.outer(weights, 1 / weights) / difference
    # Rows sum to zero: constants have no derivative.
    matrix -= np.diag(matrix.sum(axis=1))
    return np.asarray(matrix)


def _collocation_roots(
    A: Array, B: Array, C: Array, D: Array, delay: float, num_points: int
) -> ComplexArray:
    """Returns the eigenvalues of the discretised generator."""
    n, m = len(A), len(D)
    derivative = _differentiation_matrix(num_points)
    # U_0 = U(0) is eliminated; the unknowns are x and U_1 ... U_N, U_N = U(-T).
    derivative = derivative[1:] * (2 / delay)
    last = slice(n + (num_points - 1) * m, n + num_points * m)
    generator = np.zeros((n + num_points * m, n + num_points * m))
    generator[:n, :n] = A
    generator[:n, last] = B
    generator[n:, n:] = np.kron(derivative[:, 1:], np.eye(m))
    boundary = np.kron(derivative[:, :1], np.eye(m))
    generator[n:, :n] += boundary @ C
    generator[n:, last] += boundary @ D
    return np.linalg.eigvals(generator).astype(complex)


def _polish(
    s: complex, A: Array, B: Array, C: Array, D: Array, delay: float
) -> complex:
    """Returns the root of (2) next to s, by Newton's method on log det."""
    n, m = len(A), len(D)
    for _ in range(20):
        with np.errstate(over="ignore"):
            z = np.exp(-s * delay)
        matrix = np.block([[s * np.eye(n) - A, -B * z], [-C, np.eye(m) - D * z]])
        slope = np.block(
            [[np.eye(n), delay * z * B], [np.zeros((m, n)), delay * z * D]]
        )
        if not np.isfinite(matrix).all():
            return complex(np.inf)
        try:
            trace = np.trace(np.linalg.solve(matrix, slope))
        except np.linalg.LinAlgError:  # Exactly on the root.
            return complex(s)
        if trace == 0:
            return complex(np.inf)
        step = 1 / trace  # det/det' = 1/tr(M^-1 M').
        s = s - step
        if abs(step) < 1e-14 * max(abs(s), 1 / delay):
            break
    return complex(s)

"""Characteristic roots of a loop with delays, by collocation.

    dx/dt = A x + B w,    u = C x + D w,    w_i(t) = u_i(t - T_i)                (1)

The state of (1) is x and what is under way in the delays, U_i(theta) = u_i(t + theta)
for -T_i <= theta <= 0. It obeys dU/dt = dU/dtheta with U(0) = C x + D U(-T). With U
represented by its values at the Chebyshev points, this becomes an ordinary eigenvalue
problem whose eigenvalues converge to the roots of

    det [ s I - A,  -B e^(-s T) ;  -C,  I - D e^(-s T) ] = 0                     (2)

where e^(-s T) is a diagonal matrix. They converge

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
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.arrays import Array, ComplexArray
from teleop_drake.validation import CheckNumber

# Points for the slowest loops; more than the second number would take seconds.
_FEWEST_POINTS = 20
_MAX_POINTS = 200

# What so many points do not find lies far to the left.
_ENOUGH_POINTS = 80

# Where the gain from w back to u is less than this, there is no root worth finding.
_LEAST_GAIN = 0.5

# Steps that Newton's method takes at most.
_MAX_NEWTON_STEPS = 20


def characteristic_roots(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike,
    *,
    delay: ArrayLike,
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
        delay: T >= 0 in s, one number, or T_i > 0 of each signal (m).
        count: How many roots, at most; of a complex pair both are returned.

    Returns:
        The roots in 1/s. There are fewer than `count` if the others lie too far to the
        left to be found; the rightmost one is the first to be.

    Raises:
        ValueError: If the delay is negative or not finite.
    """
    A, B, C, D = (np.atleast_2d(np.array(x, dtype=float)) for x in (A, B, C, D))
    num_signals = len(D)
    delays = np.asarray(delay, dtype=float)
    for time in delays.flat:
        CheckNumber("delay", float(time), "s", minimum=0)
    if num_signals == 0 or not delays.any():
        closed = A + B @ np.linalg.solve(np.eye(num_signals) - D, C)
        return _rightmost(np.linalg.eigvals(closed).astype(complex), count)
    loop = _DelayedLoop(A, B, C, D, np.broadcast_to(delays, num_signals))
    num_points = _num_points(loop)
    while True:
        raw = _rightmost(_collocation_roots(loop, num_points), count)
        roots = np.array([_polish(s, loop) for s in raw])
        # A root of the problem is one that Newton's method hardly has to move. Others
        # are of the discretisation's own making.
        longest = delays.max()
        moved = np.abs(roots - raw) * longest
        is_found = moved < 1e-3 * (1 + np.abs(raw) * longest)
        if is_found.all() or num_points >= _ENOUGH_POINTS:
            return _rightmost(roots[is_found], count)
        num_points *= 2


class _DelayedLoop(NamedTuple):
    """The loop dx/dt = A x + B w, u = C x + D w with w_i(t) = u_i(t - T_i).

    Attributes:
        A: (n, n).
        B: (n, m).
        C: (m, n).
        D: (m, m).
        delays: T_i > 0 in s (m).
    """

    A: Array
    B: Array
    C: Array
    D: Array
    delays: Array


def _num_points(loop: _DelayedLoop) -> int:
    """Returns how many points it takes to resolve all roots near the axis.

    There |C (s I - A)^-1 B + D| >= 1, so their frequency is limited, and a polynomial
    needs more than half a point for each radian that such a root turns in the delay.
    """
    A, B, C, _, delays = loop
    n = len(A)
    gain = np.linalg.norm(B, 2) * np.linalg.norm(C, 2)
    highest = np.linalg.norm(A, 2) + 2 * gain
    if n == 0 or highest == 0:
        return _FEWEST_POINTS
    w = np.geomspace(1e-3 * highest, highest, 200)
    # (K, n, n) and (K, n, m), a matrix for each frequency.
    resolvent = 1j * w[:, np.newaxis, np.newaxis] * np.eye(n) - A
    inputs = np.broadcast_to(B.astype(complex), (len(w), *B.shape))
    response = C @ np.linalg.solve(resolvent, inputs)
    is_large = np.linalg.norm(response, ord=2, axis=(1, 2)) >= _LEAST_GAIN
    fastest = float(w[is_large].max(initial=0.0))
    return min(_FEWEST_POINTS + math.ceil(0.6 * fastest * delays.max()), _MAX_POINTS)


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
    return matrix


def _collocation_roots(loop: _DelayedLoop, num_points: int) -> ComplexArray:
    """Returns the eigenvalues of the discretised generator."""
    A, B, C, D, delays = loop
    n = len(A)
    m = len(D)
    # U_0 = U(0) is eliminated; the unknowns are x and U_1 ... U_N, U_N = U(-T).
    derivative = _differentiation_matrix(num_points)[1:]
    # Each signal has a scale of its own.
    per_second = np.diag(2 / delays)
    size = n + num_points * m
    last = slice(size - m, size)
    generator = np.zeros((size, size))
    generator[:n, :n] = A
    generator[:n, last] = B
    generator[n:, n:] = np.kron(derivative[:, 1:], per_second)
    # U_0 = C x + D U_N.
    boundary = np.kron(derivative[:, :1], per_second)
    generator[n:, :n] += boundary @ C
    generator[n:, last] += boundary @ D
    return np.linalg.eigvals(generator).astype(complex)


def _polish(s: complex, loop: _DelayedLoop) -> complex:
    """Returns the root of (2) next to s, by Newton's method on log det.

    Infinity if the method runs away from s.
    """
    A, B, C, D, delays = loop
    identity_n = np.eye(len(A))
    identity_m = np.eye(len(D))
    no_slope = np.zeros_like(C)
    for _ in range(_MAX_NEWTON_STEPS):
        with np.errstate(over="ignore"):
            z = np.exp(-s * delays)
        # M(s), whose determinant is zero at a root, and dM/ds.
        matrix = np.block([[s * identity_n - A, -B * z], [-C, identity_m - D * z]])
        slope = np.block([[identity_n, delays * z * B], [no_slope, delays * z * D]])
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
        if abs(step) < 1e-14 * max(abs(s), 1 / delays.max()):
            break
    return complex(s)

"""Characteristic roots of a loop with delays, by collocation.

    dx/dt = A x + B w,    u = C x + D w,    w_i(t) = u_i(t - T_i)                (1)

The state of (1) is x and the signals in the delays, U_i(theta) = u_i(t + theta) for
-T_i <= theta <= 0. They obey dU/dt = dU/dtheta with U(0) = C x + D U(-T). With U
represented by its values at the Chebyshev points, this becomes an ordinary eigenvalue
problem whose eigenvalues converge to the roots of

    det [ s I - A,  -B e^(-s T) ;  -C,  I - D e^(-s T) ] = 0                     (2)

where e^(-s T) is a diagonal matrix. They converge faster than any power of the number
of points, first near the origin. Each one is then refined by Newton's method on (2).

Source: D. Breda, S. Maset and R. Vermiglio, "Pseudospectral differencing methods for
characteristic roots of delay differential equations", SIAM J. Sci. Comput. 27 (2005),
and, with the delay as a transport equation, "Stability of Linear Delay Differential
Equations", Springer (2015).

The number of points is chosen such that all roots near or right of the imaginary axis
are resolved. It is at most 200, enough for roots that turn by 300 radians within the
delay. Faster roots may be missed.

The method is independent of crossings, so that each can check the other.
"""

import math

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebvander

from teleop_drake.loops.framework.arrays import Array, ComplexArray
from teleop_drake.loops.numerics.state_space import StateSpace

# The smallest number of points, and the largest one. More would take seconds.
_FEWEST_POINTS = 20
_MAX_POINTS = 200

# From this number of points on, roots that are not found lie far to the left.
_ENOUGH_POINTS = 80

# The number of further eigenvalues that are examined if some are no roots.
_NUM_SPARE = 24

# Frequencies at which the gain from w to u, without D, is less than this need not be
# resolved.
_LEAST_GAIN = 0.5

_MAX_NEWTON_STEPS = 20


def characteristic_roots(loop: StateSpace, *, count: int = 8) -> ComplexArray:
    """Returns the rightmost roots of (2), by descending real part.

    For dx/dt = A0 x + A1 x(t - T), let A = A0, B = A1, C = I and D = 0.

    Args:
        loop: The loop (1), whose signals are all delayed, each by T_i > 0 or all by 0.
            If D has a spectral radius of 1 or more, the rightmost roots lie at
            infinity, and some of the other roots are returned.
        count: The largest number of roots; it is exceeded by 1 if a complex pair would
            be separated.

    Returns:
        The roots in 1/s. There are fewer than `count` if the others lie too far to the
        left to be found. The rightmost root is found first.
    """
    longest = max(loop.delays, default=0.0)
    if longest == 0:
        without_delay = loop.opened.closed(np.arange(len(loop.D)))
        return rightmost(np.linalg.eigvals(without_delay.A).astype(complex), count)
    num_points = _num_points(loop)
    while True:
        every = rightmost(_collocation_roots(loop, num_points))
        raw = rightmost(every, count)
        roots = _true_roots(raw, loop)
        if len(roots) == len(raw):
            return roots
        if num_points >= _ENOUGH_POINTS:
            # Artefacts may be right of true roots, if signals pass delays at once.
            spare = every[len(raw) : len(raw) + _NUM_SPARE]
            return rightmost(np.append(roots, _true_roots(spare, loop)), count)
        num_points *= 2


def _true_roots(raw: ComplexArray, loop: StateSpace) -> ComplexArray:
    """Returns the roots next to eigenvalues that approximate one, rightmost first.

    Newton's method hardly moves an approximation of a true root. Other eigenvalues are
    artefacts of the discretisation.
    """
    longest = max(loop.delays)
    roots = np.array([_polish(s, loop) for s in raw], dtype=complex)
    moved = np.abs(roots - raw) * longest
    return rightmost(roots[moved < 1e-3 * (1 + np.abs(raw) * longest)])


def _num_points(loop: StateSpace) -> int:
    """Returns the number of points that resolves all roots near the axis.

    At a root near the axis |C (s I - A)^-1 B + D| >= 1, which limits its frequency. A
    polynomial needs more than half a point for each radian that the root turns within
    the delay.
    """
    gain = np.linalg.norm(loop.B, 2) * np.linalg.norm(loop.C, 2)
    highest = np.linalg.norm(loop.A, 2) + 2 * gain
    if loop.num_states == 0 or highest == 0:
        return _FEWEST_POINTS
    w = np.geomspace(1e-3 * highest, highest, 200)
    response = loop.opened.finite_response(w) - loop.D
    is_large = np.linalg.norm(response, ord=2, axis=(1, 2)) >= _LEAST_GAIN
    turn = w[is_large].max(initial=0.0) * max(loop.delays)
    return min(_FEWEST_POINTS + math.ceil(0.6 * turn), _MAX_POINTS)


def rightmost(roots: ComplexArray, count: int | None = None) -> ComplexArray:
    """Returns roots by descending real part, the upper root of a pair first.

    Args:
        roots: The roots in 1/s.
        count: The largest number of roots; it is exceeded by 1 if a pair would be
            separated. None returns all roots.
    """
    roots = roots[np.lexsort((-roots.imag, -np.round(roots.real, 12)))]
    if count and count < len(roots) and roots[count - 1].imag > 0:
        count += 1
    return roots[:count]


def _differentiation_matrix(num_points: int) -> Array:
    """Returns the matrix of d/dx on the Chebyshev points of [-1, 1], descending.

    It has num_points + 1 rows and columns.
    """
    x = np.cos(np.pi * np.arange(num_points + 1) / num_points)
    # Values are converted to the coefficients of a Chebyshev series, which is
    # differentiated and evaluated.
    of_series = chebvander(x, num_points - 1) @ chebder(np.eye(num_points + 1))
    return of_series @ np.linalg.inv(chebvander(x, num_points))


def _collocation_roots(loop: StateSpace, num_points: int) -> ComplexArray:
    """Returns the eigenvalues of the discretised generator."""
    n = loop.num_states
    m = len(loop.D)
    # U_0 = U(0) is eliminated; the unknowns are x and U_1 ... U_N, U_N = U(-T).
    derivative = _differentiation_matrix(num_points)[1:]
    # The derivative is scaled from [-1, 1] to the delay of each signal.
    per_second = np.diag(2 / np.array(loop.delays))
    # U_0 = C x + D U_N.
    by_boundary = np.kron(derivative[:, :1], per_second)
    by_inside = np.kron(derivative[:, 1:], per_second)
    by_inside[:, -m:] += by_boundary @ loop.D
    between = np.zeros((n, (num_points - 1) * m))
    generator = np.block([[loop.A, between, loop.B], [by_boundary @ loop.C, by_inside]])
    return np.linalg.eigvals(generator).astype(complex)


def _polish(s: complex, loop: StateSpace) -> complex:
    """Returns the root of (2) next to s, by Newton's method on the determinant.

    The result is infinity if the method diverges.
    """
    for _ in range(_MAX_NEWTON_STEPS):
        step = loop.newton_step(s)
        s = s + step
        if not np.isfinite(s):
            return complex(np.inf)
        if abs(step) < 1e-14 * max(abs(s), 1 / max(loop.delays)):
            break
    return complex(s)

"""State-space realisations of transfer functions and of the Pade approximation."""

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import CheckNumber, Refuse


def _coefficients(name: str, values: ArrayLike) -> Array:
    coefficients = np.array(values, dtype=float)
    if coefficients.ndim != 1 or coefficients.size == 0:
        Refuse(name, values, "a vector of coefficients")
    if not np.isfinite(coefficients).all():
        Refuse(name, values, "finite")
    return coefficients


def realize_transfer_function(
    numerator: ArrayLike, denominator: ArrayLike, *, num_axes: int = 1
) -> tuple[Array, Array, Array, Array]:
    """Returns (A, B, C, D) with C (s I - A)^-1 B + D = H(s) on every axis.

    One axis is in controllable canonical form: with the denominator
    s^k + a_{k-1} s^{k-1} + ... + a_0 its states x obey

        dx_j/dt = x_{j+1}  (j < k),   dx_k/dt = -a_0 x_1 - ... - a_{k-1} x_k + u.

    The axes do not couple: A to D are block-diagonal, and the states of one axis are
    adjacent.

    Args:
        numerator: Coefficients of H's numerator, highest power of s first.
        denominator: Coefficients of H's denominator, highest power first; the first
            one is not zero. H must be proper.
        num_axes: Number n of equal, independent axes, >= 1.

    Returns:
        A (n k, n k), B (n k, n), C (n, n k), D (n, n), with k the order of H. D = 0
        if and only if H is strictly proper.

    Raises:
        ValueError: If a coefficient is not finite, the denominator's first one is
            zero, H is improper or num_axes < 1.
    """
    num = np.trim_zeros(_coefficients("numerator", numerator), "f")
    den = _coefficients("denominator", denominator)
    if den[0] == 0.0:
        Refuse("denominator", den, "a vector whose first coefficient is not zero")
    order = den.size - 1
    if num.size > den.size:
        allowed = f"of degree {order} at most, that of the denominator (H(s) is proper)"
        Refuse("numerator", num, allowed)
    CheckNumber("num_axes", num_axes, minimum=1)
    num = np.pad(num, (den.size - num.size, 0)) / den[0]
    den = den / den[0]

    A = np.eye(order, k=1)
    A[-1:] = -den[:0:-1]
    B = np.zeros((order, 1))
    B[-1:] = 1.0
    # The numerator of H - D, the strictly proper part of H.
    C = (num[1:] - num[0] * den[1:])[np.newaxis, ::-1]
    return _on_axes(num_axes, A, B, C, num[:1, np.newaxis])


def _on_axes(num_axes: int, *matrices: Array) -> tuple[Array, Array, Array, Array]:
    """Returns the matrices of equal, independent axes from A, B, C, D of one axis."""
    axes = np.eye(num_axes)
    A, B, C, D = (np.asarray(np.kron(axes, matrix), float) for matrix in matrices)
    return A, B, C, D


def low_frequency_resistance(numerator: ArrayLike, denominator: ArrayLike) -> float:
    """Returns the constant term b of the Laurent series of H(s) at s = 0.

    Near zero frequency H(s) = ... + K / s + b + O(s). For a force over a velocity, K is
    a stiffness and b a resistance, in the unit of H.

    Args:
        numerator: Coefficients of H's numerator, highest power of s first.
        denominator: Coefficients of H's denominator, highest power first.

    Raises:
        ValueError: If a coefficient is not finite or the denominator is zero.
    """
    num = _coefficients("numerator", numerator)[::-1]
    den = _coefficients("denominator", denominator)[::-1]
    if not den.any():
        Refuse("denominator", den, "other than zero")
    num_poles = int(np.flatnonzero(den)[0])
    # Long division in ascending powers: num / den = series_0 + series_1 s + ...
    den = den[num_poles:]
    series, _ = np.polydiv(np.pad(num, (0, num_poles + den.size)), den)
    return float(series[num_poles])


def all_pass_of_delay(
    delay: float, *, order: int, num_axes: int = 1
) -> tuple[Array, Array, Array, Array]:
    """Returns (A, B, C, D) of the diagonal Pade approximation of a delay.

    It is realised as a cascade of second-order sections, whose coefficients are of the
    order of 1/delay. With order 6 its error is 0.11 % of exp(-s delay) up to
    |s| delay = 6.

    Args:
        delay: The delay in s, > 0.
        order: The order k of the approximation, even, >= 2.
        num_axes: Number n of equal, independent axes, >= 1.

    Returns:
        A (n k, n k), B (n k, n), C (n, n k), D (n, n).

    Raises:
        ValueError: If the delay or the order is not allowed.
    """
    CheckNumber("delay", delay, "s", above=0)
    if order < 2 or order % 2:
        Refuse("order", order, "even, and at least 2")
    polynomial = [1.0]
    for k in range(order, 0, -1):
        # The coefficients (2 N - k)!/(k! (N - k)!) of the denominator of order N, each
        # from that of the next higher power of s.
        polynomial.append(polynomial[-1] * (2 * order - k + 1) * k / (order - k + 1))
    poles = np.roots(polynomial) / delay
    # Before the first section the cascade is y = u.
    A = np.zeros((0, 0))
    B = np.zeros((0, 1))
    C = np.zeros((1, 0))
    D = np.eye(1)
    for pole in poles[poles.imag > 0]:
        # y = u - 2 b z, z/u = s/(s^2 + b s + w^2)
        b = -2 * float(pole.real)
        w = abs(pole)
        A_2 = np.array([[0.0, w], [-w, -b]])
        B_2 = np.array([[0.0], [1.0]])
        C_2 = np.array([[0.0, -2 * b]])
        # The input of the section is the output C x + D u of those before it.
        A = np.block([[A, np.zeros((len(A), 2))], [B_2 @ C, A_2]])
        B = np.vstack([B, B_2 @ D])
        C = np.hstack([C, C_2])
    return _on_axes(num_axes, A, B, C, D)

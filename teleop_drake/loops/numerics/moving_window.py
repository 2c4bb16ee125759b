"""Weighted averages over a moving window, by a chain of equal first-order lags.

The window of a signal u has weights w(s), which are 0 outside of its pieces:

    y(t) = integral of w(s) u(t - s) ds,   s from the first break to the last one, T

The states are those of a chain of m lags (the linear chain trick),

    eta_0' = a (u - eta_0),   eta_k' = a (eta_(k-1) - eta_k),   a = RATE / T
    eta(t) = integral of e^(A s) B u(t - s) ds,   s from 0 to infinity

Row vectors C_j with C_j e^(A s) B = w(s) for all s in piece j exist for polynomials,
because e^(a s) w(s) is a power series that m terms represent to rounding. What entered
the chain before the window is subtracted by means of delayed states:

    y(t) = sum of (C_j - C_(j-1)) e^(A s_j) eta(t - s_j)   over all breaks s_j

Unlike the integral of u, the states are bounded, rest if u does, and forget errors.
"""

import math
from collections.abc import Sequence

import numpy as np

from teleop_drake.loops.framework.arrays import Array

# The rate of the lags, 1/T. A lower rate needs fewer lags, and amplifies errors more.
_RATE = 0.5

# The terms of e^(a s) that count: the next one is smaller than the rounding.
_NUM_TERMS = 15

MAX_DEGREE = 3
"""The largest degree of the polynomials. Weights of higher powers amplify errors."""


def num_lags(degree: int) -> int:
    """Returns the number of lags for weights that are polynomials of a degree."""
    return degree + _NUM_TERMS


def lag_chain_rate(window: float, eta: Array, u: Array) -> Array:
    """Returns the rates of the lags' states (m n).

    Args:
        window: T, the end of the window, s.
        eta: The states, lag after lag (m n).
        u: The signal (n).
    """
    before = np.concatenate([u, eta[: -len(u)]])
    rate: Array = _RATE / window * (before - eta)
    return rate


def windowed(weights: Array, eta: Array) -> Array:
    """Returns the weighted average (n).

    Args:
        weights: The weight of each state at each break (b m).
        eta: The states at t - s_j, break after break and lag after lag (b m n).
    """
    average: Array = weights @ eta.reshape(len(weights), -1)
    return average


def window_weights(breaks: Sequence[float], pieces: Sequence[Array]) -> Array:
    """Returns the weights of the states at all breaks, for windowed() (b, m).

    Args:
        breaks: The ends s_j of the pieces in s, ascending, >= 0 (b).
        pieces: The coefficients of each piece's polynomial by ascending powers of
            s - s_j (b - 1 arrays), in 1/s.
    """
    m = num_lags(max(len(piece) for piece in pieces) - 1)
    window = breaks[-1]
    rows = np.zeros((len(breaks) + 1, m))
    for j, piece in enumerate(pieces):
        rows[j + 1] = _row(window, breaks[j], piece, m)
    steps = np.diff(rows, axis=0)
    return np.array(
        [row @ _transition(s / window, m) for s, row in zip(breaks, steps, strict=True)]
    )


def _row(window: float, begin: float, piece: Array, m: int) -> Array:
    """Returns C with C e^(A s) B = the polynomial of a piece (m)."""
    # The coefficients by powers of s / T.
    shift = np.array([1.0])
    powers = np.zeros(len(piece))
    for i, coefficient in enumerate(piece):
        powers[: i + 1] += coefficient * window**i * shift
        shift = np.convolve(shift, [-begin / window, 1.0])
    # Those of its product with e^(a s), and k! / a^(k+1) times each.
    series = [_RATE**k / math.factorial(k) for k in range(m)]
    product = np.convolve(powers, series)[:m]
    scales = [math.factorial(k) / _RATE ** (k + 1) for k in range(m)]
    row: Array = window * product * scales
    return row


def _transition(share: float, m: int) -> Array:
    """Returns e^(A s) for s = share T (m, m)."""
    terms = [(_RATE * share) ** k / math.factorial(k) for k in range(m)]
    matrix = sum(terms[k] * np.eye(m, k=-k) for k in range(m))
    return np.exp(-_RATE * share) * np.asarray(matrix)

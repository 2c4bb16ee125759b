"""The response of a first- or second-order lag to a signal on a uniform grid.

    order 0:  z = u
    order 1:  tau z' = u - z
    order 2:  tau^2 z'' + 2 zeta tau z' = u - z

The signal u is piecewise linear, and for such a signal the response is exact.
"""

import cmath
from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array, ComplexArray


class Lag(NamedTuple):
    """A lag of unit gain.

    Attributes:
        order: 0, 1 or 2.
        time: The time constant tau, s; 1/tau is the natural frequency of order 2.
        damping: The damping ratio zeta; of order 2 only.
    """

    order: int = 0
    time: float = 0.0
    damping: float = 1.0

    @property
    def mean_delay(self) -> float:
        """By how much the lag delays a slow signal, s."""
        return (0.0, self.time, 2 * self.damping * self.time)[self.order]

    @property
    def poles(self) -> ComplexArray:
        """The poles, 1/s (order)."""
        if self.order == 0:
            return np.empty(0, complex)
        if self.order == 1:
            return np.array([-1 / self.time + 0j])
        root = cmath.sqrt(self.damping**2 - 1)
        poles = [-self.damping + root, -self.damping - root]
        return np.array([pole / self.time for pole in poles], complex)


def _filter_of(lag: Lag, step: float) -> tuple[list[float], list[float]]:
    """Returns numerator and denominator in 1/z of a lag of order 1 or 2.

    The signal is a line between two samples. With the state x' = A x + B u, the state
    after a step is Phi x + G u + H (u_next - u), and the three matrices are blocks of
    one matrix exponential.
    """
    from scipy.linalg import expm

    rate = 1 / lag.time
    n = lag.order
    A = np.array([[-rate]])
    if n == 2:
        A = np.array([[0.0, 1.0], [-(rate**2), -2 * lag.damping * rate]])
    blocks = np.zeros((n + 2, n + 2))
    blocks[:n, :n] = A * step
    blocks[n - 1, n] = rate**n * step
    blocks[n, n + 1] = 1.0
    blocks = expm(blocks)
    Phi = blocks[:n, :n]
    G = blocks[:n, n]
    H = blocks[:n, n + 1]
    # The output is the first state x_1. With x - H u as the state, only u is needed.
    B = G + Phi @ H - H
    D = float(H[0])
    trace = float(np.trace(Phi))
    numerator = [D, float(B[0]) - D * trace]
    if n == 1:
        return numerator, [1.0, -trace]
    product = float(np.linalg.det(Phi))
    last = D * product + float(Phi[0] @ B) - trace * float(B[0])
    return [*numerator, last], [1.0, -trace, product]


def lagged(signal: Array, step: float, lag: Lag) -> Array:
    """Returns the lag's response to a signal, from rest at the signal's first value.

    Args:
        signal: Values on a uniform grid (M).
        step: The step of the grid, s.
        lag: The lag.
    """
    if lag.order == 0:
        return signal
    from scipy.signal import lfilter  # The import takes a quarter of a second.

    numerator, denominator = _filter_of(lag, step)
    response = lfilter(numerator, denominator, signal - signal[0])
    return np.asarray(response + signal[0])


def free_motions(times: Array, lag: Lag) -> Array:
    """Returns the lag's motions without a signal (N, order), at times in s (N)."""
    motions = np.exp(np.multiply.outer(times, lag.poles))
    if lag.order == 2 and lag.damping < 1:
        return np.column_stack([motions[:, 0].real, motions[:, 0].imag])
    return motions.real

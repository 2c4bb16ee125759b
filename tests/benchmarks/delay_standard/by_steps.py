"""The method of steps: a solver that shares nothing with the closed forms."""

import math

import numpy as np
from scipy.integrate import solve_ivp


def by_steps(rate, delays, start, end):
    """Returns x(t) of x' = rate(t, x, the x(t - T) of delays), x = start before 0.

    The method of steps with scipy's DOP853, an interval of the shortest delay at a
    time, which must divide the others. It shares nothing with the closed forms.
    """
    length = min(delays)
    pieces: list = []

    def x(t: float) -> np.ndarray:
        if t <= 0:
            return np.array(start, float)
        return pieces[min(int(t / length), len(pieces) - 1)](t)

    for k in range(math.ceil(end / length - 1e-9)):
        span = (k * length, (k + 1) * length)
        solution = solve_ivp(
            lambda t, now: rate(t, now, [x(t - T) for T in delays]),
            span,
            x(span[0]),
            method="DOP853",
            dense_output=True,
            rtol=3e-14,
            atol=1e-14,
        )
        pieces.append(solution.sol)
    return x

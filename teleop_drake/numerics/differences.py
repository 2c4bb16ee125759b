"""Derivatives of a function by differences.

Central differences with four steps, each half of the one before, are extrapolated to
step 0 (Richardson), which is exact for polynomials of degree 8.
"""

from collections.abc import Callable

import numpy as np

from teleop_drake.arrays import Array

_NUM_STEPS = 4


def differentiate(function: Callable[[Array], Array], x0: Array, steps: Array) -> Array:
    """Returns the Jacobian of a function (k, n).

    Args:
        function: From x (n) to its values (k).
        x0: Where (n).
        steps: The longest step of each entry of x, > 0 (n).
    """
    columns = [
        _differentiate_by(function, x0, j, float(longest))
        for j, longest in enumerate(steps)
    ]
    if not columns:
        return np.zeros((len(function(x0)), 0))
    return np.array(columns).T


def _differentiate_by(
    function: Callable[[Array], Array], x0: Array, j: int, longest: float
) -> Array:
    """Returns the derivative by x[j] (k), with steps up to a longest one."""
    row: list[Array] = []
    for i in range(_NUM_STEPS):
        above = row
        high = x0.copy()
        high[j] += longest / 2**i
        low = x0.copy()
        low[j] -= longest / 2**i
        row = [(function(high) - function(low)) / (high[j] - low[j])]
        # Each extrapolation removes the next even power of the step.
        for k in range(i):
            correction = (row[k] - above[k]) / (4 ** (k + 1) - 1)
            row.append(row[k] + correction)
    return row[-1]

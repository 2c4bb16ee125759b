"""Numerical derivatives of a function by finite differences.

Central differences with four steps, each half of the previous one, are extrapolated to
step 0 (Richardson). The result is exact for polynomials of degree 8.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from teleop_drake.loops.framework.arrays import Array

_NUM_STEPS = 4


def differentiate(function: Callable[[Array], Array], x0: Array, steps: Array) -> Array:
    """Returns the Jacobian of a function (k, n).

    Args:
        function: The function of x (n), with k values.
        x0: The point at which it is differentiated (n).
        steps: The longest step of each entry of x, > 0 (n).
    """
    columns = []
    for j, longest in enumerate(steps):
        row = []
        for i in range(_NUM_STEPS):
            high = x0.copy()
            high[j] += longest / 2**i
            low = x0.copy()
            low[j] -= longest / 2**i
            row.append((function(high) - function(low)) / (high[j] - low[j]))
        for k in range(1, _NUM_STEPS):
            # Each extrapolation removes the next even power of the step.
            row = [
                after + (after - before) / (4**k - 1) for before, after in pairwise(row)
            ]
        columns.append(row[0])
    if not columns:
        return np.zeros((len(function(x0)), 0))
    return np.array(columns).T

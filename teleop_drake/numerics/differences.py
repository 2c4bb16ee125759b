"""Derivatives of a function by differences, with an estimate of their error.

Central differences with four steps, each half of the one before, are extrapolated to
step 0 (Richardson), which is exact for polynomials of degree 8. The difference between
the last two extrapolations is the estimate of the error.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NUM_STEPS = 4


def differentiate(
    function: Callable[[Array], Array], x0: Array, steps: Array
) -> tuple[Array, Array, Array]:
    """Returns the Jacobian of a function, its estimated error and its bends.

    A bend is by how much the slopes on both sides of x0 differ, as far as that is not
    due to curvature or within the error of its own extrapolation.

    Args:
        function: From x (n) to its values (k).
        x0: Where (n).
        steps: The longest step of each entry of x, > 0 (n).

    Returns:
        The Jacobian, the estimated error of each of its entries and the bends (k, n).
    """
    middle = function(x0)
    columns, errors, bends = [], [], []
    for j, longest in enumerate(steps):
        table: list[Array] = []
        bend_table: list[Array] = []
        for i in range(_NUM_STEPS):
            step = longest / 2**i
            x = x0.copy()
            x[j] = x0[j] + step
            high, high_value = x[j], function(x)
            x[j] = x0[j] - step
            low_value = function(x)
            row = [(high_value - low_value) / (high - x[j])]
            bend_row = [(high_value - 2 * middle + low_value) / step]
            # Each extrapolation removes the next even power of the step, or, of the
            # bend, the next odd one.
            for k in range(i):
                row.append(row[k] + (row[k] - table[k]) / (4 ** (k + 1) - 1))
                change = (bend_row[k] - bend_table[k]) / (2 * 4**k - 1)
                bend_row.append(bend_row[k] + change)
            previous, table = table, row
            previous_bend, bend_table = bend_table, bend_row
        columns.append(table[-1])
        errors.append(np.abs(table[-1] - previous[-1]))
        bend, doubt = bend_table[-1], np.abs(bend_table[-1] - previous_bend[-1])
        bends.append(np.maximum(np.abs(bend) - 10 * doubt, 0.0))
    if not columns:
        empty = np.zeros((len(middle), 0))
        return empty, empty, empty
    return np.array(columns).T, np.array(errors).T, np.array(bends).T

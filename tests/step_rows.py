"""Steps of unequal lengths, as a run records them."""

import numpy as np

from teleop_drake.loops.numerics.pieces import NODES


def rows(num_steps, end=2.0):
    """Returns the times and the rows of steps of unequal lengths."""
    ends = end * np.linspace(0, 1, num_steps + 1) ** 1.5
    times = ends[:-1, None] + NODES * np.diff(ends)[:, None]
    return times.ravel(), np.arange(times.size).reshape(times.shape)

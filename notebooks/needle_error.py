"""How far a needle is from the path that it is to follow; see laws.needle."""

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.model.laws.needle import NeedlePath
from teleop_drake.model.laws.task_space import rotated

# Gauss's rule with three points in [0, 1], exact for the quartic |e|^2.
_ERROR_POINTS = (0.5 - 0.15**0.5, 0.5, 0.5 + 0.15**0.5)
_ERROR_WEIGHTS = (5 / 18, 8 / 18, 5 / 18)


def path_error(path: NeedlePath, r: Array) -> float:
    """Returns the rms of |e(xi)| over the depths in the tissue in m; 0 outside of it.

    Args:
        r: [p; theta] in m and rad (6).
    """
    a, u = path.inwards, rotated(r[3:], path.needle)
    tip = r[:3] - path.entry
    along = np.sum(u * a)
    x = np.sum(tip * a)
    if x <= 0:
        return 0.0
    square = 0.0
    for share, weight in zip(_ERROR_POINTS, _ERROR_WEIGHTS, strict=True):
        xi = share * x
        e = tip + (xi - x) / along * u - xi * a - xi * xi / 2 * path.bend
        square += weight * np.sum(e * e)
    return float(np.sqrt(square))

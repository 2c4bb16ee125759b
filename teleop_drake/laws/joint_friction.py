"""Coulomb friction of joints, smooth through rest.

    tau = -s (mean + half s),  s = v/sqrt(v^2 + v_s^2),
    mean = (C_+ + C_-)/2,  half = (C_+ - C_-)/2

C_+ and C_- are the friction torques while a joint moves forward and backward. For
|v| >> v_s it is -C_+ or C_-. At rest it is 0 and has the slope -mean/v_s: a joint that
a torque below C pushes creeps at less than v_s or so, and does not stick. Because
|half| <= mean, tau v <= 0: it takes energy and never gives any.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def friction_torque(forward: Array, backward: Array, speed: float, v: Array) -> Array:
    """Returns the friction of joints in N m or N (nv)."""
    s = v / np.sqrt(v * v + speed * speed)
    tau: Array = -s * ((forward + backward) / 2 + (forward - backward) / 2 * s)
    return tau

"""Force and moment between a needle and tissue that holds it on a curved path.

The path enters the tissue at a point along the unit vector a, and bends: at the depth
xi along a it is c(xi) = entry + xi a + xi^2/2 b, with b perpendicular to a. The needle
is a straight line through its tip p along the unit vector u, which turns with the tool:

    needle(xi) = p - s u,    s = (x - xi)/(u . a),    x = a . (p - entry)
    e(xi) = needle(xi) - c(xi)

At every depth the tissue is a spring between path and needle, with the total energy

    V = k/2 integral of |e|^2 over xi from 0 to x.

The wrench on the tissue is the gradient of V plus a drag of the moving needle:

    dF/dxi = k h + d (v - s w x u),    h = e - a (u . e)/(u . a)
    F = k/2 |e(x)|^2 a + integral of dF,    M = integral of -s u x dF

with the tip's velocity v and the tool's angular velocity w. The spring force k h is
normal to the needle; the force that spreads the tissue at the tip acts along a. The
integrands are at most cubic, so that Gauss's rule with two points is exact.
"""

from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.numerics.rigid_body import cross
from teleop_drake.model.laws.task_space import rotated

# Gauss's points on [0, 1]; each has the weight 1/2.
_POINTS = (0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5)


class NeedlePath(NamedTuple):
    """A needle's path in tissue; the symbols are those of the module's equations.

    Attributes:
        entry: The point of the surface at which the path begins, m (3).
        inwards: The direction a at the entry (3).
        bend: The curvature b in 1/m (3).
        needle: The needle's direction u at the robot's posture, where the rotation
            vector of the tool is 0 (3).
        stiffness: The stiffness k per metre of depth in N/m^2.
        drag: The drag d per metre of depth in N s/m^2.
    """

    entry: Array
    inwards: Array
    bend: Array
    needle: Array
    stiffness: float
    drag: float


def needle_wrench(path: NeedlePath, mode: Array, r: Array, v: Array) -> Array:
    """Returns [F; M about the tip] of a needle on tissue in N and N m (6).

    Args:
        path: The path and the tissue.
        mode: Whether the tip is in the tissue, 0 or 1 (1).
        r: [p; theta] in m and rad (6).
        v: [v; w] in m/s and rad/s (6).
    """
    a = path.inwards
    u = rotated(r[3:], path.needle)
    tip = r[:3] - path.entry
    along = np.sum(u * a)
    x = np.sum(tip * a)
    e = tip - x * a - x * x / 2 * path.bend
    F = path.stiffness / 2 * np.sum(e * e) * a
    M = np.zeros(3)
    for share in _POINTS:
        xi = share * x
        arm = (xi - x) / along * u
        e = tip + arm - xi * a - xi * xi / 2 * path.bend
        h = e - np.sum(u * e) / along * a
        dF = path.stiffness * h + path.drag * (v[:3] + cross(v[3:], arm))
        F = F + x / 2 * dF
        M = M + x / 2 * cross(arm, dF)
    return mode[0] * np.append(F, M)

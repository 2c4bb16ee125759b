"""Contact with a wall: the normal force of Hunt and Crossley, and friction."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def hunt_crossley_force(
    stiffness: float, exponent: float, damping: float, depth: float, speed: float
) -> float:
    """Returns the normal force F = k d^p (1 + 3/2 alpha d') on a wall in N, >= 0.

    It is continuous where the wall is touched, as the damping grows with the depth. A
    body that meets a resting wall with a small speed v leaves it with (1 - alpha v) v;
    for any speed, v_out follows from

        g(v) = g(-v_out),   g(v) = b v - ln(1 + b v),   b = 3/2 alpha

    whatever k, p and the body's mass are. Where the formula is negative, that is while
    the body leaves faster than the material expands, there is no force.

    Source: K. H. Hunt and F. R. E. Crossley, "Coefficient of restitution interpreted as
    damping in vibroimpact", J. Applied Mechanics 42 (1975).

    Args:
        stiffness: k in N/m^p, > 0.
        exponent: p, >= 1.
        damping: alpha in s/m, >= 0.
        depth: d in m; in front of the wall it is negative.
        speed: d' in m/s.
    """
    elastic: float = stiffness * max(depth, 0.0) ** exponent
    return max(elastic * (1.0 + 1.5 * damping * speed), 0.0)


def wall_force(
    normal_law: Array, friction_law: Array, plane: Array, p_WT: Array, v_WT: Array
) -> Array:
    """Returns the force of a tool on a wall in N (n).

        F_e = F_n (n + mu v_t / sqrt(v_t . v_t + v_s^2))

    with F_n of hunt_crossley_force() and the velocity v_t along the wall. It is
    Coulomb's friction mu F_n against the motion, which v_s makes smooth: a tool that
    Coulomb's law would hold creeps, at less than v_s for up to 70 % of mu F_n.

    Args:
        normal_law: [k in N/m^p, p, alpha in s/m].
        friction_law: [mu, v_s in m/s]; mu >= 0, v_s > 0.
        plane: A point of the wall in m, and its unit normal into the material (2, n).
        p_WT: Position of the tool in m (n).
        v_WT: Its velocity in m/s (n).
    """
    point, normal = plane[0], plane[1]
    depth, speed = np.sum((p_WT - point) * normal), np.sum(v_WT * normal)
    k, p, alpha = normal_law[0], normal_law[1], normal_law[2]
    F_n = hunt_crossley_force(k, p, alpha, depth, speed)
    v_t = v_WT - speed * normal
    mu, v_s = friction_law[0], friction_law[1]
    F_e: Array = F_n * (normal + mu / np.sqrt(np.sum(v_t * v_t) + v_s * v_s) * v_t)
    return F_e

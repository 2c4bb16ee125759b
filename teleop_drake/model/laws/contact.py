"""Contact with a wall: the Hunt-Crossley force, friction, and viscoelastic tissue.

Viscoelastic tissue is a standard linear solid: a spring k in parallel to a Maxwell
branch, which is a spring k_1 in series with a dashpot k_1 tau:

    F = k d + k_1 (d - z),    dz/dt = (d - z)/tau

with the indentation d and the displacement z of the dashpot. The force after a step to
d is (k + k_1 exp(-t/tau)) d. The surface of the tissue has no mass and does not stick
to the tool. A free surface has F = 0, and therefore the indentation
d_0 = k_1 z/(k + k_1). A tool in front of it feels no force, and d_0 replaces d in the
equation of z.

Below, `solid` is [k in N/m >= 0, k_1 in N/m > 0, tau in s > 0], `creep` is z in m (1),
`plane` is a point of the undeformed surface in m and its unit normal into the material
(2, n), and p_WT is the position of the tool in m (n).

The energy k d^2/2 + k_1 (d - z)^2/2 is never negative and grows by no more than the
tool's power: the tissue is passive.

Source: Y. C. Fung, "Biomechanics: Mechanical Properties of Living Tissues", Springer
(1993), section 2.11.
"""

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.model.laws.task_space import translation


def hunt_crossley_force(
    stiffness: float, exponent: float, damping: float, depth: float, speed: float
) -> float:
    """Returns the normal force F = k d^p (1 + 3/2 alpha d') on a wall in N, >= 0.

    The force is continuous at the surface, because the damping grows with the depth. A
    body that meets a resting wall with a small speed v leaves it with (1 - alpha v) v.
    For any speed, v_out follows from

        g(v) = g(-v_out),   g(v) = b v - ln(1 + b v),   b = 3/2 alpha

    for all k, p and masses of the body. Where the formula is negative, because the body
    leaves faster than the material expands, the force is 0.

    Source: K. H. Hunt and F. R. E. Crossley, "Coefficient of restitution interpreted as
    damping in vibroimpact", J. Applied Mechanics 42 (1975).

    Args:
        stiffness: k in N/m^p, > 0.
        exponent: p, >= 1.
        damping: alpha in s/m, >= 0.
        depth: d in m, negative in front of the wall.
        speed: d' in m/s.
    """
    elastic: float = stiffness * max(depth, 0.0) ** exponent
    return max(elastic * (1.0 + 1.5 * damping * speed), 0.0)


def wall_force(
    normal_law: Array, friction_law: Array, plane: Array, p_WT: Array, v_WT: Array
) -> Array:
    """Returns the force of a tool on a wall in N (n).

        F_e = F_n (n + mu v_t / sqrt(v_t . v_t + v_s^2))

    with F_n of hunt_crossley_force() and the velocity v_t along the wall. The second
    term is Coulomb's friction mu F_n against the motion, smoothed by v_s. A tool that
    Coulomb's law would hold creeps: more slowly than v_s if the force along the wall is
    less than 70 % of mu F_n.

    Args:
        normal_law: [k in N/m^p, p, alpha in s/m].
        friction_law: [mu, v_s in m/s]; mu >= 0, v_s > 0.
        plane: A point of the wall in m, and its unit normal into the material (2, n).
        p_WT: Position of the tool in m (n).
        v_WT: Velocity of the tool in m/s (n).
    """
    point = plane[0]
    normal = plane[1]
    depth = np.sum((p_WT - point) * normal)
    speed = np.sum(v_WT * normal)
    k = normal_law[0]
    p = normal_law[1]
    alpha = normal_law[2]
    F_n = hunt_crossley_force(k, p, alpha, depth, speed)
    v_t = translation(v_WT - speed * normal)
    mu = friction_law[0]
    v_s = friction_law[1]
    return F_n * (normal + mu / np.sqrt(np.sum(v_t * v_t) + v_s * v_s) * v_t)


def indentation(solid: Array, creep: Array, plane: Array, p_WT: Array) -> float:
    """Returns the indentation d in m, under the tool or of the free surface."""
    free: float = solid[1] * creep[0] / (solid[0] + solid[1])
    depth: float = np.sum((p_WT - plane[0]) * plane[1])
    return max(depth, free)


def solid_force(solid: Array, creep: Array, plane: Array, p_WT: Array) -> Array:
    """Returns the force of a tool on the tissue in N (n)."""
    d = indentation(solid, creep, plane, p_WT)
    F_n = solid[0] * d + solid[1] * (d - creep[0])
    return F_n * plane[1]


def creep_rate(solid: Array, creep: Array, plane: Array, p_WT: Array) -> Array:
    """Returns dz/dt in m/s (1)."""
    return np.array([(indentation(solid, creep, plane, p_WT) - creep[0]) / solid[2]])

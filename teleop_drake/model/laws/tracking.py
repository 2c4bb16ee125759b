"""Tracking with an adaptive network, the demonstration of chapter 3.

The robot in task space, with its tool's position r and velocity v,

    M_r dv/dt + h_r = F_c - F_e,    h_r = C_r v + G_r,                           (3.6)

tracks r_d(t). The network W Phi learns the unknown force F_e:

    e   = r - r_d,    s = e' + Lambda e                                  (3.10, 3.11)
    F_c = W Phi + h_r + M_r (r_d'' - Lambda e' - G1 s)                         (3.18)
    dW/dt = beta (-M_r^-T s Phi^T - nu W)                                (3.19, 3.27)

Positions are in m (n), forces in N (n), M_r is in kg (n, n), W in N (n, N), and Phi has
N entries. A vector of weights contains W row by row.

Hats are left out: W is the estimate of W*. Proof of the law, with W~ = W* - W, for
V1 = s^T s/2 + |W~|^2/(2 beta) (3.12), an exact network F_e = W* Phi and nu = 0:

1.  (3.18) in (3.6) leaves  ds/dt = -G1 s - M_r^-1 W~ Phi, hence
    d/dt s^T s/2 = -s^T G1 s - s^T M_r^-1 W~ Phi.
2.  The weights add -<W~, dW/dt>/beta = +s^T M_r^-1 W~ Phi, which cancels.

The result is dV1/dt = -s^T G1 s exactly (3.20). The thesis prints dW/dt with the
opposite sign in (3.19) and (3.27), because of a wrong sign before Phi^T w~ in (3.16).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import CheckNumber, Refuse
from teleop_drake.loops.numerics.rigid_body import calc_dynamics, calc_motion
from teleop_drake.model.laws.gains import LawGains, min_eigenvalue
from teleop_drake.model.laws.task_space import Tool, place_tool, tool_bias


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackingGains(LawGains):
    """The constants of the law; n is the number of task axes.

    Attributes:
        Lambda: Weight of the position error relative to the velocity error in 1/s
            (n, n), its symmetric part positive definite (3.11).
        G1: Damping of s in 1/s (n, n), its symmetric part positive definite (3.18).
        beta: Adaptation rate, >= 0 (3.19).
        nu: Leakage, >= 0 (3.27).

    Raises:
        ValueError: If a gain is not finite, has another size than Lambda or violates a
            condition above.
    """

    G1: Array
    beta: float
    nu: float
    allowed_matrix: ClassVar = "a positive definite {n} x {n} matrix"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("Lambda", "G1"):
            matrix = getattr(self, name)
            if min_eigenvalue(matrix) <= 0:
                Refuse(name, matrix, self.allowed_matrix.format(n=self.num_axes))
        for name in ("beta", "nu"):
            CheckNumber(name, getattr(self, name), minimum=0)


def task_dynamics(tool: Tool, q: Array, qdot: Array) -> Array:
    """Returns the robot's dynamics in task space (2.8 to 2.10).

    From M q'' + bias = J^T F and v = J q' follows M_r dv/dt + h_r = F with
    M_r^-1 = J M^-1 J^T and h_r = M_r (J M^-1 bias - J' q').

    Args:
        tool: The arm and its tool.
        q: Positions of the joints in rad or m (nv).
        qdot: Velocities of the joints in rad/s or m/s (nv).

    Returns:
        [M_r row by row in kg; h_r = C_r v + G_r in N] (n n + n).

    Raises:
        numpy.linalg.LinAlgError: If the pose is exactly singular.
    """
    motion = calc_motion(tool.tree, q, qdot)
    M, bias = calc_dynamics(tool.tree, motion, qdot)
    _, _, J = place_tool(tool, motion)
    J = J[: tool.num_axes]
    # One inverse serves M^-1 J^T and M^-1 bias.
    M_inv = np.linalg.inv(M)
    M_r = np.linalg.inv(J @ (M_inv @ J.T))
    h_r = M_r @ (J @ (M_inv @ bias) - tool_bias(tool, motion))
    return np.concatenate((M_r.ravel(), h_r))


def tracking_error(
    gains: TrackingGains, r: Array, v: Array, r_d: Array, v_d: Array
) -> Array:
    """Returns s = (v - v_d) + Lambda (r - r_d) in m/s (n) (3.11)."""
    return v - v_d + gains.Lambda @ (r - r_d)


def tracking_force(
    gains: TrackingGains,
    dynamics: Array,
    weights: Array,
    Phi: Array,
    s: Array,
    v: Array,
    v_d: Array,
    a_d: Array,
) -> Array:
    """Returns the control force F_c in N (n) (3.18).

    Args:
        gains: The law's constants.
        dynamics: The result of task_dynamics().
        weights: W in N, row by row (n N).
        Phi: Basis functions (N).
        s: Tracking error in m/s (n).
        v: Velocity of the tool in m/s (n).
        v_d: Desired velocity in m/s (n).
        a_d: Desired acceleration in m/s^2 (n).
    """
    n = s.size
    M_r = dynamics[: n * n].reshape(n, n)
    h_r = dynamics[n * n :]
    a = a_d - gains.Lambda @ (v - v_d) - gains.G1 @ s
    return disturbance_estimate(weights, Phi) + h_r + M_r @ a


def weights_rate(
    gains: TrackingGains, dynamics: Array, weights: Array, Phi: Array, s: Array
) -> Array:
    """Returns dW/dt in N/s, row by row (3.27 with its sign corrected)."""
    n = s.size
    M_r = dynamics[: n * n].reshape(n, n)
    W = weights.reshape(n, Phi.size)
    g = np.linalg.inv(M_r.T) @ s
    return np.ravel(-gains.beta * (np.outer(g, Phi) + gains.nu * W))


def disturbance_estimate(weights: Array, Phi: Array) -> Array:
    """Returns the estimate W Phi of F_e in N (n)."""
    return weights.reshape(-1, Phi.size) @ Phi


def linear_disturbance(K: Array, r: Array) -> Array:
    """Returns F_e = K r in N (n) (3.7)."""
    return K @ r


def coupled_disturbance(K: Array, r: Array, v: Array) -> Array:
    """Returns F_e = K [x + x' z + 2 z' x + z^2, z + z' x + 2 z x' + x^2] (3.8).

    The factors 1 and 2 have the units that give each product with K in N/m the unit N.

    Args:
        K: Stiffness in N/m (2, 2).
        r: Position [x, z] of the tool in m (2).
        v: Velocity [x', z'] of the tool in m/s (2).
    """
    (x, z) = r
    (x_dot, z_dot) = v
    terms = np.array(
        [
            x + x_dot * z + 2 * z_dot * x + z * z,
            z + z_dot * x + 2 * z * x_dot + x * x,
        ]
    )
    return K @ terms

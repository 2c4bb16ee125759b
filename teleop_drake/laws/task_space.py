"""An arm seen from its tool, (2.6) to (2.13), and the joints that the task leaves free.

The task axes are the first n axes of the world, J the first n rows of Drake's
translational Jacobian Jv_v_WT, and tau_e what the environment's reaction -F_e at the
tool does to the joints:

    v_WT = J qdot,    tau = J^T F_c  (2.11),    tau_e = -J^T F_e  (2.6).

With n = 6 the tool turns as well. Its velocity is the twist [v_WT; w_WT], a force the
wrench [F; moment about T], both in the axes of the world, and J = [Jv_v_WT; Jw_WT]. Its
position is r = [p_WT; theta] with the rotation vector theta of R_WT R_WP^T, P being the
tool as it is turned at the robot's posture. That is one to one for |theta| < pi. Then
dr/dt is not the velocity; position_rate() has it. Where numbers of a twist make one
length, as a speed, 1 rad counts as 1 m.

The robot's state is x = [q; qdot]. Each function returns one vector, a port's value.

Control of the joints that an arm's task leaves free.

The task takes v = J_v(q) dq/dt (n). The law chooses the joint accelerations

    a = w^2 (q_0 - q) - 2 zeta w dq/dt

that would bring the posture q_0 back, and takes out of them what moves the rows J that
others rule or that have a goal y of their own:

    tau = M a + J^T Lambda (y - J a),    Lambda = (J M^-1 J^T)^-1.

Then J M^-1 tau = y: without friction and bias the rows move as y says, whatever a is.
The laws have q and q_0 in rad or m, dq/dt as v (nv), the mass matrix M (nv, nv),
and rotations (3, 3); tau is in N m or N.

* posture:      J = J_v, y = 0. That is tau = (1 - J_v^T Jbar^T) M a with the
  dynamically consistent inverse Jbar = M^-1 J_v^T Lambda: a torque in the null space
  of the task, which does not accelerate the tool (O. Khatib, "A unified approach for
  motion and force control of robot manipulators: the operational space formulation",
  IEEE J. Robotics and Automation 3, 1987, p. 43).
* orientation:  J = [J_v; J_w], y = [0; -w^2 e - 2 zeta w omega], with the tool's
  angular velocity omega = J_w dq/dt and e = 1/2 sum r_0k x r_k over the columns of its
  rotations R_0 and R, which is sin(angle) times the axis from R_0 to R (J. Luh, M.
  Walker and R. Paul, "Resolved-acceleration control of mechanical manipulators", IEEE
  Trans. Automatic Control 25, 1980, p. 468). Joints that are still free hold q_0.

Lambda is damped near singular poses (Y. Nakamura and H. Hanafusa, "Inverse kinematic
solutions with singularity robustness for robot manipulator control", ASME J. Dynamic
Systems, Measurement, and Control 108, 1986, p. 163). With A = J M^-1 J^T, scaled to
ones on its diagonal, and 0 <= det A <= 1 as the measure of how far from one a pose is,

    A + damping max(0, 1 - det A/near)^2 1

takes the place of A. Poses with det A >= `near` are not concerned.
"""

from typing import NamedTuple

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.numerics.rigid_body import (
    Motion,
    RigidBodyTree,
    calc_bias_acceleration,
    calc_dynamics,
    calc_jacobian,
    calc_motion,
)

MAX_ROTATION = 3.0
"""Longest rotation vector in rad; at pi it jumps."""

# Added to A in any case, so that it can be inverted also where a row of J is zero.
_FLOOR = 1e-13

# Added to squares of which a root is a divisor: no change in what is not 0.
_TINY = 1e-300

# The limit where a derivative divides by the fourth power: no change of dr/dt.
_SMALL = 1e-16


class Tool(NamedTuple):
    """The tool of an arm, and the axes along which the task moves it.

    Attributes:
        tree: The links of the arm.
        link: Index of the link with the tool.
        pose: [R, p] of the tool in the link's frame (3, 4), m.
        num_axes: Number n of task axes.
    """

    tree: RigidBodyTree
    link: int
    pose: Array
    num_axes: int


def place_tool(tool: Tool, motion: Motion) -> tuple[Array, Array, Array]:
    """Returns R_WT (3, 3), p_WT in m (3) and the Jacobian of [v_WT; w_WT] (6, nv)."""
    R = motion.R[tool.link + 1] @ tool.pose[:, :3]
    p, J = calc_jacobian(tool.tree, motion, tool.link, tool.pose[:, 3])
    return R, p, np.concatenate((J[3:], J[:3]))


def tool_bias(tool: Tool, motion: Motion) -> Array:
    """Returns dv/dt as long as no joint accelerates, dJ/dt qdot, in m/s^2 (n)."""
    a = calc_bias_acceleration(motion, tool.link, tool.pose[:, 3])
    return np.append(a[3:], a[:3])[: tool.num_axes]


def tool_kinematics(tool: Tool, R_WP: Array, x: Array) -> Array:
    """Returns [r; v; J row by row], r = p_WT and v = v_WT for n < 6 (2n + n nv).

    Args:
        R_WP: Rotation at which theta is 0 (3, 3); without effect for n < 6.
    """
    n = tool.num_axes
    q, qdot = np.split(x, 2)
    R, p, J = place_tool(tool, calc_motion(tool.tree, q, qdot))
    r = p[:n]
    if n == 6:
        r = np.append(p, rotation_vector(R @ R_WP.T))
    J = J[:n]
    return np.concatenate((r, (J * qdot).sum(axis=1), J.ravel()))


def tool_acceleration(tool: Tool, x: Array, qddot: Array) -> Array:
    """Returns dv/dt in m/s^2 and rad/s^2 (n), with qddot in rad/s^2 or m/s^2."""
    motion = calc_motion(tool.tree, *np.split(x, 2))
    _, _, J = place_tool(tool, motion)
    return tool_bias(tool, motion) + (J[: tool.num_axes] * qddot).sum(axis=1)


def gravity_torque(tree: RigidBodyTree, x: Array) -> Array:
    """Returns the torque that carries the weight of an arm, N m or N (nv)."""
    q, qdot = np.split(x, 2)
    rest = 0 * qdot
    return calc_dynamics(tree, calc_motion(tree, q, rest), rest)[1]


def rotation_vector(R: Array) -> Array:
    """Returns the axis of a rotation times its angle, 0 to pi, in rad (3)."""
    sine = orientation_error(np.eye(3), R)
    length = np.sqrt(np.sum(sine * sine) + _TINY)
    # Not arccos, which is not smooth at no rotation.
    angle = np.arctan2(length, (np.trace(R) - 1) / 2)
    return angle / length * sine


def rotated(theta: Array, u: Array) -> Array:
    """Returns a vector that is turned by a rotation vector in rad (3)."""
    angle = np.sqrt(np.sum(theta * theta) + _TINY)
    turn = np.cross(theta, u)
    bow = np.sin(angle / 2) / angle
    return u + np.sin(angle) / angle * turn + 2 * bow * bow * np.cross(theta, turn)


def position_rate(r: Array, v: Array) -> Array:
    """Returns dr/dt of a tool's position (n), which is v but for a rotation.

        dtheta/dt = w - theta x w/2 + (1 - c)/|theta|^2 theta x (theta x w)

    with c = |theta|/2 cot(|theta|/2), the inverse of the left Jacobian of SO(3).

    Args:
        r: Position in m and rad (n).
        v: Velocity in m/s and rad/s (n).
    """
    if r.size < 6:
        return v
    half = np.sqrt(np.sum(r[3:] * r[3:]) + _SMALL) / 2
    share = (1 - half * np.cos(half) / np.sin(half)) / (4 * half * half)
    turn = np.cross(r[3:], v[3:])
    return np.append(v[:3], v[3:] - turn / 2 + share * np.cross(r[3:], turn))


def displacement(r: Array, r_0: Array) -> Array:
    """Returns how far a position is from another one (n), r - r_0 but for a rotation.

    That is the rotation vector of R R_0^T. K times it is the moment of a spring, with
    an energy, if K is the same about all axes: its power is that of w - w_0 then.

    Args:
        r, r_0: Positions in m and rad (n), turned by less than pi from one another.
    """
    if r.size < 6:
        return r - r_0
    R = np.stack([rotated(r[3:], rotated(-r_0[3:], e)) for e in np.eye(3)]).T
    return np.append(r[:3] - r_0[:3], rotation_vector(R))


def translation(x: Array) -> Array:
    """Returns a vector of the task space without what belongs to a rotation (n)."""
    return np.append(x[:3], 0 * x[3:])


def joint_torques(F_c: Array, F_e: Array, kinematics: Array) -> Array:
    """Returns [tau; tau_e], (2.11) and (2.6), in N m or N (2 nv).

    Forces are wrenches for n = 6.
    """
    J = kinematics[2 * F_c.size :].reshape(F_c.size, -1)
    # Not F @ J: BLAS adds in another order than machine code, and error control turns
    # a difference in the last digit into other steps.
    tau = (F_c[:, np.newaxis] * J).sum(axis=0)
    tau_e = -(F_e[:, np.newaxis] * J).sum(axis=0)
    return np.concatenate((tau, tau_e))


class PostureGains(NamedTuple):
    """How the posture is held.

    Attributes:
        frequency: w in rad/s.
        damping_ratio: zeta.
        near: det A below which a pose counts as nearly singular.
        damping: What is added to A at a singular pose.
    """

    frequency: float
    damping_ratio: float
    near: float
    damping: float


def hold_torque(
    tool: Tool, gains: PostureGains, held: tuple[Array, ...], x: Array
) -> Array:
    """Returns the torque that holds what the task leaves free, in N m or N (nv).

    Args:
        held: q_0, to hold the posture; or q_0 and R_0, to hold the orientation.
    """
    q, qdot = np.split(x, 2)
    motion = calc_motion(tool.tree, q, qdot)
    M, _ = calc_dynamics(tool.tree, motion, qdot)
    R, _, J = place_tool(tool, motion)
    J_v = J[: tool.num_axes]
    y = np.zeros(tool.num_axes)
    if len(held) == 1:
        return held_torque(gains, M, J_v, y, held[0], q, qdot)
    q_0, R_0 = held
    turn = orientation_goal(gains, R_0, R, J[3:] @ qdot)
    rows = np.concatenate((J_v, J[3:]))
    return held_torque(gains, M, rows, np.append(y, turn), q_0, q, qdot)


def orientation_goal(gains: PostureGains, R_0: Array, R: Array, omega: Array) -> Array:
    """Returns the angular acceleration that turns the tool back, in rad/s^2 (3)."""
    w = gains.frequency
    error = orientation_error(R_0, R)
    return -w * w * error - 2 * gains.damping_ratio * w * omega


def orientation_error(R_0: Array, R: Array) -> Array:
    """Returns sin(angle) times the axis of the turn from R_0 to R (3)."""
    return np.cross(R_0.T, R.T).sum(axis=0) / 2


def held_torque(
    gains: PostureGains, M: Array, J: Array, y: Array, q_0: Array, q: Array, v: Array
) -> Array:
    """Returns M a + J^T Lambda (y - J a), in N m or N (nv)."""
    w = gains.frequency
    zeta = gains.damping_ratio
    a = w * w * (q_0 - q) - 2 * zeta * w * v
    A = J @ np.linalg.solve(M, J.T)
    force = _solve_damped(A, y - J @ a, gains.near, gains.damping)
    return M @ a + J.T @ force


def _solve_damped(A: Array, b: Array, near: float, damping: float) -> Array:
    """Returns A^-1 b for a symmetric A, damped where it is nearly singular."""
    scale = np.sqrt(np.diag(A) + 1e-30)
    C = A / np.outer(scale, scale) + _FLOOR * np.eye(len(b))
    determinant = 1.0
    for pivot in _pivots(C):
        determinant *= pivot
    share = max(0.0, 1 - determinant / near)
    C = C + damping * share * share * np.eye(len(b))
    return np.asarray(np.linalg.solve(C, b / scale) / scale)


def _pivots(A: Array) -> list[float]:
    """Returns the squares of the diagonal of L in A = L L^T."""
    pivots = []
    while len(A) > 0:
        # What rounding takes below zero is next to nothing.
        pivots.append(max(A[0, 0], 1e-18))
        A = A[1:, 1:] - np.outer(A[1:, 0], A[0, 1:]) / pivots[-1]
    return pivots

"""An arm in task space, (2.6) to (2.13), and control of its redundant joints.

The task axes are the first n axes of the world, J is the first n rows of Drake's
translational Jacobian Jv_v_WT, and tau_e are the joint torques of the environment's
reaction -F_e at the tool:

    v_WT = J qdot,    tau = J^T F_c  (2.11),    tau_e = -J^T F_e  (2.6).

With n = 6 the task includes the tool's rotation. The tool's velocity is the twist
[v_WT; w_WT], a force is the wrench [F; moment about T], both in the axes of the world,
and J = [Jv_v_WT; Jw_WT]. The tool's position is r = [p_WT; theta] with the rotation
vector theta of R_WT R_WP^T, where P is the tool's frame at the robot's posture. This is
one to one for |theta| < pi. The rate dr/dt is then not the velocity; position_rate()
returns it. Where a norm combines metres and radians, 1 rad counts as 1 m.

The robot's state is x = [q; qdot]. A function that a block uses returns one vector, the
value of a port.

Control of the joint motion that the task leaves free.

The task determines v = J_v(q) dq/dt (n). The law chooses the joint accelerations

    a = w^2 (q_0 - q) - 2 zeta w dq/dt

that would return the arm to the posture q_0. It then replaces their effect on the
controlled rows J, which have the desired accelerations y:

    tau = M a + J^T Lambda (y - J a),    Lambda = (J M^-1 J^T)^-1.

Then J M^-1 tau = y: without friction and bias the rows accelerate by y for every a.
The laws have q and q_0 in rad or m (nv), dq/dt as v (nv), the mass matrix M (nv, nv)
and rotations (3, 3); tau is in N m or N (nv).

* posture:      J = J_v, y = 0. This is tau = (1 - J_v^T Jbar^T) M a with the
  dynamically consistent inverse Jbar = M^-1 J_v^T Lambda: a torque in the null space
  of the task, which does not accelerate the tool (O. Khatib, "A unified approach for
  motion and force control of robot manipulators: the operational space formulation",
  IEEE J. Robotics and Automation 3, 1987, p. 43).
* orientation:  J = [J_v; J_w], y = [0; -w^2 e - 2 zeta w omega], with the tool's
  angular velocity omega = J_w dq/dt and the orientation error e, half the sum of
  r_0k x r_k over the columns of the desired and actual rotations R_0 and R. It is
  sin(angle) times the axis of the rotation from R_0 to R (J. Luh, M. Walker and R.
  Paul, "Resolved-acceleration control of mechanical manipulators", IEEE Trans.
  Automatic Control 25, 1980, p. 468). The remaining free motion holds q_0.

Lambda is damped near singular poses (Y. Nakamura and H. Hanafusa, "Inverse kinematic
solutions with singularity robustness for robot manipulator control", ASME J. Dynamic
Systems, Measurement, and Control 108, 1986, p. 163). A = J M^-1 J^T is scaled to ones
on its diagonal. Its determinant, 0 <= det A <= 1, measures the distance of a pose from
singular ones, and A is replaced by

    A + damping max(0, 1 - det A/near)^2 I

with the identity matrix I. Poses with det A >= `near` are not affected.
"""

from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.numerics.rigid_body import (
    Motion,
    RigidBodyTree,
    calc_bias_acceleration,
    calc_dynamics,
    calc_jacobian,
    calc_motion,
    cross,
)

MAX_ROTATION = 3.0
"""The longest allowed rotation vector in rad. At pi a rotation vector jumps."""

# Always added to the diagonal of A, so that A is invertible even if a row of J is zero.
_FLOOR = 1e-13

# Added to a square whose root is a divisor. It avoids a division by 0 and does not
# change other values.
_TINY = 1e-300

# Added to a square by which the derivative of dr/dt is divided twice. It does not
# change dr/dt.
_SMALL = 1e-16


class Tool(NamedTuple):
    """The tool of an arm, and the number of task axes.

    Attributes:
        tree: The links of the arm.
        link: Index of the link that carries the tool.
        pose: Pose [R, p] of the tool in the link's frame (3, 4), m.
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
    """Returns dJ/dt qdot, the tool's acceleration for qddot = 0, m/s^2, rad/s^2 (n)."""
    a = calc_bias_acceleration(motion, tool.link, tool.pose[:, 3])
    return np.append(a[3:], a[:3])[: tool.num_axes]


def tool_kinematics(tool: Tool, R_WP: Array, x: Array) -> Array:
    """Returns [r; v; J row by row] (2n + n nv); r = p_WT and v = v_WT for n < 6.

    Args:
        tool: The arm and its tool.
        R_WP: Rotation of the tool at which theta is 0 (3, 3); unused for n < 6.
        x: State [q; qdot] of the arm (2 nv).
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
    """Returns the tool's acceleration dv/dt in m/s^2 and rad/s^2 (n).

    Args:
        tool: The arm and its tool.
        x: State [q; qdot] of the arm (2 nv).
        qddot: Accelerations of the joints in rad/s^2 or m/s^2 (nv).
    """
    motion = calc_motion(tool.tree, *np.split(x, 2))
    _, _, J = place_tool(tool, motion)
    return tool_bias(tool, motion) + (J[: tool.num_axes] * qddot).sum(axis=1)


def gravity_torque(tree: RigidBodyTree, x: Array) -> Array:
    """Returns the joint torques that balance gravity, N m or N (nv)."""
    q, qdot = np.split(x, 2)
    rest = 0 * qdot
    return calc_dynamics(tree, calc_motion(tree, q, rest), rest)[1]


def rotation_vector(R: Array) -> Array:
    """Returns the axis of a rotation times its angle, 0 to pi, in rad (3)."""
    sine = orientation_error(np.eye(3), R)
    length = np.sqrt(np.sum(sine * sine) + _TINY)
    # arctan2 is smooth at the angle 0, arccos is not.
    angle = np.arctan2(length, (np.trace(R) - 1) / 2)
    return angle / length * sine


def rotated(theta: Array, u: Array) -> Array:
    """Returns the vector u rotated by the rotation vector theta in rad (3)."""
    angle = np.sqrt(np.sum(theta * theta) + _TINY)
    turn = cross(theta, u)
    bow = np.sin(angle / 2) / angle
    return u + np.sin(angle) / angle * turn + 2 * bow * bow * cross(theta, turn)


def position_rate(r: Array, v: Array) -> Array:
    """Returns dr/dt of a tool's position (n). Without rotation axes it is v.

        dtheta/dt = w - theta x w/2 + (1 - c)/|theta|^2 theta x (theta x w)

    with c = |theta|/2 cot(|theta|/2): the inverse left Jacobian of SO(3), applied to
    the angular velocity w.

    Args:
        r: Position in m and rad (n).
        v: Velocity in m/s and rad/s (n).
    """
    if r.size < 6:
        return v
    half = np.sqrt(np.sum(r[3:] * r[3:]) + _SMALL) / 2
    share = (1 - half * np.cos(half) / np.sin(half)) / (4 * half * half)
    turn = cross(r[3:], v[3:])
    return np.append(v[:3], v[3:] - turn / 2 + share * cross(r[3:], turn))


def displacement(r: Array, r_0: Array) -> Array:
    """Returns the displacement from position r_0 to r (n).

    Translations have r - r_0, rotations the rotation vector of R R_0^T. If a rotational
    stiffness K is the same about all axes, K times this vector is the moment of a
    spring that stores energy: its power is moment times w - w_0.

    Args:
        r, r_0: Positions in m and rad (n), turned by less than pi from one another.
    """
    if r.size < 6:
        return r - r_0
    R = np.stack([rotated(r[3:], rotated(-r_0[3:], e)) for e in np.eye(3)]).T
    return np.append(r[:3] - r_0[:3], rotation_vector(R))


def translation(x: Array) -> Array:
    """Returns a vector of the task space with its rotational entries set to 0 (n)."""
    return np.append(x[:3], 0 * x[3:])


def joint_torques(F_c: Array, F_e: Array, kinematics: Array) -> Array:
    """Returns [tau; tau_e] of (2.11) and (2.6) in N m or N (2 nv).

    Args:
        F_c: Control force in N, a wrench for n = 6 (n).
        F_e: Force the robot exerts on the environment in N, a wrench for n = 6 (n).
        kinematics: The result of tool_kinematics().
    """
    J = kinematics[2 * F_c.size :].reshape(F_c.size, -1)
    # F @ J would use BLAS, which adds in another order than compiled code. Error
    # control would turn a difference in the last digit into different steps.
    tau = (F_c[:, np.newaxis] * J).sum(axis=0)
    tau_e = -(F_e[:, np.newaxis] * J).sum(axis=0)
    return np.concatenate((tau, tau_e))


class PostureGains(NamedTuple):
    """The constants of the law that holds the posture or the orientation.

    Attributes:
        frequency: The natural frequency w in rad/s.
        damping_ratio: The damping ratio zeta.
        near: The value of det A below which a pose counts as nearly singular.
        damping: The number added to the diagonal of A at a singular pose.
    """

    frequency: float
    damping_ratio: float
    near: float
    damping: float


def hold_torque(
    tool: Tool, gains: PostureGains, held: tuple[Array, ...], x: Array
) -> Array:
    """Returns the torque that controls the free joint motion, in N m or N (nv).

    Args:
        tool: The arm and its tool.
        gains: The law's constants.
        held: (q_0,) to hold the posture, (q_0, R_0) to hold the orientation.
        x: State [q; qdot] of the arm (2 nv).
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
    """Returns -w^2 e - 2 zeta w omega, which turns the tool back, in rad/s^2 (3)."""
    w = gains.frequency
    error = orientation_error(R_0, R)
    return -w * w * error - 2 * gains.damping_ratio * w * omega


def orientation_error(R_0: Array, R: Array) -> Array:
    """Returns sin(angle) times the axis of the rotation from R_0 to R (3)."""
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
    """Returns A^-1 b for a symmetric A, which is damped if it is nearly singular."""
    scale = np.sqrt(np.diag(A) + 1e-30)
    C = A / np.outer(scale, scale) + _FLOOR * np.eye(len(b))
    determinant = 1.0
    for pivot in _pivots(C):
        determinant *= pivot
    share = max(0.0, 1 - determinant / near)
    C = C + damping * share * share * np.eye(len(b))
    return np.asarray(np.linalg.solve(C, b / scale) / scale)


def _pivots(A: Array) -> list[float]:
    """Returns the squared diagonal of L in A = L L^T, whose product is det A."""
    pivots = []
    while len(A) > 0:
        # A pivot near 0 may be negative by rounding.
        pivots.append(max(A[0, 0], 1e-18))
        A = A[1:, 1:] - np.outer(A[1:, 0], A[0, 1:]) / pivots[-1]
    return pivots

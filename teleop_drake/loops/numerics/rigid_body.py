"""Dynamics of a tree of links with one revolute or prismatic joint each.

The recursive Newton-Euler and composite-rigid-body algorithms (R. Featherstone, "Rigid
Body Dynamics Algorithms", 2008, chapters 5 and 6). All spatial vectors are about the
world's origin O and in the world's axes, so that vectors of different links can be
added without a transformation:

    motion   V = [w; v], the angular velocity and the velocity of the body point at O
    force    F = [moment about O; force]
    inertia  F = I V,  I = [[inertia about O, h~], [-h~, m 1]],  h = m c, h~ a = h x a

Lists over links begin with the world, so that link i is element i + 1 and the world,
link -1, is element 0.
"""

from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Indices


class RigidBodyTree(NamedTuple):
    """The links of a robot, each after its parent.

    The frame of link i is the joint's frame on it. At q_i = 0 it coincides with the
    joint's frame on the parent.

    Attributes:
        parents: Index of each link's parent, -1 for the world (n).
        is_prismatic: 1 if link i slides along its axis, 0 if it turns about it (n).
        frames: Pose [R, p] of each joint's frame on the parent in the parent's frame
            (n, 3, 4), m.
        axes: Unit vector of each joint's axis in the link's frame (n, 3).
        masses: Mass of each link (n), kg.
        moments: First moment m c of each link about the origin of its frame (n, 3),
            kg m.
        inertias: Inertia of each link about the origin of its frame (n, 3, 3), kg m^2.
        rotor_inertias: Reflected inertia of each joint's rotor (n), kg m^2 or kg.
        damping: Viscous damping of each joint (n), N m s or N s/m.
        gravity: Acceleration of gravity in the world (3), m/s^2.
    """

    parents: Indices
    is_prismatic: Indices
    frames: Array
    axes: Array
    masses: Array
    moments: Array
    inertias: Array
    rotor_inertias: Array
    damping: Array
    gravity: Array


class Motion(NamedTuple):
    """The poses, velocities and accelerations of the links of a tree, the world first.

    Attributes:
        R: Rotation of each link's frame (3, 3).
        p: Position of each frame's origin in m (3).
        S: Motion of each link for a unit rate of its joint (6).
        V: Spatial velocity of each link (6).
        A: Spatial acceleration dV/dt of each link without joint accelerations (6).
    """

    R: list[Array]
    p: list[Array]
    S: list[Array]
    V: list[Array]
    A: list[Array]


def cross(a: Array, b: Array) -> Array:
    """Returns a x b of two vectors (3).

    np.cross() accepts arrays of vectors, too, and takes ten times as long for one.
    """
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    z = a[0] * b[1] - a[1] * b[0]
    return np.array([x, y, z])


def _skew(a: Array) -> Array:
    """Returns a~, the matrix of a x."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _spatial_cross(V: Array, W: Array) -> Array:
    """Returns V x W, the rate of a motion vector W that moves along with V.

    For the rate of a force or momentum, exchange the halves of W and of the result.
    """
    w = V[:3]
    turning = cross(w, W[:3])
    moving = cross(w, W[3:]) + cross(V[3:], W[:3])
    return np.append(turning, moving)


def _exchanged(F: Array) -> Array:
    """Returns a spatial vector with its halves exchanged."""
    return np.append(F[3:], F[:3])


def calc_motion(tree: RigidBodyTree, q: Array, v: Array) -> Motion:
    """Returns poses, velocities and accelerations of all links.

    Args:
        tree: The links.
        q: Positions of the joints in rad or m (n).
        v: Velocities of the joints in rad/s or m/s (n).
    """
    # The lists begin with the world, at rest.
    R = [np.eye(3)]
    p = [np.zeros(3)]
    S = [np.zeros(6)]
    V = [np.zeros(6)]
    A = [np.zeros(6)]
    for i in range(len(tree.parents)):
        parent = tree.parents[i] + 1
        frame = tree.frames[i]
        R_i = R[parent] @ frame[:, :3]
        p_i = p[parent] + R[parent] @ frame[:, 3]
        axis = R_i @ tree.axes[i]
        if tree.is_prismatic[i]:
            p_i = p_i + q[i] * axis
            S_i = np.append(np.zeros(3), axis)
        else:
            K = _skew(tree.axes[i])  # Rodrigues' formula.
            turn = np.eye(3) + np.sin(q[i]) * K + (1 - np.cos(q[i])) * (K @ K)
            R_i = R_i @ turn
            S_i = np.append(axis, cross(p_i, axis))
        R.append(R_i)
        p.append(p_i)
        S.append(S_i)
        V.append(V[parent] + S_i * v[i])
        A.append(A[parent] + _spatial_cross(V[parent], S_i * v[i]))
    return Motion(R, p, S, V, A)


def _calc_inertia(tree: RigidBodyTree, motion: Motion, i: int) -> Array:
    """Returns the spatial inertia of a link about O (6, 6)."""
    m = tree.masses[i]
    R = motion.R[i + 1]
    p = motion.p[i + 1]
    h = R @ tree.moments[i]
    # The parallel-axis theorem. The first moment h is about the link's origin.
    shift = np.outer(p, m * p / 2 + h)
    about_O = R @ tree.inertias[i] @ R.T - shift - shift.T
    about_O = about_O + 2 * np.trace(shift) * np.eye(3)
    h_skew = _skew(m * p + h)
    return np.block([[about_O, h_skew], [h_skew.T, m * np.eye(3)]])


def calc_dynamics(tree: RigidBodyTree, motion: Motion, v: Array) -> tuple[Array, Array]:
    """Returns M (n, n) and the bias (n) of M v_dot + bias = forces - D v.

    The bias contains the Coriolis, centrifugal and gravity terms, N m or N.

    Args:
        tree: The links.
        motion: The result of calc_motion().
        v: Velocities of the joints in rad/s or m/s (n).
    """
    n = len(tree.parents)
    # Zeros of the scalar type of v.
    M = 0 * v[:, np.newaxis] * v
    bias = 0 * v
    # F has the force on each link that its motion without joint accelerations requires.
    # Gravity is represented by an opposite acceleration of the whole tree.
    fall = np.append(np.zeros(3), -tree.gravity)
    I = [_calc_inertia(tree, motion, i) for i in range(n)]
    F = [
        I_i @ (A_i + fall) + _exchanged(_spatial_cross(V_i, _exchanged(I_i @ V_i)))
        for I_i, A_i, V_i in zip(I, motion.A[1:], motion.V[1:], strict=True)
    ]
    # From the tips to the base, I and F of a link become those of the composite body:
    # the link with all links outboard of it.
    for i in reversed(range(n)):
        S = motion.S[i + 1]
        parent = tree.parents[i]
        bias[i] = S @ F[i]
        # The force on the composite body for a unit acceleration of joint i. It acts on
        # joint i and on all joints inboard of it.
        weight = I[i] @ S
        M[i, i] = S @ weight + tree.rotor_inertias[i]
        j = parent
        while j >= 0:
            M[i, j] = M[j, i] = motion.S[j + 1] @ weight
            j = tree.parents[j]
        if parent >= 0:
            F[parent] = F[parent] + F[i]
            I[parent] = I[parent] + I[i]
    return M, bias


def calc_joint_accelerations(
    tree: RigidBodyTree, q: Array, v: Array, forces: Array
) -> Array:
    """Returns v_dot of M v_dot = forces - D v - bias, rad/s^2 or m/s^2 (n).

    Args:
        tree: The links.
        q: Positions of the joints in rad or m (n).
        v: Velocities of the joints in rad/s or m/s (n).
        forces: Generalised forces on the joints, without damping and gravity, N m or N
            (n).
    """
    M, bias = calc_dynamics(tree, calc_motion(tree, q, v), v)
    return _solve_positive(M, forces - tree.damping * v - bias)


def _solve_positive(M: Array, b: Array) -> Array:
    """Returns x of M x = b for a symmetric positive definite M (n, n).

    It eliminates without pivoting, which such a matrix allows. The traced form has half
    the operations of numpy.linalg.solve() and no comparisons.
    """
    n = len(b)
    # Each row of U begins at its diagonal.
    U = [M[k, k:] for k in range(n)]
    y = [b[k] for k in range(n)]
    for k in range(n):
        for i in range(k + 1, n):
            factor = U[k][i - k] / U[k][0]
            U[i] = U[i] - factor * U[k][i - k :]
            y[i] = y[i] - factor * y[k]
    x = np.zeros(0)
    for row, right_side in zip(reversed(U), reversed(y), strict=True):
        x = np.append((right_side - row[1:] @ x) / row[0], x)
    return x


def calc_jacobian(
    tree: RigidBodyTree, motion: Motion, link: int, point: Array
) -> tuple[Array, Array]:
    """Returns a point's position in m (3) and the Jacobian of [w; velocity] (6, n).

    Args:
        tree: The links.
        motion: The result of calc_motion().
        link: Index of the link on which the point is, -1 for the world.
        point: The point in the link's frame, m (3).
    """
    p = motion.p[link + 1] + motion.R[link + 1] @ point
    columns = [np.zeros(6)] * len(tree.parents)
    while link >= 0:
        w = motion.S[link + 1][:3]
        u = motion.S[link + 1][3:]
        columns[link] = np.append(w, u + cross(w, p))
        link = tree.parents[link]
    return p, np.array(columns).reshape(-1, 6).T


def calc_bias_acceleration(motion: Motion, link: int, point: Array) -> Array:
    """Returns dJ/dt v at a point: [angular acceleration; acceleration] (6).

    This is the acceleration without joint accelerations, in rad/s^2 and m/s^2.

    Args:
        motion: The result of calc_motion().
        link: Index of the link on which the point is, -1 for the world.
        point: The point in the link's frame, m (3).
    """
    p = motion.p[link + 1] + motion.R[link + 1] @ point
    w = motion.V[link + 1][:3]
    u = motion.V[link + 1][3:]
    alpha = motion.A[link + 1][:3]
    # The spatial acceleration is the rate of the velocity at the fixed point O, through
    # which the points of the link pass. The last term makes it that of a body point.
    a_O = motion.A[link + 1][3:]
    a = a_O + cross(alpha, p) + cross(w, u + cross(w, p))
    return np.append(alpha, a)

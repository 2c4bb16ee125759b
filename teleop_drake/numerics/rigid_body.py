"""Dynamics of a tree of links with one revolute or prismatic joint each.

Recursive Newton-Euler and composite rigid bodies (R. Featherstone, "Rigid Body
Dynamics Algorithms", 2008, chapters 5 and 6). All spatial vectors are about the
world's origin O and in the world's axes, so that those of different links add up
without a transformation:

    motion   V = [w; v], the angular velocity and the velocity of the point at O
    force    F = [moment about O; force]
    inertia  [m; h; I], mass, first moment h = m c and inertia about O
             (xx, yy, zz, xy, xz, yz)

Each function works in a `work` array, with one row for each link, and allocates
nothing. As machine code a pass over two links takes a quarter of a microsecond.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Vector3 = tuple[float, float, float]


class RigidBodyTree(NamedTuple):
    """The links of a robot, each after its parent.

    The frame of link i is the joint's frame on it. At q_i = 0 it coincides with the
    joint's frame on the parent.

    Attributes:
        parents: Index of each link's parent, -1 for the world (n).
        is_prismatic: 1 if link i slides along its axis, 0 if it turns about it (n).
        frames: Rotation, row by row, and position of each joint's frame on the parent
            in the parent's frame (n, 12), m.
        axes: Unit vector of each joint's axis in the link's frame (n, 3).
        inertias: Mass, first moment and inertia of each link about the origin of its
            frame (n, 10), kg, kg m, kg m^2.
        rotor_inertias: What each joint's rotor adds, reflected (n), kg m^2 or kg.
        damping: Viscous damping of each joint (n), N m s or N s/m.
        gravity: Acceleration of gravity in the world (3), m/s^2.
    """

    parents: Indices
    is_prismatic: Indices
    frames: Array
    axes: Array
    inertias: Array
    rotor_inertias: Array
    damping: Array
    gravity: Array


# The columns of `work`: pose of the link (rotation row by row, position), motion
# subspace S of its joint, velocity V, acceleration A, force F, composite inertia, and
# the row of the mass matrix, beside the column for what is solved with it.
_R, _P, _S, _V, _A, _F, _I, _M = 0, 9, 12, 18, 24, 30, 36, 46


def make_work(num_links: int) -> Array:
    """Returns the `work` array that the other functions take.

    Args:
        num_links: n.
    """
    return np.zeros((num_links, _M + num_links))


def _cross(a: Vector3, b: Vector3) -> Vector3:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def _dot(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _sum(a: Vector3, b: Vector3) -> Vector3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _get(row: Array, k: int) -> Vector3:
    return row[k], row[k + 1], row[k + 2]


def _set(row: Array, k: int, a: Vector3) -> None:
    row[k], row[k + 1], row[k + 2] = a[0], a[1], a[2]


def _rotate(row: Array, k: int, a: Vector3) -> Vector3:
    """Returns R a, for the rotation that a row has from column k on."""
    return (
        row[k] * a[0] + row[k + 1] * a[1] + row[k + 2] * a[2],
        row[k + 3] * a[0] + row[k + 4] * a[1] + row[k + 5] * a[2],
        row[k + 6] * a[0] + row[k + 7] * a[1] + row[k + 8] * a[2],
    )


def _turn(a: Vector3, axis: Vector3, sine: float, cosine: float) -> Vector3:
    """Returns a vector turned about a unit axis (Rodrigues)."""
    along = (1 - cosine) * _dot(axis, a)
    across = _cross(axis, a)
    return (
        cosine * a[0] + sine * across[0] + along * axis[0],
        cosine * a[1] + sine * across[1] + along * axis[1],
        cosine * a[2] + sine * across[2] + along * axis[2],
    )


def calc_kinematics(tree: RigidBodyTree, q: Array, v: Array, work: Array) -> None:
    """Fills in each link's pose, motion subspace and velocity.

    Args:
        tree: The links.
        q: Positions of the joints in rad or m (n).
        v: Their velocities in rad/s or m/s (n).
        work: As make_work() returns it.
    """
    for i in range(len(tree.parents)):
        row, frame, parent = work[i], tree.frames[i], tree.parents[i]
        axis, origin = _get(tree.axes[i], 0), _get(frame, 9)
        slide, sine, cosine = 0.0, 0.0, 1.0
        if tree.is_prismatic[i]:
            slide = q[i]
        else:
            sine, cosine = math.sin(q[i]), math.cos(q[i])
        # The frame's columns, and how far it has slid.
        x = _rotate(frame, 0, _turn((1.0, 0.0, 0.0), axis, sine, cosine))
        y = _rotate(frame, 0, _turn((0.0, 1.0, 0.0), axis, sine, cosine))
        z = _rotate(frame, 0, _turn((0.0, 0.0, 1.0), axis, sine, cosine))
        a = _rotate(frame, 0, axis)
        origin = _sum(origin, (slide * a[0], slide * a[1], slide * a[2]))
        w_parent, v_parent = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if parent >= 0:
            above = work[parent]
            x, y = _rotate(above, _R, x), _rotate(above, _R, y)
            z, a = _rotate(above, _R, z), _rotate(above, _R, a)
            origin = _sum(_get(above, _P), _rotate(above, _R, origin))
            w_parent, v_parent = _get(above, _V), _get(above, _V + 3)
        for k in range(3):
            row[_R + 3 * k], row[_R + 3 * k + 1] = x[k], y[k]
            row[_R + 3 * k + 2] = z[k]
        _set(row, _P, origin)
        if tree.is_prismatic[i]:
            _set(row, _S, (0.0, 0.0, 0.0))
            _set(row, _S + 3, a)
        else:
            _set(row, _S, a)
            _set(row, _S + 3, _cross(origin, a))
        for k in range(3):
            row[_V + k] = w_parent[k] + row[_S + k] * v[i]
            row[_V + 3 + k] = v_parent[k] + row[_S + 3 + k] * v[i]


def _set_inertia(inertia: Array, row: Array) -> None:
    """Fills in a link's inertia about O: I_O = R I R^T + (m p^2 + 2 p.h) 1 - ..."""
    m, h, p = inertia[0], _rotate(row, _R, _get(inertia, 1)), _get(row, _P)
    xx, yy, zz, xy, xz, yz = inertia[4:10]
    # R I, whose rows times those of R are R I R^T.
    x, y, z = _get(row, _R), _get(row, _R + 3), _get(row, _R + 6)
    Ix = (_dot(x, (xx, xy, xz)), _dot(x, (xy, yy, yz)), _dot(x, (xz, yz, zz)))
    Iy = (_dot(y, (xx, xy, xz)), _dot(y, (xy, yy, yz)), _dot(y, (xz, yz, zz)))
    Iz = (_dot(z, (xx, xy, xz)), _dot(z, (xy, yy, yz)), _dot(z, (xz, yz, zz)))
    trace = m * _dot(p, p) + 2 * _dot(p, h)
    row[_I] = m
    _set(row, _I + 1, (h[0] + m * p[0], h[1] + m * p[1], h[2] + m * p[2]))
    row[_I + 4] = _dot(Ix, x) + trace - m * p[0] * p[0] - 2 * p[0] * h[0]
    row[_I + 5] = _dot(Iy, y) + trace - m * p[1] * p[1] - 2 * p[1] * h[1]
    row[_I + 6] = _dot(Iz, z) + trace - m * p[2] * p[2] - 2 * p[2] * h[2]
    row[_I + 7] = _dot(Ix, y) - m * p[0] * p[1] - p[0] * h[1] - h[0] * p[1]
    row[_I + 8] = _dot(Ix, z) - m * p[0] * p[2] - p[0] * h[2] - h[0] * p[2]
    row[_I + 9] = _dot(Iy, z) - m * p[1] * p[2] - p[1] * h[2] - h[1] * p[2]


def _momentum(row: Array, w: Vector3, v: Vector3) -> tuple[Vector3, Vector3]:
    """Returns inertia times motion, [I w + h x v; m v + w x h]."""
    m, h = row[_I], _get(row, _I + 1)
    xx, yy, zz, xy, xz, yz = row[_I + 4 : _I + 10]
    I_w = (_dot((xx, xy, xz), w), _dot((xy, yy, yz), w), _dot((xz, yz, zz), w))
    return (
        _sum(I_w, _cross(h, v)),
        _sum((m * v[0], m * v[1], m * v[2]), _cross(w, h)),
    )


def _calc_bias(tree: RigidBodyTree, v: Array, work: Array) -> None:
    """Fills in what each link would need to move on, were no joint to accelerate.

    That is its acceleration relative to free fall, and the force for it.
    """
    for i in range(len(tree.parents)):
        row, parent = work[i], tree.parents[i]
        g = tree.gravity
        alpha, a = (0.0, 0.0, 0.0), (-g[0], -g[1], -g[2])
        if parent >= 0:
            alpha, a = _get(work[parent], _A), _get(work[parent], _A + 3)
        w, u = _get(row, _V), _get(row, _V + 3)
        # The joint's motion, which turns with the link: dS/dt = V x S.
        w_S = (row[_S] * v[i], row[_S + 1] * v[i], row[_S + 2] * v[i])
        v_S = (row[_S + 3] * v[i], row[_S + 4] * v[i], row[_S + 5] * v[i])
        alpha = _sum(alpha, _cross(w, w_S))
        a = _sum(a, _sum(_cross(w, v_S), _cross(u, w_S)))
        _set(row, _A, alpha)
        _set(row, _A + 3, a)
        _set_inertia(tree.inertias[i], row)
        L, P = _momentum(row, w, u)
        moment, force = _momentum(row, alpha, a)
        _set(row, _F, _sum(moment, _sum(_cross(w, L), _cross(u, P))))
        _set(row, _F + 3, _sum(force, _cross(w, P)))


def calc_accelerations(
    tree: RigidBodyTree, q: Array, v: Array, forces: Array, work: Array, v_dot: Array
) -> None:
    """Fills in the accelerations of the joints: M v_dot = forces - D v - bias(q, v).

    Args:
        tree: The links.
        q: Positions of the joints in rad or m (n).
        v: Their velocities in rad/s or m/s (n).
        forces: What acts on the joints, their damping and gravity aside, N m or N (n).
        work: As make_work() returns it.
        v_dot: For the result, in rad/s^2 or m/s^2 (n).
    """
    calc_mass_matrix(tree, q, v, work, v_dot)
    for i in range(len(v_dot)):
        v_dot[i] = forces[i] - tree.damping[i] * v[i] - v_dot[i]
    _solve(work, v_dot)


def calc_mass_matrix(
    tree: RigidBodyTree, q: Array, v: Array, work: Array, bias: Array
) -> None:
    """Fills in the mass matrix M and the bias of M v_dot + bias = forces - D v.

    Args:
        tree: The links.
        q: Positions of the joints in rad or m (n).
        v: Their velocities in rad/s or m/s (n).
        work: As make_work() returns it, for the lower half of M; see mass_matrix().
        bias: For the Coriolis, centrifugal and gravity terms, N m or N (n).
    """
    n = len(tree.parents)
    calc_kinematics(tree, q, v, work)
    _calc_bias(tree, v, work)
    for i in range(n - 1, -1, -1):
        row = work[i]
        bias[i] = 0.0
        for k in range(6):
            bias[i] += row[_S + k] * row[_F + k]
        # M, column by column: what the links outboard of joint i weigh for the joints
        # inboard of it.
        L, P = _momentum(row, _get(row, _S), _get(row, _S + 3))
        for j in range(i + 1):
            work[i, _M + j] = 0.0
        j = i
        while j >= 0:
            above = work[j]
            work[i, _M + j] = _dot(_get(above, _S), L) + _dot(_get(above, _S + 3), P)
            j = tree.parents[j]
        work[i, _M + i] += tree.rotor_inertias[i]
        if tree.parents[i] >= 0:
            above = work[tree.parents[i]]
            for k in range(6):
                above[_F + k] += row[_F + k]
            for k in range(10):
                above[_I + k] += row[_I + k]


def mass_matrix(work: Array) -> Array:
    """Returns M (n, n).

    Args:
        work: As calc_mass_matrix() left it.
    """
    n = len(work)
    M = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            M[i, j] = M[j, i] = work[i, _M + j]
    return M


def _solve(work: Array, b: Array) -> None:
    """Solves M x = b in place, by M = L L^T of the lower half of M."""
    n = len(b)
    for i in range(n):
        for j in range(i + 1):
            value = work[i, _M + j]
            for k in range(j):
                value -= work[i, _M + k] * work[j, _M + k]
            if i == j:
                work[i, _M + i] = math.sqrt(value)
                b[i] /= work[i, _M + i]
            else:
                work[i, _M + j] = value / work[j, _M + j]
                b[i] -= work[i, _M + j] * b[j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            b[i] -= work[j, _M + i] * b[j]
        b[i] /= work[i, _M + i]


def calc_point_motion(
    tree: RigidBodyTree, link: int, point: Array, work: Array, result: Array
) -> None:
    """Fills in position, velocity and translational Jacobian of a point of a link.

    Args:
        tree: The links.
        link: Index of the link, -1 for the world.
        point: The point in the link's frame, m (3).
        work: As calc_kinematics() or calc_accelerations() left it.
        result: For position, velocity and the Jacobian row by row (6 + 3 n), in the
            world's axes.
    """
    n = len(tree.parents)
    for k in range(len(result)):
        result[k] = 0.0
    p = _get(point, 0)
    if link >= 0:
        row = work[link]
        p = _sum(_get(row, _P), _rotate(row, _R, p))
        w, u = _get(row, _V), _get(row, _V + 3)
        _set(result, 3, _sum(u, _cross(w, p)))
    _set(result, 0, p)
    i = link
    while i >= 0:
        column = _sum(_get(work[i], _S + 3), _cross(_get(work[i], _S), p))
        for k in range(3):
            result[6 + k * n + i] = column[k]
        i = tree.parents[i]


def calc_link_turn(tree: RigidBodyTree, link: int, work: Array, result: Array) -> None:
    """Fills in rotation and angular Jacobian of a link.

    Args:
        tree: The links.
        link: Index of the link, -1 for the world.
        work: As calc_kinematics() or calc_accelerations() left it.
        result: For the rotation and the Jacobian of the angular velocity, each row by
            row (9 + 3 n), in the world's axes.
    """
    n = len(tree.parents)
    for k in range(len(result)):
        result[k] = 0.0
    for k in range(9):
        result[k] = work[link, _R + k] if link >= 0 else float(k % 4 == 0)
    i = link
    while i >= 0:
        for k in range(3):
            result[9 + k * n + i] = work[i, _S + k]
        i = tree.parents[i]


def calc_point_acceleration(
    tree: RigidBodyTree,
    link: int,
    point: Array,
    v_dot: Array,
    work: Array,
    result: Array,
) -> None:
    """Fills in the acceleration of a point of a link, in the world's axes.

    Args:
        tree: The links.
        link: Index of the link, -1 for the world.
        point: The point in the link's frame, m (3).
        v_dot: What calc_accelerations() filled in (n).
        work: As calc_accelerations() left it.
        result: For the acceleration, m/s^2 (3).
    """
    _set(result, 0, (0.0, 0.0, 0.0))
    if link < 0:
        return
    row = work[link]
    p = _sum(_get(row, _P), _rotate(row, _R, _get(point, 0)))
    alpha, a = _get(row, _A), _sum(_get(row, _A + 3), _get(tree.gravity, 0))
    i = link
    while i >= 0:
        S = work[i, _S : _S + 6]
        alpha = _sum(alpha, (S[0] * v_dot[i], S[1] * v_dot[i], S[2] * v_dot[i]))
        a = _sum(a, (S[3] * v_dot[i], S[4] * v_dot[i], S[5] * v_dot[i]))
        i = tree.parents[i]
    # a is what happens at O: the point there belongs to another part of the link all
    # the time.
    w, u = _get(row, _V), _get(row, _V + 3)
    v_p = _sum(u, _cross(w, p))
    _set(result, 0, _sum(a, _sum(_cross(alpha, p), _cross(w, v_p))))

"""Recursive Newton-Euler (Luh, Walker, Paul 1980) over standard DH: the Puma 560."""

import numpy as np

PI = np.pi
D = [0.67183, 0.0, 0.15005, 0.4318, 0.0, 0.0]
A = [0.0, 0.4318, 0.0203, 0.0, 0.0, 0.0]
ALPHA = [PI / 2, 0.0, -PI / 2, PI / 2, -PI / 2, 0.0]
MASS = [0.0, 17.4, 4.8, 0.82, 0.34, 0.09]
CENTRE = np.array(
    [
        [0, 0, 0],
        [-0.3638, 0.006, 0.2275],
        [-0.0203, -0.0141, 0.070],
        [0, 0.019, 0],
        [0, 0, 0],
        [0, 0, 0.032],
    ]
)
INERTIA = [
    np.diag(x)
    for x in (
        [0, 0.35, 0],
        [0.13, 0.524, 0.539],
        [0.066, 0.066, 0.0125],
        [1.8e-3, 1.3e-3, 1.8e-3],
        [0.3e-3, 0.4e-3, 0.3e-3],
        [0.15e-3, 0.15e-3, 0.04e-3],
    )
]
MOTOR = np.array([200e-6, 200e-6, 200e-6, 33e-6, 33e-6, 33e-6])
GEAR = np.array([62.6111, 107.815, 53.7063, 76.0364, 71.923, 76.686])
VISCOUS = np.array([1.48e-3, 0.817e-3, 1.38e-3, 71.2e-6, 82.6e-6, 36.7e-6])
COULOMB = (
    [0.395, 0.126, 0.132, 11.2e-3, 9.26e-3, 3.96e-3],
    [0.435, 0.071, 0.105, 16.9e-3, 14.5e-3, 10.5e-3],
)
NEEDLE = 0.2


def link_transform(i, q):
    """Frame i + 1 in frame i: Rot_z(q) Trans_z(d) Trans_x(a) Rot_x(alpha)."""
    c = np.cos(q)
    s = np.sin(q)
    ca = np.cos(ALPHA[i])
    sa = np.sin(ALPHA[i])
    R = np.array([[c, -s * ca, s * sa], [s, c * ca, -c * sa], [0, sa, ca]])
    return R, np.array([A[i] * c, A[i] * s, D[i]])


def tool_pose(q):
    R = np.eye(3)
    p = np.zeros(3)
    for i in range(6):
        R_i, p_i = link_transform(i, q[i])
        R, p = R @ R_i, p + R @ p_i
    return R, p + NEEDLE * R[:, 2]


def inverse_dynamics(q, v, v_dot, gravity=9.80665, has_motors=True):
    """The torques of the joints for accelerations, in N m, friction left out."""
    w = np.zeros(3)
    w_dot = np.zeros(3)
    a = np.array([0, 0, gravity])  # The base accelerates upward in place of gravity.
    z = np.array([0, 0, 1.0])
    forces = []
    moments = []
    rotations = []
    arms = []
    for i in range(6):
        R, p = link_transform(i, q[i])
        w_dot = R.T @ (w_dot + z * v_dot[i] + np.cross(w, z * v[i]))
        w = R.T @ (w + z * v[i])
        arm = R.T @ p
        a = R.T @ a + np.cross(w_dot, arm) + np.cross(w, np.cross(w, arm))
        r = CENTRE[i]
        a_c = a + np.cross(w_dot, r) + np.cross(w, np.cross(w, r))
        forces.append(MASS[i] * a_c)
        moments.append(INERTIA[i] @ w_dot + np.cross(w, INERTIA[i] @ w))
        rotations.append(R)
        arms.append(arm)
    f = np.zeros(3)
    n = np.zeros(3)
    tau = np.zeros(6)
    for i in reversed(range(6)):
        # About the origin of frame i - 1, in the axes of frame i.
        n = n + moments[i] + np.cross(arms[i] + CENTRE[i], forces[i])
        n += np.cross(arms[i], f)
        f = f + forces[i]
        f = rotations[i] @ f
        n = rotations[i] @ n
        tau[i] = n[2]
    return tau + has_motors * MOTOR * GEAR**2 * v_dot


def mass_matrix(q):
    rest = np.zeros(6)
    return np.array([inverse_dynamics(q, rest, e, 0.0) for e in np.eye(6)]).T

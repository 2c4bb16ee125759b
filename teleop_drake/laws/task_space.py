"""A robot's tool in task space, (2.6) to (2.13).

The task axes are the first n axes of the world, J the first n rows of Drake's
translational Jacobian Jv_v_WT, and tau_e what the environment's reaction -F_e at the
tool does to the joints:

    v_WT = J qdot,    tau = J^T F_c  (2.11),    tau_e = -J^T F_e  (2.6).

Each function returns one vector, the value of a port.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def tool_kinematics(p_WT: Array, Jv_v_WT: Array, x: Array, num_axes: int) -> Array:
    """Returns [p_WT; v_WT; J row by row] of M robots, in m and m/s (2 M n + n nv).

    The columns of J are the robot's own nv/M generalized velocities.

    Args:
        p_WT: Positions of the tools in m (3 M).
        Jv_v_WT: Their translational Jacobians, one below the other (3 M, nv).
        x: [q; qdot] of all robots, in the order of the tools.
        num_axes: n.
    """
    n, M, nv = num_axes, p_WT.size // 3, Jv_v_WT.shape[1]
    own = nv // M
    qdot = x[x.size - nv :]
    result = np.empty(n * (2 * M + nv))
    for i in range(M):
        first, end = i * own, (i + 1) * own
        for j in range(n):
            k, J_k = i * n + j, Jv_v_WT[3 * i + j, first:end]
            result[k] = p_WT[3 * i + j]
            result[M * n + k] = (J_k * qdot[first:end]).sum()
            result[2 * M * n + k * own : 2 * M * n + (k + 1) * own] = J_k
    return result


def joint_torques(F_c: Array, F_e: Array, kinematics: Array, num_axes: int) -> Array:
    """Returns [tau; tau_e], (2.11) and (2.6), in N m or N, for M robots (2 M nv).

    Args:
        F_c: Control forces in N (M n).
        F_e: Forces of the robots ON their environments in N (M n).
        kinematics: [p_WT (M n); v_WT (M n); J row by row (M n nv)].
        num_axes: n.
    """
    n = num_axes
    M = F_c.size // n
    J = kinematics[2 * M * n :].reshape(M, n, -1)
    torques = np.empty((2, M, J.shape[2]))
    for i in range(M):
        a, b = i * n, (i + 1) * n
        torques[0, i], torques[1, i] = F_c[a:b] @ J[i], -F_e[a:b] @ J[i]
    return torques.ravel()

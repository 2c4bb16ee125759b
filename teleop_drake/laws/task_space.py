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


def tool_kinematics(num_axes: int, p_WT: Array, Jv_v_WT: Array, x: Array) -> Array:
    """Returns [p_WT; v_WT; J row by row] in m and m/s (2n + n nv).

    Args:
        num_axes: n.
        p_WT: Position of the tool in m (3).
        Jv_v_WT: Its translational Jacobian (3, nv).
        x: The robot's state, [q; qdot] (nq + nv).
    """
    n, nv = num_axes, Jv_v_WT.shape[1]
    qdot = x[x.size - nv :]
    result = np.empty(n * (2 + nv))
    result[:n] = p_WT[:n]
    for i in range(n):
        J_i = Jv_v_WT[i]
        result[n + i] = (J_i * qdot).sum()
        result[2 * n + i * nv : 2 * n + (i + 1) * nv] = J_i
    return result


def joint_torques(F_c: Array, F_e: Array, kinematics: Array) -> Array:
    """Returns [tau; tau_e], (2.11) and (2.6), in N m or N (2 nv).

    Args:
        F_c: Control force in N (n).
        F_e: Force of the robot ON the environment in N (n).
        kinematics: As from tool_kinematics().
    """
    J = kinematics[2 * F_c.size :].reshape(F_c.size, -1)
    # Not F @ J: BLAS adds in another order than machine code, and error control turns
    # a difference in the last digit into other steps.
    tau = (F_c[:, np.newaxis] * J).sum(axis=0)
    tau_e = -(F_e[:, np.newaxis] * J).sum(axis=0)
    return np.concatenate((tau, tau_e))

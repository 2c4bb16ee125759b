"""A robot's tool in task space, (2.6) to (2.13).

The task axes are the first n axes of the world, J the first n rows of Drake's
translational Jacobian Jv_v_WT, and tau_e what the environment's reaction -F_e at the
tool does to the joints:

    v_WT = J qdot,    tau = J^T F_c  (2.11),    tau_e = -J^T F_e  (2.6).

The robot's state is x = [q; qdot]. Each function returns one vector, a port's value.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def tool_kinematics(num_axes: int, p_WT: Array, Jv_v_WT: Array, x: Array) -> Array:
    """Returns [p_WT; v_WT; J row by row] in m and m/s (2n + n nv)."""
    J = Jv_v_WT[:num_axes]
    v_WT = (J * x[x.size - J.shape[1] :]).sum(axis=1)
    return np.concatenate((p_WT[:num_axes], v_WT, J.ravel()))


def joint_torques(F_c: Array, F_e: Array, kinematics: Array) -> Array:
    """Returns [tau; tau_e], (2.11) and (2.6), in N m or N (2 nv)."""
    J = kinematics[2 * F_c.size :].reshape(F_c.size, -1)
    # Not F @ J: BLAS adds in another order than machine code, and error control turns
    # a difference in the last digit into other steps.
    tau = (F_c[:, np.newaxis] * J).sum(axis=0)
    tau_e = -(F_e[:, np.newaxis] * J).sum(axis=0)
    return np.concatenate((tau, tau_e))

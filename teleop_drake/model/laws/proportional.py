"""Position-position teleoperation with damping (P+d): a spring between both ends.

    M dv_m/dt = F_h - K (x_m - x_s) - B v_m,   dx_m/dt = v_m      the master
    F_c       = K (x_m - p) - B_s v                               the slave

with x_s and x_m as received from the other end, and the tool's position p and velocity
v. Vectors are in m, m/s and N (n), K is in N/m, B in N s/m and M in kg (n, n). With six
axes dx_m/dt is position_rate() and x_m - x_s is displacement() of laws.task_space, and
the handle turns like a ball, without gyroscopic moments. The pair is stable for
4 B B_s > (T_f + T_r)^2 K^2.

Sources: D. Lee and M. W. Spong, "Passive bilateral teleoperation with constant time
delay", IEEE Trans. Robotics 22 (2006); E. Nuno, L. Basanez and R. Ortega,
"Passivity-based control for bilateral teleoperation: a tutorial", Automatica 47 (2011).
"""

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.model.laws.task_space import displacement, position_rate


def coupling_force(x_m: Array, x_s: Array, K: Array) -> Array:
    """Returns the force K (x_m - x_s) of the spring on the slave's end, N (n)."""
    return K @ displacement(x_m, x_s)


def master_rate(
    x: Array, F_h: Array, x_s: Array, M: Array, K: Array, B: Array
) -> Array:
    """Returns d/dt [x_m; v_m] of the master in m/s and m/s^2 (2n)."""
    n = F_h.size
    x_m = x[:n]
    v_m = x[n:]
    F = F_h - coupling_force(x_m, x_s, K) - B @ v_m
    return np.concatenate((position_rate(x_m, v_m), np.linalg.solve(M, F)))


def slave_force(x_m: Array, p: Array, v: Array, K: Array, B: Array) -> Array:
    """Returns F_c of the slave in N (n)."""
    return braked_force(coupling_force(x_m, p, K), v, B)


def braked_force(F: Array, v: Array, B: Array) -> Array:
    """Returns a force minus that of a damper to the ground, F - B v, N (n)."""
    return F - damper_force(v, B)


def damper_force(v: Array, B: Array) -> Array:
    """Returns the force B v on a damper to the ground, N (n); see braked_force()."""
    return B @ v


def driven_force(F: Array, v_d: Array, B: Array) -> Array:
    """Returns a force plus that of a damper whose other end moves, F + B v_d, N (n)."""
    return F + B @ v_d


def velocity_error(v: Array, v_d: Array) -> Array:
    """Returns the velocity error v - v_d of the tool in m/s (n)."""
    return v - v_d

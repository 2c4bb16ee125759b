"""Lawrence's four-channel architecture: motion and force travel both ways.

    Z_m V_m = F_h (1 + C6) - C_m V_m - C2 F_e - C4 V_s            the master
    Z_m = M s + B,   C_m = B_c + K_c / s,   C4 = -c4 (Z_m + C_m)
    F_c = C1 V_m + C3 F_h - C_s V_s - C5 F_e                      the slave
    C_s = B_c + K_c / s,   C1 = c1 (Z + C_s),   Z = M s + B

Positions count from `start`. The signals of the other end come in a packet [x; v; F],
or [x; v; F; a] where accelerations are sent: a = w (v - v_f) with dv_f/dt = a, w being
the `bandwidth` in rad/s. The master's state is [x_m; v_m], and v_f behind them then.
The factors are [C2, c4, C6] of the master and [c1, C3, C5] of the slave. Its B is the
handle's and its controller's together. Units are m, s, kg and N (n; n x n).

Sources: D. A. Lawrence, "Stability and transparency in bilateral teleoperation",
IEEE Trans. Robotics and Automation 9 (1993); with C5 and C6, K. Hashtrudi-Zaad and
S. E. Salcudean, "Transparency in time-delayed systems and the effect of local force
feedback for transparent teleoperation", ibid. 18 (2002).
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def filtered_acceleration(v: Array, v_f: Array, bandwidth: float) -> Array:
    """Returns a = w (v - v_f), which is also dv_f/dt, in m/s^2 (n)."""
    return bandwidth * (v - v_f)


def master_rate(
    x: Array,
    F_h: Array,
    packet: Array,
    start: Array,
    M: Array,
    B: Array,
    K_c: Array,
    factors: Array,
    bandwidth: float,
) -> Array:
    """Returns d/dt [x_m; v_m] or d/dt [x_m; v_m; v_f] of the master (2n or 3n)."""
    C2, C4, C6 = factors
    n = F_h.size
    x_m, v_m = x[:n], x[n : 2 * n]
    x_s, v_s, F_e = packet[:n], packet[n : 2 * n], packet[2 * n : 3 * n]
    F = (1 + C6) * F_h - C2 * F_e
    F += K_c @ (C4 * (x_s - start) - (x_m - start))
    F += B @ (C4 * v_s - v_m)
    if x.size == 2 * n:
        return np.concatenate((v_m, np.linalg.solve(M, F)))
    F += C4 * M @ packet[3 * n :]
    a_m = filtered_acceleration(v_m, x[2 * n :], bandwidth)
    return np.concatenate((v_m, np.linalg.solve(M, F), a_m))


def slave_force(
    packet: Array,
    p: Array,
    v: Array,
    F_e: Array,
    start: Array,
    M: Array,
    B: Array,
    B_c: Array,
    K_c: Array,
    factors: Array,
) -> Array:
    """Returns F_c of the slave in N (n)."""
    C1, C3, C5 = factors
    n = p.size
    x_m, v_m, F_h = packet[:n], packet[n : 2 * n], packet[2 * n : 3 * n]
    F: Array = C3 * F_h - C5 * F_e
    F += K_c @ (C1 * (x_m - start) - (p - start))
    F += B_c @ (C1 * v_m - v) + C1 * B @ v_m
    if packet.size > 3 * n:
        F += C1 * M @ packet[3 * n :]
    return F


def master_packet(x: Array, F_h: Array, bandwidth: float) -> Array:
    """Returns what the master sends, [x_m; v_m; F_h], and a_m if it has a filter."""
    n = F_h.size
    if x.size == 2 * n:
        return np.concatenate((x, F_h))
    a_m = filtered_acceleration(x[n : 2 * n], x[2 * n :], bandwidth)
    return np.concatenate((x[: 2 * n], F_h, a_m))


def slave_packet(v_f: Array, p: Array, v: Array, F_e: Array, bandwidth: float) -> Array:
    """Returns what the slave sends, [p; v; F_e], and a if it has a filter."""
    if v_f.size == 0:
        return np.concatenate((p, v, F_e))
    return np.concatenate((p, v, F_e, filtered_acceleration(v, v_f, bandwidth)))

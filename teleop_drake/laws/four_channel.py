"""Lawrence's four-channel architecture: motion and force travel both ways.

    Z_m V_m = F_h (1 + C6) - C_m V_m - C2 F_e - C4 V_s            the master
    Z_m = M s + B,   C_m = B_c + K_c / s,   C4 = -c4 (Z_m + C_m)
    F_c = C1 V_m + C3 F_h - C_s V_s - C5 F_e                      the slave
    C_s = B_c + K_c / s,   C1 = c1 (Z + C_s),   Z = M s + B

Positions count from `start`. The signals of the other end come in a packet [x; v; F],
or [x; v; F; a] where accelerations are sent: a = w (v - v_f) with dv_f/dt = a, w being
the `bandwidth` in rad/s. The master's state is [x_m; v_m], and v_f behind them then.

Sources: D. A. Lawrence, "Stability and transparency in bilateral teleoperation",
IEEE Trans. Robotics and Automation 9 (1993); with C5 and C6, K. Hashtrudi-Zaad and
S. E. Salcudean, "Transparency in time-delayed systems and the effect of local force
feedback for transparent teleoperation", ibid. 18 (2002).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Station(NamedTuple):
    """One end of the architecture.

    Attributes:
        mass: M in kg (n, n), of the handle or of the model of the robot.
        damping: B in N s/m (n, n).
        local_damping: B_c in N s/m (n, n).
        local_stiffness: K_c in N/m (n, n).
        start: Position at time 0 in m (n).
        motion: c4 of the master, c1 of the slave: share of the other end's motion.
        force: C2 or C3, share of the other end's force.
        local_force: C6 or C5, share of the own force.
        bandwidth: w in rad/s; 0: no accelerations.
    """

    mass: Array
    damping: Array
    local_damping: Array
    local_stiffness: Array
    start: Array
    motion: float
    force: float
    local_force: float
    bandwidth: float = 0.0


def filtered_acceleration(station: Station, v: Array, v_f: Array) -> Array:
    """Returns a = w (v - v_f), which is also dv_f/dt, in m/s^2 (n)."""
    return station.bandwidth * (v - v_f)


def master_rate(station: Station, x: Array, F_h: Array, packet: Array) -> Array:
    """Returns d/dt [x_m; v_m] or d/dt [x_m; v_m; v_f] of the master (2n or 3n)."""
    M, start, C4 = station.mass, station.start, station.motion
    n = F_h.size
    x_m, v_m = x[:n], x[n : 2 * n]
    x_s, v_s, F_e = packet[:n], packet[n : 2 * n], packet[2 * n : 3 * n]
    F = (1 + station.local_force) * F_h - station.force * F_e
    F += station.local_stiffness @ (C4 * (x_s - start) - (x_m - start))
    # The handle's own damping and the controller's act on the same velocity.
    F += (station.damping + station.local_damping) @ (C4 * v_s - v_m)
    if x.size == 2 * n:
        return np.concatenate((v_m, np.linalg.solve(M, F)))
    F += C4 * M @ packet[3 * n :]
    a_m = filtered_acceleration(station, v_m, x[2 * n :])
    return np.concatenate((v_m, np.linalg.solve(M, F), a_m))


def slave_force(
    station: Station, packet: Array, p: Array, v: Array, F_e: Array
) -> Array:
    """Returns F_c of the slave in N (n)."""
    start, C1 = station.start, station.motion
    n = p.size
    x_m, v_m, F_h = packet[:n], packet[n : 2 * n], packet[2 * n : 3 * n]
    F: Array = station.force * F_h - station.local_force * F_e
    F += station.local_stiffness @ (C1 * (x_m - start) - (p - start))
    F += station.local_damping @ (C1 * v_m - v) + C1 * station.damping @ v_m
    if packet.size > 3 * n:
        F += C1 * station.mass @ packet[3 * n :]
    return F


def master_packet(station: Station, x: Array, F_h: Array) -> Array:
    """Returns what the master sends, [x_m; v_m; F_h], and a_m if it has a filter."""
    n = F_h.size
    if x.size == 2 * n:
        return np.concatenate((x, F_h))
    a_m = filtered_acceleration(station, x[n : 2 * n], x[2 * n :])
    return np.concatenate((x[: 2 * n], F_h, a_m))


def slave_packet(station: Station, v_f: Array, p: Array, v: Array, F_e: Array) -> Array:
    """Returns what the slave sends, [p; v; F_e], and a if it has a filter."""
    if v_f.size == 0:
        return np.concatenate((p, v, F_e))
    return np.concatenate((p, v, F_e, filtered_acceleration(station, v, v_f)))

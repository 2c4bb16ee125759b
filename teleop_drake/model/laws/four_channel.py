"""Lawrence's four-channel architecture: motion and force travel both ways.

    (M s + B) V_m = F_h (1 + C6) - C_m V_m - C2 F_e - C4 V_s      the master
    C_m = B_c + K_c / s,   C4 = -c4 (B + C_m)
    F_c = C1 V_m + C3 F_h - C_s V_s - C5 F_e                      the slave
    C_s = B_c + K_c / s,   C1 = c1 (B + C_s)

Accelerations are not measured, as in Lawrence's practical form; his ideal C1 and C4
also contain the masses. Positions are relative to `start`. The signals of the other end
arrive in a packet [x; v; F]. The master's state is [x_m; v_m]. With six axes,
laws.task_space defines differences of positions and their rates.

Sources: D. A. Lawrence, "Stability and transparency in bilateral teleoperation",
IEEE Trans. Robotics and Automation 9 (1993); with C5 and C6, K. Hashtrudi-Zaad and
S. E. Salcudean, "Transparency in time-delayed systems and the effect of local force
feedback for transparent teleoperation", ibid. 18 (2002).
"""

from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.model.laws.task_space import displacement, position_rate


class Station(NamedTuple):
    """One end of the architecture.

    Attributes:
        damping: B in N s/m (n, n), of the master's handle or of the robot's model.
        local_damping: B_c in N s/m (n, n).
        local_stiffness: K_c in N/m (n, n).
        start: Position at time 0 in m (n).
        motion: Factor on the other end's motion: c4 at the master, c1 at the slave.
        force: Factor on the other end's force: C2 at the master, C3 at the slave.
        local_force: Factor on the end's own force: C6 at the master, C5 at the slave.
    """

    damping: Array
    local_damping: Array
    local_stiffness: Array
    start: Array
    motion: float
    force: float
    local_force: float


def master_rate(
    station: Station, M: Array, x: Array, F_h: Array, packet: Array
) -> Array:
    """Returns d/dt [x_m; v_m] of the master (2n).

    Args:
        station: The constants of the master.
        M: Mass of the handle in kg (n, n).
        x: State [x_m; v_m] in m and m/s (2n).
        F_h: Force of the operator in N (n).
        packet: [p; v; F_e] of the slave as received, in m, m/s and N (3n).
    """
    start = station.start
    C4 = station.motion
    n = F_h.size
    x_m = x[:n]
    v_m = x[n:]
    x_s = packet[:n]
    v_s = packet[n : 2 * n]
    F_e = packet[2 * n :]
    F = (1 + station.local_force) * F_h - station.force * F_e
    F -= station.local_stiffness @ _stretch(C4, x_m, x_s, start)
    # The handle's own damping and the controller's act on the same velocity.
    F += (station.damping + station.local_damping) @ (C4 * v_s - v_m)
    return np.concatenate((position_rate(x_m, v_m), np.linalg.solve(M, F)))


def following_rate(
    station: Station, M: Array, x: Array, F_h: Array, packet: Array, v_d: Array
) -> Array:
    """Returns master_rate() with the handle's damper B against v_d in m/s (n)."""
    push = np.linalg.solve(M, station.damping @ v_d)
    rate = master_rate(station, M, x, F_h, packet)
    return rate + np.concatenate((0 * push, push))


def slave_force(
    station: Station, packet: Array, p: Array, v: Array, F_e: Array
) -> Array:
    """Returns the control force F_c of the slave in N (n).

    Args:
        station: The constants of the slave.
        packet: [x_m; v_m; F_h] of the master as received, in m, m/s and N (3n).
        p: Position of the tool in m (n).
        v: Velocity of the tool in m/s (n).
        F_e: Force the robot exerts on the environment in N (n).
    """
    start = station.start
    C1 = station.motion
    n = p.size
    x_m = packet[:n]
    v_m = packet[n : 2 * n]
    F_h = packet[2 * n :]
    F: Array = station.force * F_h - station.local_force * F_e
    F -= station.local_stiffness @ _stretch(C1, p, x_m, start)
    F += station.local_damping @ (C1 * v_m - v) + C1 * station.damping @ v_m
    return F


def _stretch(share: float, x: Array, other: Array, start: Array) -> Array:
    """Returns (x - start) - share (other - start), the extension of the local spring.

    It is computed as a weighted sum of the displacements from both positions.
    """
    return (1 - share) * displacement(x, start) + share * displacement(x, other)

"""Wave variables: what the two ends of a passive line for velocity and force do.

With the wave impedance b, a symmetric positive definite matrix, and S = (2 b)^(1/2),

    u = S^-1 (b v + F)          the wave that goes from the master to the slave
    w = S^-1 (b v - F)          the wave that comes back
    F^T v = (u^T u - w^T w) / 2

Delayed by any constant times, u and w carry no more energy out of the line than went
in. F > 0 and v > 0 mean power from the master to the slave at either end. Velocities v
are in m/s, forces F in N, waves in W^(1/2) (n), the root S in (N s/m)^(1/2) and a
damper D in N s/m (n, n).

The functions take arrays of any dtype, so that phasors show the frequency response.

Sources: R. J. Anderson and M. W. Spong, "Bilateral control of teleoperators with time
delay", IEEE Trans. Automatic Control 34 (1989); G. Niemeyer and J.-J. E. Slotine,
"Stable adaptive teleoperation", IEEE J. Oceanic Engineering 16 (1991).
"""

import math

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.validation import Refuse


def wave_root(b: Array) -> Array:
    """Returns S = (2 b)^(1/2), the symmetric root (n, n) in (N s/m)^(1/2)."""
    values, vectors = np.linalg.eigh(b)
    return np.asarray(vectors @ np.diag(np.sqrt(2 * values)) @ vectors.T)


def master_velocity(force: Array, wave: Array, root: Array, damping: Array) -> Array:
    """Returns the velocity at the master's end, where the operator sets the force.

        v = (b + D)^-1 (F + S w)

    The damper D stands beside the line: the line gets F - D v.
    """
    return np.asarray(np.linalg.solve(root @ root / 2 + damping, force + root @ wave))


def slave_force(velocity: Array, wave: Array, root: Array) -> Array:
    """Returns F = S u - b v at the slave's end, where the robot sets the velocity."""
    return np.asarray(root @ (wave - root @ velocity / 2))


def reflected_wave(velocity: Array, wave: Array, root: Array) -> Array:
    """Returns the wave that leaves an end: u = S v - w, or w = S v - u."""
    return np.asarray(root @ velocity - wave)


def line_power(force: Array, velocity: Array, damping: Array) -> Array:
    """Returns the power that goes into the line at the master's end, W (n)."""
    return (force - damping @ velocity) * velocity


def passive_scaling(max_slope: float) -> float:
    """Returns the largest factor on a wave that keeps a growing delay passive.

    A wave that is delayed by T(t) is stretched by 1 / (1 - dT/dt) in time, and its
    energy with it. The factor f undoes that if f^2 <= 1 - dT/dt.

    Source: R. Lozano, N. Chopra and M. W. Spong, "Passivation of force reflecting
    bilateral teleoperators with time varying delay", Proc. Mechatronics (2002).

    Raises:
        ValueError: If max_slope >= 1.
    """
    if not max_slope < 1:
        Refuse("max_slope", max_slope, "a number < 1 (s/s)")
    return math.sqrt(1 - max(max_slope, 0.0))

"""Wave variables: the two ends of a passive transmission line of velocity and force.

With the wave impedance b, a symmetric positive definite matrix, and S = (2 b)^(1/2),

    u = S^-1 (b v + F)          the wave that goes from the master to the slave
    w = S^-1 (b v - F)          the wave that comes back
    F^T v = (u^T u - w^T w) / 2

With any constant delays of u and w, the line releases no more energy than it has
received. At either end, F > 0 and v > 0 mean power from the master to the slave.
Velocities v are in m/s, forces F in N, waves in W^(1/2) (n), the root S in
(N s/m)^(1/2) and a damper D in N s/m (n, n).

The functions accept arrays of any dtype. With complex phasors they give the frequency
response.

Sources: R. J. Anderson and M. W. Spong, "Bilateral control of teleoperators with time
delay", IEEE Trans. Automatic Control 34 (1989); G. Niemeyer and J.-J. E. Slotine,
"Stable adaptive teleoperation", IEEE J. Oceanic Engineering 16 (1991).
"""

import math

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import Refuse


def wave_root(b: Array) -> Array:
    """Returns S = (2 b)^(1/2), the symmetric root (n, n) in (N s/m)^(1/2)."""
    values, vectors = np.linalg.eigh(b)
    return np.asarray(vectors @ np.diag(np.sqrt(2 * values)) @ vectors.T)


def master_velocity(force: Array, wave: Array, root: Array, damping: Array) -> Array:
    """Returns the velocity at the master's end, where the operator sets the force.

        v = (b + D)^-1 (F + S w)

    The damper D is in parallel to the line, which receives the force F - D v.
    """
    return np.asarray(np.linalg.solve(root @ root / 2 + damping, force + root @ wave))


def slave_force(velocity: Array, wave: Array, root: Array) -> Array:
    """Returns F = S u - b v at the slave's end, where the robot sets the velocity."""
    return np.asarray(root @ (wave - root @ velocity / 2))


def reflected_wave(velocity: Array, wave: Array, root: Array) -> Array:
    """Returns the wave that leaves an end: u = S v - w, or w = S v - u."""
    return np.asarray(root @ velocity - wave)


def line_power(force: Array, velocity: Array, damping: Array) -> Array:
    """Returns the power into the line at the master's end on each axis, W (n)."""
    return (force - damping @ velocity) * velocity


def passive_scaling(max_slope: float) -> float:
    """Returns the largest factor on a wave with which a growing delay is passive.

    A delay T(t) stretches a wave by 1 / (1 - dT/dt) in time and increases its energy by
    the same ratio. A factor f compensates for this if f^2 <= 1 - dT/dt.

    Source: R. Lozano, N. Chopra and M. W. Spong, "Passivation of force reflecting
    bilateral teleoperators with time varying delay", Proc. Mechatronics (2002).

    Args:
        max_slope: The largest dT/dt, < 1.

    Raises:
        ValueError: If max_slope >= 1.
    """
    if not max_slope < 1:
        Refuse("max_slope", max_slope, "a number < 1 (s/s)")
    return math.sqrt(1 - max(max_slope, 0.0))

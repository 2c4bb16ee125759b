"""The operator's intentions: a velocity until contact is felt, then a force (2.5).

    mode 0, velocity: v_d = velocity, F_h = force of the haptic device
    mode 1, force:    v_d = 0,        F_h = contact_force
    mode 2, stopped:  v_d = 0,        F_h = 0 if contact was perceived, otherwise that
                                      of the haptic device, which brakes the tool

What the operator knows is kept as two numbers, [contact perceived, stopped], 0 or 1.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def operator_mode(state: Array) -> float:
    """Returns the mode."""
    return 2.0 if state[1] else state[0]


def velocity_command(state: Array, velocity: Array) -> Array:
    """Returns v_d in m/s (n)."""
    return velocity if operator_mode(state) == 0 else np.zeros_like(velocity)


def force_command(state: Array, haptic_force: Array, contact_force: Array) -> Array:
    """Returns F_h in N (n)."""
    if not state[0]:
        return haptic_force
    return np.zeros_like(contact_force) if state[1] else contact_force

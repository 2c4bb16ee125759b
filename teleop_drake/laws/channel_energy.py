"""Power at the two ends of the communication.

    power_in = F_m . v_m          power_out = F_s . v_s

At the master a force F_m is sent while a velocity v_m is felt: F_m . v_m goes into the
channels. At the slave a force F_s arrives while the tool moves with v_s: F_s . v_s
comes out of them.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def port_power(force: Array, velocity: Array) -> float:
    """Returns F . v at one end, W."""
    return np.sum(force * velocity)


def energy_rates(F_m: Array, v_m: Array, F_s: Array, v_s: Array) -> Array:
    """Returns [d(energy_in)/dt; d(energy_out)/dt] in W (2)."""
    return np.array([port_power(F_m, v_m), port_power(F_s, v_s)])


def port_power_vector(force: Array, velocity: Array) -> Array:
    """Returns port_power() as a vector."""
    return np.array([port_power(force, velocity)])


def difference(of_two: Array) -> Array:
    """Returns the first of two numbers minus the second, as a vector."""
    return np.array([of_two[0] - of_two[1]])

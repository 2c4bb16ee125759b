"""Raw delays as two-ports, and whether a two-port is passive.

See teleop_drake.model.laws.two_port for the matrices, and for the sources.
"""

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array, ComplexArray


def delay_two_port(
    frequencies: ArrayLike, *, forward_delay: float, return_delay: float
) -> ComplexArray:
    """Returns the matrix (2) of raw delays; see laws.two_port (K, 2, 2).

    With the names of the ports exchanged it is also the hybrid matrix of channels that
    carry the velocity forward and the force back.

    Args:
        frequencies: w in rad/s (K).
        forward_delay: T_f in s, >= 0.
        return_delay: T_r in s, >= 0.
    """
    w = np.asarray(frequencies, dtype=float).reshape(-1)
    matrix = np.zeros((len(w), 2, 2), dtype=complex)
    matrix[:, 0, 1] = -np.exp(-1j * w * return_delay)
    matrix[:, 1, 0] = np.exp(-1j * w * forward_delay)
    return matrix


def scattering_norm(matrix: ArrayLike) -> Array:
    """Returns the largest singular value of the scattering matrix at each w (K).

        S = (p - 1)(p + 1)^-1   with an impedance of 1 N s/m

    A two-port is passive if and only if this is at most 1 at all w. For a raw delay T
    in both directions it is |tan w T| + |sec w T|, which has no bound.

    Source: Anderson and Spong (1989), there for the hybrid matrix.

    Args:
        matrix: p(j w), a hybrid or inverse hybrid matrix (K, 2, 2).
    """
    p, identity = np.asarray(matrix, dtype=complex), np.eye(2)
    norms = np.full(len(p), np.inf)
    is_regular = np.abs(np.linalg.det(p + identity)) > 1e-14
    S = (p[is_regular] - identity) @ np.linalg.inv(p[is_regular] + identity)
    norms[is_regular] = np.linalg.norm(S, ord=2, axis=(1, 2))
    return norms

"""Channels as a two-port of force and velocity, and its absolute stability.

On one axis a two-port is described by its hybrid matrix h(j w),

    [F_m; -v_s] = [h11, h12; h21, h22] [v_m; F_s]                                (1)

with force F_m and velocity v_m at the operator's side (port m), and F_s and v_s at the
environment's side (port s). The power into port m is F_m v_m, the power into port s is
-F_s v_s. Ideal transparency is h = [0, 1; -1, 0].

The thesis's channels carry the force forward and the velocity back, so that (1) would
be non-causal: a prediction. Their causal form is the inverse hybrid matrix g,

    [v_m; F_s] = g [F_m; -v_s] = [0, -e^(-s T_r); e^(-s T_f), 0] [F_m; -v_s]     (2)

The functions below accept either matrix, because power is F v at the ports of both.

Sources: B. Hannaford, "A design framework for teleoperators with kinesthetic
feedback", IEEE Trans. Robot. Autom. 5 (1989); R. J. Anderson and M. W. Spong,
"Bilateral control of teleoperators with time delay", IEEE Trans. Autom. Control 34
(1989); D. A. Lawrence, "Stability and transparency in bilateral teleoperation", IEEE
Trans. Robot. Autom. 9 (1993).
"""

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array


def llewellyn(matrix: ArrayLike) -> Array:
    """Returns Llewellyn's stability parameter at each frequency (K).

        eta = (2 Re p11 Re p22 - Re(p12 p21))/|p12 p21|

    A two-port without unstable poles is absolutely stable if and only if at all w

        Re p11 >= 0,  Re p22 >= 0  and  eta >= 1.

    Absolutely stable means stable with every passive operator and every passive
    environment. The parameter is -inf where Re p11 or Re p22 is negative. It is +inf
    where both are not negative and p12 p21 = 0, so that there is no loop through both
    ports.

    Source: F. B. Llewellyn, "Some fundamental properties of transmission systems",
    Proc. IRE 40 (1952).

    Args:
        matrix: p(j w), an impedance, admittance, hybrid or inverse hybrid matrix
            (K, 2, 2).
    """
    p = np.asarray(matrix, dtype=complex)
    product = p[:, 0, 1] * p[:, 1, 0]
    resistance = 2 * p[:, 0, 0].real * p[:, 1, 1].real
    with np.errstate(divide="ignore", invalid="ignore"):
        eta = (resistance - product.real) / np.abs(product)
    eta = np.where(product == 0, np.inf, eta)
    is_active = (p[:, 0, 0].real < 0) | (p[:, 1, 1].real < 0)
    return np.where(is_active, -np.inf, eta)

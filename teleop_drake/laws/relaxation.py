"""Force of tissue that relaxes: the standard linear solid.

A spring k beside a Maxwell branch, a spring k_1 in line with a dashpot k_1 tau:

    F = k d + k_1 (d - z),    dz/dt = (d - z)/tau

with the indentation d and the way z of the dashpot. A step to d gives the force
(k + k_1 exp(-t/tau)) d. The surface of the tissue has no mass and does not stick: it
follows a tool that withdraws as fast as it can, and that is where F = 0, at the
indentation d_0 = k_1 z/(k + k_1). A tool in front of that feels nothing, and z follows
from d_0 in the place of d.

Below, `solid` is [k in N/m >= 0, k_1 in N/m > 0, tau in s > 0], `creep` is z in m (1),
`plane` a point of the undeformed surface in m and its unit normal into the material
(2, n), and p_WT the position of the tool in m (n).

The energy k d^2/2 + k_1 (d - z)^2/2 is never negative and grows by no more than the
tool's power: the tissue is passive.

Source: Y. C. Fung, "Biomechanics: Mechanical Properties of Living Tissues", Springer
(1993), section 2.11.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def indentation(solid: Array, creep: Array, plane: Array, p_WT: Array) -> float:
    """Returns d in m, of the tissue under the tool or of its free surface."""
    free: float = solid[1] * creep[0] / (solid[0] + solid[1])
    depth: float = np.sum((p_WT - plane[0]) * plane[1])
    return max(depth, free)


def solid_force(solid: Array, creep: Array, plane: Array, p_WT: Array) -> Array:
    """Returns the force of a tool on the tissue in N (n)."""
    d = indentation(solid, creep, plane, p_WT)
    F_n = solid[0] * d + solid[1] * (d - creep[0])
    F_e: Array = F_n * plane[1]
    return F_e


def creep_rate(solid: Array, creep: Array, plane: Array, p_WT: Array) -> Array:
    """Returns dz/dt in m/s (1)."""
    return np.array([(indentation(solid, creep, plane, p_WT) - creep[0]) / solid[2]])

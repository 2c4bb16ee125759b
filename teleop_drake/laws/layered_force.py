"""Force of layered material on a tool, (2.14) to (2.16)."""

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.laws.task_space import translation


def layered_force(layer: Array, axis: Array, p_WT: Array, v_WT: Array) -> Array:
    """Returns the force in N on the material by a tool (n).

    Equations (2.14) to (2.16), with x taken along an axis, and with the stiffness
    acting from the layer's reference position. Across the axis a spring pulls the tool
    towards it.

    Args:
        layer: Its row of layer_table().
        axis: Its unit vector, and a point on it in m (2, n).
        p_WT: Position of the tool in m (n).
        v_WT: Its velocity in m/s (n).
    """
    along = axis[0]
    point = axis[1]
    _, stiffness, reference, damping, lateral_stiffness = layer
    x = np.sum(p_WT * along)
    v = np.sum(v_WT * along)
    F_x = stiffness * (x - reference) + damping * v
    offset = p_WT - point
    lateral = translation(offset - np.sum(offset * along) * along)
    return F_x * along + lateral_stiffness * lateral


LAYER_COLUMNS = ("start", "stiffness", "reference", "damping", "lateral_stiffness")
"""What a row of layer_table() has, in this order."""


def layer_table(*columns: Array) -> Array:
    """Returns layers as rows of LAYER_COLUMNS."""
    return np.column_stack(columns)

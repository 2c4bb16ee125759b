"""Force of layered material on a tool, (2.14) to (2.16)."""

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.model.laws.task_space import translation


def layered_force(layer: Array, axis: Array, p_WT: Array, v_WT: Array) -> Array:
    """Returns the force of a tool on the material in N (n).

    The force is that of (2.14) to (2.16), with x along an axis and the spring force
    zero at the layer's reference position. A lateral spring pulls the tool towards the
    axis.

    Args:
        layer: The layer's row of layer_table().
        axis: The axis's unit vector, and a point on the axis in m (2, n).
        p_WT: Position of the tool in m (n).
        v_WT: Velocity of the tool in m/s (n).
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
"""The columns of layer_table(), in order."""


def layer_table(*columns: Array) -> Array:
    """Returns the table of layers, a row for each, from the columns LAYER_COLUMNS."""
    return np.column_stack(columns)

"""Force of layered material on a tool, (2.14) to (2.16)."""

import itertools
import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.laws.task_space import translation


class Layer(Protocol):
    """One layer; it reaches from its start to the start of the next one.

    Attributes:
        name: What it is called.
        start: Where it begins along x, in m; -inf for the first is allowed.
        stiffness: k_e in N/m, >= 0.
        damping: d_e in N s/m, >= 0.
        reference: Position in m at which its spring is unloaded.
        lateral_stiffness: k_l in N/m, >= 0, of the spring across x.
    """

    name: str
    start: float
    stiffness: float
    damping: float
    reference: float
    lateral_stiffness: float


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


def layer_columns(layers: Sequence[Layer]) -> dict[str, Array]:
    """Returns the numbers of layers by their names, see LAYER_COLUMNS.

    The first entry is that of the empty space before the layers.

    Args:
        layers: By ascending start.
    """
    return {
        name: np.array(
            [-math.inf if name == "start" else 0.0]
            + [getattr(layer, name) for layer in layers]
        )
        for name in LAYER_COLUMNS
    }


def layer_table(*columns: Array) -> Array:
    """Returns layers as rows of LAYER_COLUMNS."""
    return np.column_stack(columns)


def contact_position(layers: Sequence[Layer]) -> float | None:
    """Returns where the tool meets a hard surface (m), None if nowhere.

    That is the start of the stiffest layer, if the layer before it is softer.
    """
    if not layers:
        return None
    i = max(range(len(layers)), key=lambda k: layers[k].stiffness)
    if i == 0 or layers[i - 1].stiffness >= layers[i].stiffness:
        return None
    return layers[i].start


def puncture_position(layers: Sequence[Layer]) -> float | None:
    """Returns where the tool leaves the first layer that yields (m), or None.

    That is the end of the first layer which is followed by a softer one.
    """
    for before, after in itertools.pairwise(layers):
        if after.stiffness < before.stiffness:
            return after.start
    return None

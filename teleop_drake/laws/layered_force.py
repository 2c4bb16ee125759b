"""Force of layered material on a tool, (2.14) to (2.16)."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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


@dataclass
class _EmptySpace:
    name: str = "empty space"
    start: float = -math.inf
    stiffness: float = 0.0
    damping: float = 0.0
    reference: float = 0.0
    lateral_stiffness: float = 0.0


EMPTY_SPACE: Layer = _EmptySpace()
"""The space without any force in front of the first layer."""


def spring_damper_force(
    stiffness: float, reference: float, damping: float, x: float, v: float
) -> float:
    """Returns (2.14), with the stiffness acting from a layer's reference position.

    Args:
        stiffness: k_e in N/m.
        reference: In m.
        damping: d_e in N s/m.
        x: In m.
        v: In m/s.
    """
    return stiffness * (x - reference) + damping * v


def layer_force(layer: Layer, x: float, v: float) -> float:
    """Returns the force in N on a layer by a tool at x (m) with velocity v (m/s).

    Equation (2.14), with the stiffness acting from the layer's reference position:
    f_e = k_e (x - reference) + d_e v.
    """
    return spring_damper_force(layer.stiffness, layer.reference, layer.damping, x, v)


def layered_force(
    layers: Array,
    regions: NDArray[np.int64],
    region: int,
    axis: Array,
    p_WT: Array,
    v_WT: Array,
) -> Array:
    """Returns the force in N on the material by a tool (n).

    Equations (2.14) to (2.16), with the layers of one region only, and x taken along
    an axis. Across the axis a spring pulls the tool towards it.

    Args:
        layers: As layer_table() makes it.
        regions: As layer_regions() makes it.
        region: The region that the tool is in.
        axis: Its unit vector, and a point on it in m (2, n).
        p_WT: Position of the tool in m (n).
        v_WT: Its velocity in m/s (n).
    """
    along, point = axis[0], axis[1]
    x, v = np.sum(p_WT * along), np.sum(v_WT * along)
    row = layer_row(layers, regions, region, x)
    stiffness, reference, damping = layers[row, 1], layers[row, 2], layers[row, 3]
    F_x = spring_damper_force(stiffness, reference, damping, x, v)
    offset = p_WT - point
    lateral = offset - np.sum(offset * along) * along
    F_e: Array = F_x * along + layers[row, 4] * lateral
    return F_e


def layer_row(layers: Array, regions: NDArray[np.int64], region: int, x: float) -> int:
    """Returns the row of the layer at x, or of the one next to x in the region.

    Args:
        layers: As layer_table() makes it.
        regions: As layer_regions() makes it.
        region: The region that the tool is in.
        x: Position of the tool in m; a start belongs to the layer that begins there.
    """
    row = np.searchsorted(layers[:, 0], x, side="right") - 1
    return int(min(max(row, regions[region, 0]), regions[region, 1]))


def layer_table(layers: Sequence[Layer]) -> Array:
    """Returns layers as rows: start, stiffness, reference, damping, lateral stiffness.

    The first row is that of the empty space before the layers.

    Args:
        layers: By ascending start.
    """
    return np.array(
        [
            (
                layer.start,
                layer.stiffness,
                layer.reference,
                layer.damping,
                layer.lateral_stiffness,
            )
            for layer in (EMPTY_SPACE, *layers)
        ]
    )


def layer_regions(layers: Sequence[Layer]) -> NDArray[np.int64]:
    """Returns the first and the last row of layer_table() in each region (k, 2).

    A region is a layer: between two of them the force jumps or bends.

    Args:
        layers: By ascending start.
    """
    # Layers without a beginning leave no empty space before them.
    first = 1 if layers and layers[0].start == -math.inf else 0
    rows = np.arange(first, len(layers) + 1)
    return np.column_stack((rows, rows))


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

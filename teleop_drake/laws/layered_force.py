"""Force of layered material on a tool, (2.14) to (2.16)."""

import itertools
from bisect import bisect_right
from collections.abc import Sequence
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
    """

    name: str
    start: float
    stiffness: float
    damping: float
    reference: float


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


def layered_forces(table: Array, regions: Array, p_WT: Array, v_WT: Array) -> Array:
    """Returns the forces in N, along x only, on the material by M tools (M n).

    Args:
        table: As layer_table() makes it.
        regions: The region of each tool (M), whose layers hold for it; -1 for that of
            the layer at x.
        p_WT: Positions of the tools in m (M n).
        v_WT: Their velocities in m/s (M n).
    """
    F_e = np.zeros(p_WT.size)
    n = p_WT.size // regions.size
    for i in range(regions.size):
        j, region = i * n, int(regions[i])
        x, v = p_WT[j], v_WT[j]
        row = np.searchsorted(table[:, 0], x, side="right") - 1
        if region >= 0:
            row = min(max(row, int(table[region, 4])), int(table[region, 5]))
        stiffness, reference, damping = table[row, 1], table[row, 2], table[row, 3]
        F_e[j] = spring_damper_force(stiffness, reference, damping, x, v)
    return F_e


def layer_table(layers: Sequence[Layer], regions: Sequence[tuple[int, int]]) -> Array:
    """Returns layers and regions for layered_forces().

    Args:
        layers: By ascending start.
        regions: The first and the last layer of each region, -1 for the empty space
            before the layers.

    Returns:
        Rows of start, stiffness, reference and damping, the first one for the empty
        space and then one for each layer; beside them, for each region, its first and
        its last row.
    """
    table = np.zeros((len(layers) + 1, 6))
    table[0, 0] = -np.inf
    for row, layer in enumerate(layers, 1):
        table[row, :4] = layer.start, layer.stiffness, layer.reference, layer.damping
    for row, region in enumerate(regions):
        table[row, 4:] = np.add(region, 1)
    return table


def layer_index(starts: Sequence[float], x: float) -> int:
    """Returns the index of the layer at x, -1 before the first one.

    Args:
        starts: Ascending starts of the layers in m.
        x: Position in m; a start belongs to the layer that begins there.
    """
    return bisect_right(starts, x) - 1


def is_continuous(before: Layer, after: Layer) -> bool:
    """Returns whether the force is continuous where `after` begins.

    At any velocity: the springs meet there and the dampings are equal.
    """
    gap = layer_force(before, after.start, 0.0) - layer_force(after, after.start, 0.0)
    return gap == 0 and before.damping == after.damping


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

"""Force of layered material on a tool, (2.14) to (2.16)."""

import itertools
from bisect import bisect_right
from collections.abc import Sequence
from typing import Protocol


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


def layer_force(layer: Layer, x: float, v: float) -> float:
    """Returns the force in N on a layer by a tool at x (m) with velocity v (m/s).

    Equation (2.14), with the stiffness acting from the layer's reference position:
    f_e = k_e (x - reference) + d_e v.
    """
    return layer.stiffness * (x - layer.reference) + layer.damping * v


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

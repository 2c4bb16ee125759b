"""Environment of the tool: layers of material along an axis."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teleop_drake.environments.surface import (
    CONTACT,
    PUNCTURE,
    Material,
    PlaneSurface,
    Surface,
    UnitNormal,
)
from teleop_drake.kernel import Kernel, KernelBlock, Term, Transition
from teleop_drake.kernel.linear_part import LinearPart
from teleop_drake.laws.layered_force import (
    EMPTY_SPACE,
    Layer,
    contact_position,
    layer_table,
    layered_force,
    puncture_position,
)
from teleop_drake.validation import CheckNumber

Array = NDArray[np.float64]


class LayeredForceField(KernelBlock):
    """Force of the tool on layered material, as the sensor reads it.

        F_e = (k_e (x - reference) + d_e v_x) a + k_l (p - p_axis)   (2.14) to (2.16)

    with x = a . p along the unit vector a, the first axis if no direction is given, and
    the stiffness k_e, damping d_e and reference of the layer at x. The last term is not
    the thesis's: p_axis is the point of an axis along a that is nearest to the tool,
    and k_l the layer's lateral stiffness, 0 unless given. It stands for the tissue that
    holds a needle on its way. Before the first layer there is no force.

    | port | name              | size | unit                                |
    |------|-------------------|------|-------------------------------------|
    | in   | tool_position     | n    | m                                   |
    | in   | tool_velocity     | n    | m/s                                 |
    | out  | environment_force | n    | N, exerted BY the robot             |
    | out  | layer             | 1    | index of the layer at x, -1: before |

    State (discrete, 1): the layer the tool is in, counted from 1; 0: before the first.
    Between two layers the force jumps or bends. If the Context has an accuracy
    (context.SetAccuracy), the instant at which the tool leaves its layer is located and
    the force of a step is that of one layer throughout. A tool on a border is in the
    layer that begins there. Without an accuracy the position alone decides, also in the
    middle of a step: the layer is the kernel's initial mode.

    Initial value: the layer at the initial position.

    Direct feedthrough: from both inputs to environment_force; from tool_position to
    layer.

    It knows no friction, its lateral spring does not stiffen with the depth of the
    needle, and tissue that was punctured is whole again if the tool comes back.

    Args:
        layers: The layers, by ascending start: LayerConfig(name="bone", start=1.1,
            stiffness=150.0, reference=1.1), for instance.
        num_axes: n, number of task axes.
        starts_inside: Whether the tool starts in a layer. The first layer is then
            nothing that it can collide with.
        direction: Along which the layers follow each other, of any length but 0 (n);
            None: along x.
        axis_point: A point in m (n) on the axis that the lateral springs pull to; None:
            the origin.

    Raises:
        ValueError: If the starts do not ascend or a value is not allowed.
    """

    is_compiled = True

    def __init__(
        self,
        *,
        layers: Sequence[Layer],
        num_axes: int,
        starts_inside: bool = False,
        direction: ArrayLike | None = None,
        axis_point: ArrayLike | None = None,
    ):
        KernelBlock.__init__(self)
        _CheckLayers(layers)
        self._surfaces = LayerSurfaces(layers, num_axes, starts_inside, direction)
        point = np.zeros(num_axes) if axis_point is None else axis_point
        table = layer_table(layers)
        starts = table[:, 0]
        self._parameters = {
            "layers": table,
            "axis": np.array([UnitNormal(direction, num_axes), point], dtype=float),
            # The last number before each layer, and where the next one begins.
            "before": np.nextafter(starts, -math.inf),
            "ends": np.array([*starts[1:], math.inf]),
        }
        self.DeclareVectorInputPort("tool_position", num_axes)
        self.DeclareVectorInputPort("tool_velocity", num_axes)
        self.DeclareDiscreteState(1)
        self.DeclareOutputs(environment_force=num_axes, layer=1)

    def Surfaces(self) -> tuple[Surface, ...]:
        """Returns where the layers begin, in their order; see LayerSurfaces."""
        return self._surfaces

    def ForLinearModel(self, estimates: Array | None) -> LinearPart:
        """Returns that the tool stays in its layer."""
        return LinearPart(has_modes=True)

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        here: Term = (layer_at, "layers", "axis", "tool_position")
        guard = (outside, "before", "ends", "axis", "mode", "tool_position")
        has_borders = np.isfinite(self._parameters["ends"]).any()
        leaves = {"leaves_layer": Transition(guard=guard, mode=here)}
        law = ("layers", "axis", "mode", "tool_position", "tool_velocity")
        return Kernel(
            parameters=self._parameters,
            outputs={
                "environment_force": (force_in_layer, *law),
                "layer": (index_of_layer, "mode"),
            },
            initial_mode=here,
            transitions=leaves if has_borders else {},
        )


def force_in_layer(
    layers: Array, axis: Array, mode: Array, p_WT: Array, v_WT: Array
) -> Array:
    """Returns layered_force() in the layer that is the mode, 0 for the empty space."""
    return layered_force(layers[int(mode[0])], axis, p_WT, v_WT)


def index_of_layer(mode: Array) -> Array:
    """Returns the index of the layer, -1 before the first one."""
    return mode - 1.0


def layer_at(layers: Array, axis: Array, p_WT: Array) -> Array:
    """Returns the mode where the tool is; a start belongs to the layer behind it."""
    x = np.sum(p_WT * axis[0])
    return np.array([np.searchsorted(layers[:, 0], x, side="right") - 1.0])


def outside(before: Array, ends: Array, axis: Array, mode: Array, p_WT: Array) -> Array:
    """Returns how far the tool is outside of the layer that is the mode, m.

    Not negative from the end on, and from the last number before the begin back: at
    the begin, the tool is inside.
    """
    x, layer = np.sum(p_WT * axis[0]), int(mode[0])
    return np.array([max(x - ends[layer], before[layer] - x)])


def LayerSurfaces(
    layers: Sequence[Layer],
    num_axes: int,
    starts_inside: bool,
    direction: ArrayLike | None = None,
) -> tuple[Surface, ...]:
    """Returns the surfaces at which layers begin, in their order.

    Where the stiffest layer begins behind a softer one or behind empty space is
    CONTACT; where the first layer ends that a softer one follows is PUNCTURE. The other
    surfaces have the name of the layer that begins there. A layer with lateral
    stiffness is more than the one spring and damper that a Material is.

    Args:
        layers: By ascending start.
        starts_inside: Whether the tool starts in a layer, so that there is no empty
            space in front of the first one.
        direction: Along which they follow each other (n); None: along x.
    """
    starts_inside |= bool(layers) and layers[0].start == -math.inf
    behind = [] if starts_inside else [EMPTY_SPACE]
    names = {
        puncture_position(layers): PUNCTURE,
        contact_position([*behind, *layers]): CONTACT,
    }
    normal_W = UnitNormal(direction, num_axes)
    return tuple(
        PlaneSurface(
            names.get(layer.start, _OwnName(layer)),
            layer.start,
            normal_W,
            None if layer.lateral_stiffness else _MaterialOf(layer),
        )
        for layer in layers
    )


def _MaterialOf(layer: Layer) -> Material:
    return Material(
        name=layer.name,
        stiffness=layer.stiffness,
        damping=layer.damping,
        relaxed=layer.reference,
    )


def _OwnName(layer: Layer) -> str:
    """Returns the name of a layer, told from those of the two special surfaces."""
    is_special = layer.name in (CONTACT, PUNCTURE)
    return f"layer {layer.name}" if is_special else layer.name


def CheckLayerValues(path: str, layer: Layer) -> None:
    """Checks what a layer is made of.

    Args:
        path: Its place in a scenario, for messages.

    Raises:
        ScenarioError: Naming the first bad field, its value and what is allowed.
    """
    CheckNumber(f"{path}.stiffness", layer.stiffness, "N/m", minimum=0)
    CheckNumber(f"{path}.damping", layer.damping, "N s/m", minimum=0)
    CheckNumber(f"{path}.reference", layer.reference, "m")
    lateral = f"{path}.lateral_stiffness"
    CheckNumber(lateral, layer.lateral_stiffness, "N/m", minimum=0)


def _CheckLayers(layers: Sequence[Layer]) -> None:
    for i, layer in enumerate(layers):
        path = f"layers.{layer.name}"
        CheckLayerValues(path, layer)
        if i > 0:
            CheckNumber(
                f"{path}.start", layer.start, "m", above=float(layers[i - 1].start)
            )

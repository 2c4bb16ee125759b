"""Environment of the tool: layers of material along an axis."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    Event,
    EventStatus,
    LeafSystem,
    State,
    UnrestrictedUpdateEvent,
    WitnessFunction,
    WitnessFunctionDirection,
)

from teleop_drake.environments.surface import (
    CONTACT,
    PUNCTURE,
    Material,
    PlaneSurface,
    Surface,
    UnitNormal,
)
from teleop_drake.kernel import Kernel, Transition
from teleop_drake.kernel.callbacks import Weakly
from teleop_drake.kernel.linear_part import LinearPart
from teleop_drake.laws.layered_force import (
    EMPTY_SPACE,
    Layer,
    contact_position,
    layer_regions,
    layer_row,
    layer_table,
    layered_force,
    puncture_position,
)
from teleop_drake.machine_code.compiled import CompileLaw
from teleop_drake.validation import CheckNumber

Array = NDArray[np.float64]
Regions = NDArray[np.int64]


class LayeredForceField(LeafSystem):
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

    State (discrete, 1): the region the tool is in. A region is a run of layers in
    which the force is continuous; between two regions it jumps. If the Context has
    an accuracy (context.SetAccuracy), the instant at which the tool crosses into
    another region is located by a witness function and the force of a step is
    computed with the law of one region throughout. A position that jumps is looked at
    at the end of each step. A tool on a border is in the region that begins there.
    Without an accuracy the position
    alone decides, also in the middle of a step. A non-smooth point, such as
    touching an undamped spring, needs no event: error control handles it.

    Initial value: the region at the initial position.

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

    def __init__(
        self,
        *,
        layers: Sequence[Layer],
        num_axes: int,
        starts_inside: bool = False,
        direction: ArrayLike | None = None,
        axis_point: ArrayLike | None = None,
    ):
        LeafSystem.__init__(self)
        _CheckLayers(layers)
        self._surfaces = LayerSurfaces(layers, num_axes, starts_inside, direction)
        point = np.zeros(num_axes) if axis_point is None else axis_point
        self._axis = np.array([UnitNormal(direction, num_axes), point], dtype=float)
        self._layers = layer_table(layers)
        self._regions = layer_regions(layers)
        # Where no region is kept, the position alone decides: all layers are in one.
        everywhere = np.array([[0, len(layers)]])
        self._laws_anywhere, self._laws = (
            [
                CompileLaw(law, self._layers, regions, self._axis)
                for law in (force_in_region, layer_in_region)
            ]
            for regions in (everywhere, self._regions)
        )
        # The last number before each region, and where the next one begins.
        boundaries = self._layers[self._regions[1:, 0], 0]
        self._before = np.array([-math.inf, *np.nextafter(boundaries, -math.inf)])
        self._ends = np.array([*boundaries, math.inf])

        self._p = self.DeclareVectorInputPort("tool_position", num_axes)
        self._v = self.DeclareVectorInputPort("tool_velocity", num_axes)
        self._region = self.DeclareDiscreteState(1)
        region = {self.xd_ticket(), self.accuracy_ticket()}
        self.DeclareVectorOutputPort(
            "environment_force",
            num_axes,
            self._CalcForce,
            prerequisites_of_calc={self._p.ticket(), self._v.ticket(), *region},
        )
        self.DeclareVectorOutputPort(
            "layer",
            1,
            self._CalcLayer,
            prerequisites_of_calc={self._p.ticket(), *region},
        )
        self.DeclareInitializationUnrestrictedUpdateEvent(self._SetRegion)
        self.DeclarePerStepDiscreteUpdateEvent(self._CheckRegion)
        enters_next = self.MakeWitnessFunction(
            "enters_next_region",
            WitnessFunctionDirection.kNegativeThenNonNegative,
            Weakly(self._CalcPastEnd),
            UnrestrictedUpdateEvent(Weakly(self._EnterRegion)),
        )
        enters_previous = self.MakeWitnessFunction(
            "enters_previous_region",
            WitnessFunctionDirection.kNegativeThenNonNegative,
            Weakly(self._CalcBeforeBegin),
            UnrestrictedUpdateEvent(Weakly(self._EnterRegion)),
        )
        # By the region: there is nothing before the first and behind the last.
        last = len(self._regions) - 1
        self._witnesses = [
            [enters_next] * (region < last) + [enters_previous] * (region > 0)
            for region in range(last + 1)
        ]

    def Surfaces(self) -> tuple[Surface, ...]:
        """Returns where the layers begin, in their order; see LayerSurfaces."""
        return self._surfaces

    def ForLinearModel(self, estimates: Array | None) -> LinearPart:
        """Returns that the tool stays in its layer.

        Args:
            estimates: Has no effect.
        """
        return LinearPart(has_modes=True)

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        law = ("layers", "regions", "axis", "mode", "tool_position")
        return Kernel(
            parameters={
                "layers": self._layers,
                "regions": self._regions,
                "axis": self._axis,
                "before": self._before,
                "ends": self._ends,
            },
            outputs={
                "environment_force": (force_in_region, *law, "tool_velocity"),
                "layer": (layer_in_region, *law),
            },
            transitions={
                "enters_next_region": Transition(
                    guard=(past_end, "ends", "mode", "axis", "tool_position"),
                    mode=(next_region, "mode"),
                ),
                "enters_previous_region": Transition(
                    guard=(before_begin, "before", "mode", "axis", "tool_position"),
                    mode=(previous_region, "mode"),
                ),
            },
        )

    def _GetRegion(self, context: Context) -> int:
        return int(context.get_discrete_state_vector().GetAtIndex(0))

    def _Evaluate(self, index: int, context: Context, *motion: Array) -> Array:
        """Returns what a law, force or layer, gives in the region that holds now."""
        if context.get_accuracy() is None:
            return self._laws_anywhere[index](np.zeros(1), *motion)
        return self._laws[index](context.get_discrete_state_vector().value(), *motion)

    def _CalcForce(self, context: Context, output: BasicVector) -> None:
        motion = self._p.Eval(context), self._v.Eval(context)
        output.SetFromVector(self._Evaluate(0, context, *motion))

    def _CalcLayer(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._Evaluate(1, context, self._p.Eval(context)))

    def DoGetWitnessFunctions(self, context: Context) -> list[WitnessFunction]:
        """Returns the boundaries of the region, if events are to be located."""
        if context.get_accuracy() is None:
            return []
        return self._witnesses[self._GetRegion(context)]

    def _CalcPastEnd(self, context: Context) -> float:
        mode = context.get_discrete_state_vector().value()
        return past_end(self._ends, mode, self._axis, self._p.Eval(context)).item()

    def _CalcBeforeBegin(self, context: Context) -> float:
        mode = context.get_discrete_state_vector().value()
        position = self._p.Eval(context)
        return before_begin(self._before, mode, self._axis, position).item()

    def _RegionAtTool(self, context: Context) -> int:
        x = np.sum(self._p.Eval(context) * self._axis[0])
        return int(np.searchsorted(self._ends, x, side="right"))

    def _SetRegion(self, context: Context, state: State) -> None:
        region = self._RegionAtTool(context)
        state.get_mutable_discrete_state(self._region).SetAtIndex(0, region)

    def _EnterRegion(self, context: Context, event: Event, state: State) -> None:
        self._SetRegion(context, state)

    def _CheckRegion(self, context: Context, values: DiscreteValues) -> EventStatus:
        region = self._RegionAtTool(context)
        if context.get_accuracy() is None or region == self._GetRegion(context):
            return EventStatus.DidNothing()
        values.get_mutable_vector(self._region).SetAtIndex(0, region)
        return EventStatus.Succeeded()


def force_in_region(
    layers: Array, regions: Regions, axis: Array, mode: Array, p_WT: Array, v_WT: Array
) -> Array:
    """Returns layered_force() in the region that is the mode."""
    return layered_force(layers, regions, int(mode[0]), axis, p_WT, v_WT)


def layer_in_region(
    layers: Array, regions: Regions, axis: Array, mode: Array, p_WT: Array
) -> Array:
    """Returns the index of the layer at the tool, -1 before the first one."""
    x = np.sum(p_WT * axis[0])
    return np.array([layer_row(layers, regions, int(mode[0]), x) - 1.0])


def past_end(ends: Array, mode: Array, axis: Array, p_WT: Array) -> Array:
    """Returns how far the tool is behind the end of its region, m."""
    return np.array([np.sum(p_WT * axis[0]) - ends[int(mode[0])]])


def before_begin(before: Array, mode: Array, axis: Array, p_WT: Array) -> Array:
    """Returns how far the tool is before the begin of its region, m.

    Not negative from the last number before it: at the begin, the tool is inside.
    """
    return np.array([before[int(mode[0])] - np.sum(p_WT * axis[0])])


def next_region(mode: Array) -> Array:
    """Returns the mode in the next region."""
    return mode + 1


def previous_region(mode: Array) -> Array:
    """Returns the mode in the previous region."""
    return mode - 1


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
        num_axes: n, number of task axes.
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
        layer: The layer.

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

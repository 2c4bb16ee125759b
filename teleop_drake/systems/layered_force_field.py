"""Environment of the tool: layers of material along x."""

import math
from collections.abc import Sequence

from pydrake.systems.framework import (
    BasicVector,
    Context,
    Event,
    LeafSystem,
    State,
    UnrestrictedUpdateEvent,
    WitnessFunction,
    WitnessFunctionDirection,
)

from teleop_drake.laws.layered_force import (
    Layer,
    is_continuous,
    layer_force,
    layer_index,
)


class LayeredForceField(LeafSystem):
    """Force of the tool on layered material, as the sensor reads it.

        F_e = [k_e (x - reference) + d_e v_x, 0, ...]      (2.14) to (2.16)

    with the stiffness k_e, damping d_e and reference of the layer at x. Before the
    first layer there is no force.

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
    computed with the law of one region throughout. Without an accuracy the position
    alone decides, also in the middle of a step. A kink, such as touching an undamped
    spring, needs no event: error control handles it.

    Initial value: the region at the initial position.

    Direct feedthrough: from both inputs to environment_force; from tool_position to
    layer.

    It does not act along other axes than x, knows no friction, and tissue that was
    punctured is whole again if the tool comes back.

    Args:
        layers: The layers, by ascending start; see laws.layered_force.Layer.
        num_axes: n, number of task axes.

    Raises:
        ValueError: If the starts do not ascend or a value is not allowed.
    """

    def __init__(self, *, layers: Sequence[Layer], num_axes: int):
        LeafSystem.__init__(self)
        _CheckLayers(layers)
        self._layers = list(layers)
        self._starts = [layer.start for layer in layers]
        # The first layer of each region; -1 is the empty space before the layers.
        first_layers = [0 if layers and layers[0].start == -math.inf else -1]
        for i in range(first_layers[0] + 1, len(layers)):
            before = self._layers[i - 1] if i > 0 else _Nothing()
            if not is_continuous(before, self._layers[i]):
                first_layers.append(i)
        self._first_layers = first_layers
        self._last_layers = [i - 1 for i in first_layers[1:]] + [len(layers) - 1]
        # Where each region begins and ends.
        borders = [self._starts[i] for i in first_layers[1:]]
        self._begins = [-math.inf, *borders]
        self._ends = [*borders, math.inf]

        self._p = self.DeclareVectorInputPort("tool_position", num_axes)
        self._v = self.DeclareVectorInputPort("tool_velocity", num_axes)
        self._region = self.DeclareDiscreteState(1)
        self.DeclareVectorOutputPort(
            "environment_force",
            num_axes,
            self._CalcForce,
            prerequisites_of_calc={
                self._p.ticket(),
                self._v.ticket(),
                self.xd_ticket(),
                self.accuracy_ticket(),
            },
        )
        self.DeclareVectorOutputPort(
            "layer",
            1,
            self._CalcLayer,
            prerequisites_of_calc={
                self._p.ticket(),
                self.xd_ticket(),
                self.accuracy_ticket(),
            },
        )
        self.DeclareInitializationUnrestrictedUpdateEvent(self._SetRegion)
        enters_next = self.MakeWitnessFunction(
            "enters_next_region",
            WitnessFunctionDirection.kNegativeThenNonNegative,
            self._CalcPastEnd,
            UnrestrictedUpdateEvent(self._EnterNextRegion),
        )
        enters_previous = self.MakeWitnessFunction(
            "enters_previous_region",
            WitnessFunctionDirection.kPositiveThenNonPositive,
            self._CalcPastStart,
            UnrestrictedUpdateEvent(self._EnterPreviousRegion),
        )
        # By the region: there is nothing before the first and behind the last.
        self._witnesses = [
            [enters_next] * (region < len(first_layers) - 1)
            + [enters_previous] * (region > 0)
            for region in range(len(first_layers))
        ]

    def _RegionAt(self, x: float) -> int:
        return layer_index(self._first_layers, layer_index(self._starts, x))

    def _LayerIndex(self, context: Context, x: float) -> int:
        if context.get_accuracy() is None:
            return layer_index(self._starts, x)
        region = self._GetRegion(context)
        first, last = self._first_layers[region], self._last_layers[region]
        if first == last:
            return first
        return min(max(layer_index(self._starts, x), first), last)

    def _GetRegion(self, context: Context) -> int:
        return int(context.get_discrete_state_vector().GetAtIndex(0))

    def _CalcForce(self, context: Context, output: BasicVector) -> None:
        x = self._p.Eval(context).item(0)
        index = self._LayerIndex(context, x)
        output.SetZero()
        if index >= 0:
            v_x = self._v.Eval(context).item(0)
            output.SetAtIndex(0, layer_force(self._layers[index], x, v_x))

    def _CalcLayer(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._LayerIndex(context, self._p.Eval(context).item(0)))

    def DoGetWitnessFunctions(self, context: Context) -> list[WitnessFunction]:
        """Returns the boundaries of the region, if events are to be located."""
        if context.get_accuracy() is None:
            return []
        return self._witnesses[self._GetRegion(context)]

    def _CalcPastEnd(self, context: Context) -> float:
        return self._p.Eval(context).item(0) - self._ends[self._GetRegion(context)]

    def _CalcPastStart(self, context: Context) -> float:
        return self._p.Eval(context).item(0) - self._begins[self._GetRegion(context)]

    def _SetRegion(self, context: Context, state: State) -> None:
        region = self._RegionAt(self._p.Eval(context).item(0))
        state.get_mutable_discrete_state(self._region).SetAtIndex(0, region)

    def _EnterNextRegion(self, context: Context, event: Event, state: State) -> None:
        self._MoveBy(1, context, state)

    def _EnterPreviousRegion(
        self, context: Context, event: Event, state: State
    ) -> None:
        self._MoveBy(-1, context, state)

    def _MoveBy(self, change: int, context: Context, state: State) -> None:
        region = self._GetRegion(context) + change
        state.get_mutable_discrete_state(self._region).SetAtIndex(0, region)


class _Nothing:
    name = "nothing"
    start = -math.inf
    stiffness = 0.0
    damping = 0.0
    reference = 0.0


def _CheckLayers(layers: Sequence[Layer]) -> None:
    for i, layer in enumerate(layers):
        for name in ("stiffness", "damping"):
            value = getattr(layer, name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(
                    f"layers.{layer.name}.{name}: {value}; allowed: a finite number "
                    ">= 0"
                )
        if not math.isfinite(layer.reference):
            raise ValueError(
                f"layers.{layer.name}.reference: {layer.reference}; allowed: a finite "
                "number (m)"
            )
        if i > 0 and not layers[i - 1].start < layer.start < math.inf:
            raise ValueError(
                f"layers.{layer.name}.start: {layer.start}; allowed: more than "
                f"{layers[i - 1].start} m, where layer {layers[i - 1].name!r} starts"
            )

"""Environment of the tool: layers of material along x."""

import math
from collections.abc import Sequence

import numpy as np
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
    layer_index,
    layer_table,
    layered_forces,
)
from teleop_drake.numerics.compiled import compiled


class LayeredForceField(LeafSystem):
    """Force of the tool on layered material, as the sensor reads it.

        F_e = [k_e (x - reference) + d_e v_x, 0, ...]      (2.14) to (2.16)

    with the stiffness k_e, damping d_e and reference of the layer at x. Before the
    first layer there is no force.

    | port | name              | size | unit                                |
    |------|-------------------|------|-------------------------------------|
    | in   | tool_position     | M n  | m                                   |
    | in   | tool_velocity     | M n  | m/s                                 |
    | out  | environment_force | M n  | N, exerted BY the robot             |
    | out  | layer             | M    | index of the layer at x, -1: before |

    M is 1, or the number of an ensemble's members: as many tools, each in material of
    its own.

    State (discrete, M): the region each tool is in. A region is a run of layers in
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
        num_members: M, >= 1.

    Raises:
        ValueError: If the starts do not ascend or a value is not allowed.
    """

    def __init__(self, *, layers: Sequence[Layer], num_axes: int, num_members: int = 1):
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

        self._table = layer_table(
            layers, list(zip(first_layers, self._last_layers, strict=True))
        )
        self._forces = compiled(layered_forces)

        M, self._n = num_members, num_axes
        self._no_regions = np.full(M, -1.0)
        self._p = self.DeclareVectorInputPort("tool_position", M * num_axes)
        self._v = self.DeclareVectorInputPort("tool_velocity", M * num_axes)
        self._region = self.DeclareDiscreteState(M)
        self.DeclareVectorOutputPort(
            "environment_force",
            M * num_axes,
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
            M,
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
        # There is nothing behind the last region and before the first.
        self._last_region = len(first_layers) - 1
        self._enters_next, self._enters_previous = [enters_next], [enters_previous]

    def _RegionAt(self, x: float) -> int:
        return layer_index(self._first_layers, layer_index(self._starts, x))

    def _LayerIndex(self, region: int | None, x: float) -> int:
        """Returns the layer at x, if the tool there is in this region or in any."""
        if region is None:
            return layer_index(self._starts, x)
        first, last = self._first_layers[region], self._last_layers[region]
        if first == last:
            return first
        return min(max(layer_index(self._starts, x), first), last)

    def _GetRegions(self, context: Context) -> list[int]:
        """Returns the region that each tool is in."""
        regions = context.get_discrete_state_vector().value().tolist()
        return [int(region) for region in regions]

    def _EvalX(self, context: Context) -> list[float]:
        """Returns where each tool is along x, in m."""
        x: list[float] = self._p.Eval(context)[:: self._n].tolist()
        return x

    def _CalcForce(self, context: Context, output: BasicVector) -> None:
        if context.get_accuracy() is None:
            regions = self._no_regions
        else:
            regions = context.get_discrete_state_vector().value()
        p, v = self._p.Eval(context), self._v.Eval(context)
        output.SetFromVector(self._forces(self._table, regions, p, v))

    def _CalcLayer(self, context: Context, output: BasicVector) -> None:
        x = self._EvalX(context)
        regions: list[int | None] = [None] * len(x)
        if context.get_accuracy() is not None:
            regions[:] = self._GetRegions(context)
        output.SetFromVector(list(map(self._LayerIndex, regions, x)))

    def DoGetWitnessFunctions(self, context: Context) -> list[WitnessFunction]:
        """Returns the boundaries of the regions, if events are to be located."""
        if context.get_accuracy() is None:
            return []
        regions = self._GetRegions(context)
        return self._enters_next * (min(regions) < self._last_region) + (
            self._enters_previous * (max(regions) > 0)
        )

    def _CalcPast(self, borders: list[float], context: Context) -> list[float]:
        """Returns how far each tool is past the border of its region, in m."""
        x, regions = self._EvalX(context), self._GetRegions(context)
        return [p - borders[region] for p, region in zip(x, regions, strict=True)]

    def _CalcPastEnd(self, context: Context) -> float:
        return max(self._CalcPast(self._ends, context))

    def _CalcPastStart(self, context: Context) -> float:
        return min(self._CalcPast(self._begins, context))

    def _SetRegion(self, context: Context, state: State) -> None:
        regions = state.get_mutable_discrete_state(self._region)
        regions.SetFromVector([self._RegionAt(x) for x in self._EvalX(context)])

    def _EnterNextRegion(self, context: Context, event: Event, state: State) -> None:
        for i, past in enumerate(self._CalcPast(self._ends, context)):
            if past >= 0:
                self._MoveBy(1, context, i, state)

    def _EnterPreviousRegion(
        self, context: Context, event: Event, state: State
    ) -> None:
        for i, past in enumerate(self._CalcPast(self._begins, context)):
            if past <= 0:
                self._MoveBy(-1, context, i, state)

    def _MoveBy(self, change: int, context: Context, i: int, state: State) -> None:
        region = self._GetRegions(context)[i] + change
        state.get_mutable_discrete_state(self._region).SetAtIndex(i, region)


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

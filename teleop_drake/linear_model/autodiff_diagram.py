"""A diagram of AutoDiffXd, cut open at delays and at chosen ports.

Drake's own scalar conversion gives every block exact derivatives. A block that does not
convert gets central differences, it alone.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from pydrake.autodiffutils import (
    AutoDiffXd,
    ExtractGradient,
    ExtractValue,
    InitializeAutoDiff,
)
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder_,
    InputPort,
    InputPortIndex,
    LeafSystem_,
    OutputPort,
    System,
)
from pydrake.systems.primitives import Adder_, PassThrough_

from teleop_drake.arrays import Array, Indices
from teleop_drake.compiler.flatten import Block, OutputOf, Source
from teleop_drake.environments import SurfacesOf
from teleop_drake.kernel.block import DualBlock, KernelBlock
from teleop_drake.numerics.differences import differentiate

Contexts = Mapping[System, Context]

# How far apart slopes are compared, relative to values of 1 and more, and which share
# of the largest they may differ by: far more than curvature makes of so short a way.
_NEAR = 1e-9
_BEND = 1e-4


@dataclass(frozen=True, kw_only=True, eq=False)
class States:
    """The first continuous states of a block, which a model has as its own."""

    system: System
    context: Context
    size: int

    def Get(self) -> Array:
        """Returns their values."""
        state = self.context.get_continuous_state_vector()
        return cast(Array, state.CopyToVector()[: self.size])

    def Set(self, values: Array) -> None:
        """Gives them values."""
        x = self.context.get_continuous_state_vector().CopyToVector()
        x[: self.size] = values
        self.context.SetContinuousState(x)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cut:
    """Input ports of blocks at which a diagram is cut open: an input of its model.

    Attributes:
        ports: The ports, which all receive the same.
        contexts: Of every system.
        entering: What they receive as long as nothing is cut, delays apart.
        delay: The delay that is taken out there, if any.
        is_added: Whether the input is added to what the ports receive.
    """

    ports: list[InputPort]
    contexts: Contexts
    entering: InputPort | OutputPort | None = None
    delay: System | None = None
    is_added: bool = False

    def Get(self) -> Array:
        """Returns the value of the input at the operating point."""
        if not self.ports:  # A delay at the end of a diagram.
            assert self.delay is not None
            output = self.delay.get_output_port()
            return cast(Array, output.Eval(self.contexts[self.delay]))
        port = self.ports[0]
        context = self.contexts[port.get_system()]
        if self.is_added or not port.HasValue(context):
            return np.zeros(port.size())
        return cast(Array, port.Eval(context))

    def Set(self, value: Array) -> None:
        """Fixes the ports at a value."""
        for port in self.ports:
            port.FixValue(self.contexts[port.get_system()], value)

    def Settle(self) -> None:
        """Fixes the ports at what enters now."""
        assert self.entering is not None
        self.Set(self.entering.Eval(self.contexts[self.entering.get_system()]))


def CutAtDelay(blocks: Sequence[Block], delay: System, contexts: Contexts) -> Cut:
    """Returns the cut at the ports that a delay is connected to."""
    consumers = [
        block.system.GetInputPort(name)
        for block in blocks
        for name, source in block.inputs.items()
        if blocks[source.block].system is delay
    ]
    return Cut(
        ports=consumers,
        contexts=contexts,
        entering=delay.get_input_port(),
        delay=delay,
    )


def LeafPorts(port: InputPort) -> list[InputPort]:
    """Returns the ports of blocks that an input port of a system is, or leads to."""
    system = port.get_system()
    if not isinstance(system, Diagram):
        return [port]
    index = InputPortIndex(int(port.get_index()))
    return [
        leaf
        for inner, i in system.GetInputPortLocators(index)
        for leaf in LeafPorts(inner.get_input_port(int(i)))
    ]


class AutoDiffDiagram:
    """A diagram whose values carry derivatives by some states and inputs.

    Args:
        blocks: Those of the diagram, by Flatten().
        contexts: Of every system in it: the operating point.
        states: By which there are derivatives, first.
        cuts: The inputs by which there are, after them.
        seen: Ports at which values are wanted, after the rates of the states.
        parts: Names of the systems in the diagram that count; None: all.

    Attributes:
        by_differences: Paths of the blocks that do not convert.
    """

    def __init__(
        self,
        blocks: list[Block],
        contexts: Contexts,
        *,
        states: Sequence[States],
        cuts: Sequence[Cut],
        seen: Iterable[InputPort | OutputPort],
        parts: Collection[str] | None = None,
    ):
        self._contexts, self._states, self._cuts = contexts, states, cuts
        self._all, self._parts, self._ports = blocks, parts, list(seen)
        self._Build()

    def _Build(self) -> None:
        """Converts what converts at the operating point, and connects it."""
        contexts, cuts, blocks = self._contexts, self._cuts, self._all
        self.by_differences: list[str] = []
        builder = DiagramBuilder_[AutoDiffXd]()
        delays = {cut.delay for cut in cuts}
        self._blocks: dict[System, Any] = {}
        for block in blocks:
            system = block.system
            is_part = self._parts is None or block.path.split("/")[0] in self._parts
            is_seen = system.num_output_ports() or system.num_continuous_states()
            if is_part and is_seen and system not in delays:
                dual = self._Convert(system, block.path)
                dual.set_name(block.path.replace("/", "."))
                self._blocks[system] = builder.AddSystem(dual)
        self._given = [
            builder.AddNamedSystem(
                f"input {i}", PassThrough_[AutoDiffXd](len(cut.Get()))
            )
            for i, cut in enumerate(cuts)
        ]
        self._delivered = {
            cut.delay: given for cut, given in zip(cuts, self._given, strict=True)
        }
        given_at = {
            (port.get_system(), port.get_name()): (given, cut.is_added)
            for cut, given in zip(cuts, self._given, strict=True)
            for port in cut.ports
            if cut.delay is None
        }
        self._open: list[tuple[Any, InputPort]] = []
        for block in blocks:
            if block.system not in self._blocks:
                continue
            for i in range(block.system.num_input_ports()):
                port = block.system.get_input_port(i)
                target = self._blocks[block.system].get_input_port(i)
                source = block.inputs.get(port.get_name())
                output = source and self._OutputOf(source)
                place = (block.system, port.get_name())
                if place in given_at:
                    given, is_added = given_at[place]
                    if is_added:
                        adder = builder.AddSystem(Adder_[AutoDiffXd](2, port.size()))
                        adder.set_name(f"sum at {target.GetFullDescription()}")
                        builder.Connect(output, adder.get_input_port(0))
                        builder.Connect(
                            given.get_output_port(), adder.get_input_port(1)
                        )
                        given = adder
                    output = given.get_output_port()
                if output is None:
                    self._open.append((target, port))
                else:
                    builder.Connect(output, target)
        self._seen = [self._PortOf(port) for port in self._ports]
        self._context: Any = builder.Build().CreateDefaultContext()
        for system, dual in self._blocks.items():
            own, context = self._Of(dual), contexts[system]
            for i in range(context.num_numeric_parameter_groups()):
                values = context.get_numeric_parameter(i).CopyToVector()
                own.get_mutable_numeric_parameter(i).SetFromVector(values)

    def _OutputOf(self, source: Source) -> Any:
        """Returns a port of the blocks, or of the input in a delay's place, if any."""
        system = self._all[source.block].system
        if system in self._delivered:
            return self._delivered[system].get_output_port()
        if system not in self._blocks:
            return None
        return self._blocks[system].GetOutputPort(source.port)

    def _PortOf(self, port: InputPort | OutputPort) -> Any:
        if isinstance(port, OutputPort):
            index = int(port.get_index())
            return self._OutputOf(OutputOf(self._all, port.get_system(), index))
        (leaf, *_) = LeafPorts(port)
        system, name = leaf.get_system(), leaf.get_name()
        if system in self._blocks:
            return self._blocks[system].GetInputPort(name)
        (block,) = (x for x in self._all if x.system is system)
        return self._OutputOf(block.inputs[name])

    def _Convert(self, system: Any, path: str) -> Any:
        context = self._contexts[system]
        try:
            if hasattr(system, "Kernel") and not isinstance(system, KernelBlock):
                dual = DualBlock(system)
            else:
                dual = system.ToAutoDiffXdMaybe()
            if dual is None:
                raise TypeError
            if isinstance(dual, DualBlock):
                _Try(dual, system, context)
        except TypeError:
            self.by_differences.append(path)
            return _Differences(system, context)
        return dual

    def Bends(self, step: float, slopes: Array) -> bool:
        """Returns whether anything has two slopes here.

        They are compared on both sides of the point, in a direction that lies in no
        surface on which a law bends.

        Args:
            step: See Evaluate().
            slopes: At the point, by Evaluate().
        """
        point, _ = self._Given()
        # No two elements are alike. numpy.random would have to be imported.
        shares = [0.5 + (0.309 * k) % 0.5 for k in range(1, len(point) + 1)]
        side = _NEAR * np.array(shares)
        side *= np.maximum(1.0, np.abs(point)) * (-1.0) ** np.arange(len(point))
        rough = [x for x in self._blocks.values() if isinstance(x, _Differences)]
        for block in rough:
            block.is_bent = False
        change = self.Evaluate(step, side)[1] - self.Evaluate(step, -side)[1]
        sizes = [x.size for x in self._states] + [x.size() for x in self._seen]
        ends = np.cumsum(sizes)[:-1]
        return any(block.is_bent for block in rough) or any(
            np.abs(part).max(initial=0) > _BEND * np.abs(slope).max(initial=0)
            for part, slope in zip(
                np.split(change, ends), np.split(slopes, ends), strict=True
            )
        )

    def _Given(self) -> tuple[Array, Indices]:
        """Returns states and inputs at the point, and where each of them ends."""
        given = [x.Get() for x in self._states] + [x.Get() for x in self._cuts]
        ends = np.cumsum([len(x) for x in given])
        return np.concatenate([np.zeros(0), *given]), ends[:-1]

    def Evaluate(self, step: float, shift: Array | float = 0.0) -> tuple[Array, Array]:
        """Returns rates of the states and what is seen, and the slopes of both.

        Args:
            step: The longest difference for blocks that do not convert, as a share of
                a value of 1 and more.
            shift: Is added to states and inputs.
        """
        try:
            return self._Evaluate(step, shift)
        except TypeError:
            # A function does not know AutoDiffXd, on a branch that is new.
            self._Build()
            return self._Evaluate(step, shift)

    def _Evaluate(self, step: float, shift: Array | float) -> tuple[Array, Array]:
        flat, ends = self._Given()
        seeds = InitializeAutoDiff(flat + shift, np.eye(len(flat))).ravel()
        parts = np.split(seeds, ends)
        self._SetPoint(step)
        for x, part in zip(self._states, parts, strict=False):
            own = self._Of(self._blocks[x.system])
            state = own.get_continuous_state_vector().CopyToVector()
            state[: x.size] = part
            own.SetContinuousState(state)
        for given, part in zip(self._given, parts[len(self._states) :], strict=True):
            given.get_input_port().FixValue(self._Of(given), part)
        values = []
        for x in self._states:
            dual = self._blocks[x.system]
            rates = dual.EvalTimeDerivatives(self._Of(dual)).CopyToVector()
            values.append(rates[: x.size])
        values += [port.Eval(self._Of(port.get_system())) for port in self._seen]
        y = np.concatenate(values)
        slopes = ExtractGradient(y)
        # What depends on none of them has no derivatives at all.
        slopes = slopes if slopes.size else np.zeros((len(y), len(flat)))
        return ExtractValue(y).ravel(), slopes

    def _SetPoint(self, step: float) -> None:
        self._context.SetTime(next(iter(self._contexts.values())).get_time())
        for system, dual in self._blocks.items():
            context = self._contexts[system]
            if context.get_accuracy() is None and SurfacesOf(system):
                # The position decides then, not the region that is held.
                system.ExecuteInitializationEvents(context)
            own = self._Of(dual)
            own.SetContinuousState(context.get_continuous_state_vector().CopyToVector())
            for i in range(own.num_discrete_state_groups()):
                own.SetDiscreteState(i, context.get_discrete_state(i).CopyToVector())
            if isinstance(dual, _Differences):
                dual.step = step
        for target, port in self._open:
            context = self._contexts[port.get_system()]
            if port.HasValue(context):
                target.FixValue(self._Of(target.get_system()), port.Eval(context))

    def _Of(self, dual: Any) -> Any:
        return dual.GetMyMutableContextFromRoot(self._context)


def _Try(dual: Any, system: System, context: Context) -> None:
    """Evaluates a converted block once: its functions may not know AutoDiffXd."""
    own = dual.CreateDefaultContext()
    own.SetTimeStateAndParametersFrom(context)
    for i in range(dual.num_input_ports()):
        port = system.get_input_port(i)
        has_value = port.HasValue(context)
        value = port.Eval(context) if has_value else np.zeros(port.size())
        dual.get_input_port(i).FixValue(own, value)
    dual.EvalTimeDerivatives(own)
    for i in range(dual.num_output_ports()):
        dual.get_output_port(i).Eval(own)


class _Differences(LeafSystem_[AutoDiffXd]):
    """A block whose slopes are central differences of what it computes.

    Attributes:
        step: Longest difference, as a share of a value of 1 and more.
        is_bent: Whether it has been evaluated where slopes on both sides differ.

    Args:
        system: The block.
        context: What stays as it is there: time, parameters, modes.
    """

    step = 1e-4
    is_bent = False

    def __init__(self, system: System, context: Context):
        LeafSystem_[AutoDiffXd].__init__(self)
        self._system, self._point = system, context
        self._own = system.CreateDefaultContext()
        inputs = range(system.num_input_ports())
        for port in map(system.get_input_port, inputs):
            self.DeclareVectorInputPort(port.get_name(), port.size())
            port.FixValue(self._own, np.zeros(port.size()))
        if system.num_continuous_states():
            state = self._own.get_continuous_state()
            self.DeclareContinuousState(state.num_q(), state.num_v(), state.num_z())
        for i in range(system.num_output_ports()):
            port = system.get_output_port(i)
            taken = [j for j in inputs if system.HasDirectFeedthrough(j, i)]
            tickets = {self.get_input_port(j).ticket() for j in taken}

            def Calc(
                context: Any, output: Any, port: Any = port, taken: Any = taken
            ) -> None:
                value = self._Evaluate(context, taken, lambda: port.Eval(self._own))
                output.SetFromVector(value)

            tickets |= {self.xc_ticket(), self.time_ticket()}
            self.DeclareVectorOutputPort(port.get_name(), port.size(), Calc, tickets)

    def DoCalcTimeDerivatives(self, context: Any, derivatives: Any) -> None:
        """Evaluates the block's own."""

        def Rates() -> Any:
            return self._system.EvalTimeDerivatives(self._own).CopyToVector()

        every = range(self.num_input_ports())
        derivatives.SetFromVector(self._Evaluate(context, every, Rates))

    def _Evaluate(self, context: Any, inputs: Any, Value: Any) -> Any:
        own, system = self._own, self._system
        own.SetTimeStateAndParametersFrom(self._point)
        dual = [
            context.get_continuous_state_vector().CopyToVector(),
            *(self.get_input_port(i).Eval(context) for i in inputs),
        ]
        x, ends = np.concatenate(dual), np.cumsum([len(part) for part in dual])[:-1]

        def Of(point: Array) -> Array:
            first, *values = np.split(point, ends)
            if len(first):
                own.SetContinuousState(first)
            for i, value in zip(inputs, values, strict=True):
                system.get_input_port(i).FixValue(own, value)
            return np.array(Value())

        point = ExtractValue(x).ravel()
        steps = self.step * np.maximum(1.0, np.abs(point))
        slope = differentiate(Of, point, steps)
        here = Of(point)

        def Bend(h: Array) -> Array:
            second = Of(point + h) - 2 * here + Of(point - h)
            return cast(Array, second / np.abs(h).max())

        # Of a smooth law this shrinks with the length of h; its limit is extrapolated.
        for h in np.diag(steps / 8):
            bend = np.abs(2 * Bend(h / 2) - Bend(h)).max(initial=0)
            self.is_bent |= bool(bend > _BEND * np.abs(slope).max(initial=0))
        return InitializeAutoDiff(here, slope @ ExtractGradient(x)).ravel()

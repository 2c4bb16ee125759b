"""A diagram of AutoDiffXd, cut open at delays and at chosen ports.

Drake's own scalar conversion gives every block exact derivatives. A block that does not
convert gets central differences, it alone.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray
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
from pydrake.systems.primitives import Adder_

from teleop_drake.compiler.flatten import Flatten, OutputOf, Source
from teleop_drake.environments import SurfacesOf
from teleop_drake.kernel.block import DualBlock, KernelBlock
from teleop_drake.linear_model.cuts import FixedInput, InnerDelay, States
from teleop_drake.numerics.differences import differentiate

Array = NDArray[np.float64]
Contexts = Mapping[System, Context]
Seen: TypeAlias = States | InputPort | OutputPort

# How far apart slopes are compared, relative to values of 1 and more, and which share
# of the largest they may differ by: far more than curvature makes of so short a way.
_NEAR = 1e-9
_BEND = 1e-4


class DualDiagram:
    """A diagram whose values carry derivatives by states and inputs of one's choice.

    Args:
        diagram: The diagram.
        contexts: Of every system in it, for what a conversion needs of them.
        cut: Ports, at any depth, that receive only what is set.
        added: Ports of blocks to which what is set is added.
        delays: Delays, which are cut.
        parts: Names of the systems in the diagram that count; None: all.
        step: Longest difference for blocks that do not convert, as a share of a value
            of 1 and more.

    Attributes:
        by_differences: Paths of the blocks that do not convert.
    """

    def __init__(
        self,
        diagram: Diagram,
        contexts: Contexts,
        *,
        cut: Collection[InputPort] = (),
        added: Collection[InputPort] = (),
        delays: Collection[System] = (),
        parts: Collection[str] | None = None,
        step: float,
    ):
        self._flat, self._delays = Flatten(diagram), delays
        self._step = step
        self.by_differences: list[str] = []
        builder = DiagramBuilder_[AutoDiffXd]()
        self._blocks: dict[System, Any] = {}
        for block in self._flat:
            system = block.system
            is_seen = system.num_output_ports() or system.num_continuous_states()
            is_part = parts is None or block.path.split("/")[0] in parts
            if is_part and is_seen and system not in delays:
                dual = self._Convert(system, block.path, contexts[system])
                dual.set_name(block.path.replace("/", "."))
                self._blocks[system] = builder.AddSystem(dual)
        self._targets: dict[tuple[System, str], Any] = {}
        self._open: list[InputPort] = []
        self._cut = {_Place(leaf) for port in cut for leaf in LeafPorts(port)}
        added_places = {_Place(port) for port in added}
        for block in self._flat:
            if block.system not in self._blocks:
                continue
            for i in range(block.system.num_input_ports()):
                port = block.system.get_input_port(i)
                source = block.inputs.get(port.get_name())
                target = self._blocks[block.system].get_input_port(i)
                output = None if source is None else self._OutputOf(source)
                place = _Place(port)
                self._targets[place] = target
                if output is None or place in self._cut:
                    self._open.append(port)
                    continue
                if place in added_places:
                    adder = builder.AddSystem(Adder_[AutoDiffXd](2, port.size()))
                    adder.set_name(f"deviation at {target.GetFullDescription()}")
                    builder.Connect(output, adder.get_input_port(0))
                    self._targets[place] = adder.get_input_port(1)
                    output = adder.get_output_port()
                builder.Connect(output, target)
        self._diagram = builder.Build()
        self._originals = contexts
        self._context: Any = None
        self._contexts_by_size: dict[int, Any] = {}

    def _UseContext(self, size: int) -> None:
        """Uses a Context of its own for each number of derivatives.

        Drake's blocks add to numbers that are there from before, without a look at how
        many derivatives these have.
        """
        if size not in self._contexts_by_size:
            self._context = self._diagram.CreateDefaultContext()
            self._contexts_by_size[size] = self._context
            for system, dual in self._blocks.items():
                own, context = self._Of(dual), self._originals[system]
                for i in range(context.num_numeric_parameter_groups()):
                    values = context.get_numeric_parameter(i).CopyToVector()
                    own.get_mutable_numeric_parameter(i).SetFromVector(values)
        self._context = self._contexts_by_size[size]

    def _OutputOf(self, source: Source) -> Any:
        system = self._flat[source.block].system
        if system not in self._blocks:
            return None
        return self._blocks[system].GetOutputPort(source.port)

    def _Convert(self, system: Any, path: str, context: Context) -> Any:
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
            return _Differences(system, context, self._step)
        return dual

    def Linearize(
        self,
        contexts: Contexts,
        states: Sequence[States],
        inputs: Sequence[FixedInput | InnerDelay],
        seen: Sequence[Seen],
    ) -> tuple[list[Array], list[bool]]:
        """Returns the slopes of what is seen, and whether each has two of them here.

        Slopes are compared on both sides of the point, in a direction that lies in no
        surface on which a law bends.

        Args:
            contexts: Of every system in the original diagram: the operating point.
            states: The slopes are by these, first.
            seen: Rates of states, and values at ports.
        """
        rough = [x for x in self._blocks.values() if isinstance(x, _Differences)]
        for block in rough:
            block.is_bent = False
        x = np.concatenate([np.zeros(0), *(x.Get() for x in (*states, *inputs))])
        side = _NEAR * np.random.default_rng(0).uniform(0.5, 1.0, len(x))
        side = side * np.maximum(1.0, np.abs(x)) * (-1.0) ** np.arange(len(x))
        behind, here, ahead = (
            [slope for _, slope in self.Evaluate(contexts, states, inputs, seen, shift)]
            for shift in (-side, 0.0, side)
        )
        bends = [
            any(block.is_bent for block in rough)
            or bool(np.abs(b - a).max(initial=0) > _BEND * np.abs(m).max(initial=0))
            for a, m, b in zip(behind, here, ahead, strict=True)
        ]
        return here, bends

    def Evaluate(
        self,
        contexts: Contexts,
        states: Sequence[States],
        inputs: Sequence[FixedInput | InnerDelay],
        seen: Sequence[Seen],
        shift: Array | float = 0.0,
    ) -> list[tuple[Array, Array]]:
        """Returns values and slopes of what is seen.

        Args:
            contexts: See Linearize().
            shift: Is added to states and inputs.
        """
        given = [x.Get() for x in (*states, *inputs)]
        flat = np.concatenate([np.zeros(0), *given])
        size = len(flat)
        seeds = InitializeAutoDiff(flat + shift, np.eye(size)).ravel()
        self._UseContext(size)
        ends = np.cumsum([len(x) for x in given])
        parts = [seeds[e - len(x) : e] for e, x in zip(ends, given, strict=True)]
        self._SetPoint(contexts)
        for x, part in zip(states, parts, strict=False):
            own = self._Of(self._blocks[x.system])
            state = own.get_continuous_state_vector().CopyToVector()
            state[x.indices] = part
            own.SetContinuousState(state)
        sums: dict[tuple[System, str], Any] = {}
        delivered: dict[System, Any] = {}
        for given_input, part in zip(inputs, parts[len(states) :], strict=True):
            if isinstance(given_input, InnerDelay):
                delivered[given_input.system] = part
                ports = self._ConsumersOf(given_input.system)
            else:
                ports = given_input.ports
            for leaf in (leaf for port in ports for leaf in LeafPorts(port)):
                sums[_Place(leaf)] = part + sums.get(_Place(leaf), 0.0)
        for place, value in sums.items():
            if place in self._targets:
                self._Fix(self._targets[place], value)
        values = [self._Value(x, delivered) for x in seen]
        # What depends on none of them has no derivatives at all.
        slopes = [ExtractGradient(x) for x in values]
        return [
            (ExtractValue(x).ravel(), by if by.size else np.zeros((len(x), size)))
            for x, by in zip(values, slopes, strict=True)
        ]

    def _SetPoint(self, contexts: Contexts) -> None:
        self._context.SetTime(next(iter(contexts.values())).get_time())
        for system, dual in self._blocks.items():
            context = contexts[system]
            if context.get_accuracy() is None and SurfacesOf(system):
                # The position decides then, not the region that is held.
                system.ExecuteInitializationEvents(context)
            own = self._Of(dual)
            own.SetContinuousState(context.get_continuous_state_vector().CopyToVector())
            for i in range(own.num_discrete_state_groups()):
                own.SetDiscreteState(i, context.get_discrete_state(i).CopyToVector())
        for port in self._open:
            if port.HasValue(contexts[port.get_system()]):
                self._Fix(
                    self._targets[_Place(port)], port.Eval(contexts[port.get_system()])
                )
        for place, target in self._targets.items():
            if target.get_system() is not self._blocks[place[0]]:
                self._Fix(target, np.zeros(target.size()))

    def _Fix(self, port: Any, value: Any) -> None:
        port.FixValue(self._Of(port.get_system()), value)

    def _Of(self, dual: Any) -> Any:
        return dual.GetMyMutableContextFromRoot(self._context)

    def _Value(self, seen: Seen, delivered: Mapping[System, Any]) -> Any:
        if isinstance(seen, States):
            dual = self._blocks[seen.system]
            rates = dual.EvalTimeDerivatives(self._Of(dual))
            return rates.CopyToVector()[seen.indices]
        if isinstance(seen, OutputPort):
            source = OutputOf(self._flat, seen.get_system(), int(seen.get_index()))
        else:
            leaf = LeafPorts(seen)[0]
            (block,) = (x for x in self._flat if x.system is leaf.get_system())
            if block.system not in self._delays:
                target = self._blocks[block.system].GetInputPort(leaf.get_name())
                return target.Eval(self._Of(target.get_system()))
            source = block.inputs[leaf.get_name()]
        system = self._flat[source.block].system
        if system in delivered:
            return delivered[system]
        output = self._OutputOf(source)
        return output.Eval(self._Of(output.get_system()))

    def _ConsumersOf(self, delay: System) -> list[InputPort]:
        """Returns the ports of blocks that a delay is connected to."""
        return [
            block.system.GetInputPort(name)
            for block in self._flat
            for name, source in block.inputs.items()
            if self._flat[source.block].system is delay
            and (block.system, name) not in self._cut
        ]


def _Place(port: InputPort) -> tuple[System, str]:
    return port.get_system(), port.get_name()


def LeafPorts(port: InputPort) -> list[InputPort]:
    """Returns the ports of blocks that an input port of a system is, or leads to.

    Args:
        port: Of a diagram or a block.
    """
    system = port.get_system()
    if not isinstance(system, Diagram):
        return [port]
    return [
        leaf
        for inner, i in system.GetInputPortLocators(
            InputPortIndex(int(port.get_index()))
        )
        for leaf in LeafPorts(inner.get_input_port(int(i)))
    ]


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
        is_bent: Whether it has been evaluated where slopes on both sides differ.

    Args:
        system: The block.
        context: What stays as it is there: time, parameters, modes.
        step: Longest difference, as a share of a value of 1 and more.
    """

    def __init__(self, system: System, context: Context, step: float):
        LeafSystem_[AutoDiffXd].__init__(self)
        self._system, self._step, self.is_bent = system, step, False
        self._own = system.CreateDefaultContext()
        self._own.SetTimeStateAndParametersFrom(context)
        inputs = [system.get_input_port(i) for i in range(system.num_input_ports())]
        for port in inputs:
            self.DeclareVectorInputPort(port.get_name(), port.size())
            port.FixValue(self._own, np.zeros(port.size()))
        if system.num_continuous_states():
            state = self._own.get_continuous_state()
            self.DeclareContinuousState(state.num_q(), state.num_v(), state.num_z())
        for i in range(self._own.num_discrete_state_groups()):
            self.DeclareDiscreteState(self._own.get_discrete_state(i).size())
        for i in range(system.num_output_ports()):
            port = system.get_output_port(i)
            taken = [j for j in range(len(inputs)) if system.HasDirectFeedthrough(j, i)]
            tickets = {self.get_input_port(j).ticket() for j in taken}

            def Calc(
                context: Any, output: Any, port: Any = port, taken: Any = taken
            ) -> None:
                def Value() -> Array:
                    return cast(Array, port.Eval(self._own))

                output.SetFromVector(self._Evaluate(context, taken, Value))

            self.DeclareVectorOutputPort(
                port.get_name(),
                port.size(),
                Calc,
                {self.xc_ticket(), self.xd_ticket(), *tickets},
            )

    def DoCalcTimeDerivatives(self, context: Any, derivatives: Any) -> None:
        """Evaluates the block's own."""

        def Rates() -> Array:
            rates = self._system.EvalTimeDerivatives(self._own)
            return cast(Array, rates.CopyToVector())

        every = range(self.num_input_ports())
        derivatives.SetFromVector(self._Evaluate(context, every, Rates))

    def _Evaluate(self, context: Any, inputs: Any, Value: Any) -> Any:
        own, system = self._own, self._system
        dual = [self.get_input_port(i).Eval(context) for i in inputs]
        state = context.get_continuous_state_vector().CopyToVector()
        x = np.concatenate([state, *dual])
        ends = np.cumsum([len(state), *map(len, dual)])[:-1]
        for i in range(own.num_discrete_state_groups()):
            group = context.get_discrete_state(i).CopyToVector()
            own.SetDiscreteState(i, ExtractValue(group).ravel())

        def Of(point: Array) -> Array:
            first, *values = np.split(point, ends)
            if len(first):
                own.SetContinuousState(first)
            for i, value in zip(inputs, values, strict=True):
                system.get_input_port(i).FixValue(own, value)
            return np.array(Value())

        point = ExtractValue(x).ravel()
        steps = self._step * np.maximum(1.0, np.abs(point))
        slope = differentiate(Of, point, steps)
        here, unit = Of(point), np.diag(steps / 8)

        def Bend(h: Array) -> Array:
            second = Of(point + h) - 2 * here + Of(point - h)
            return cast(Array, second / np.abs(h).max())

        # Of a smooth law this shrinks with the length of h; its limit is extrapolated.
        for h in unit:
            bend = np.abs(2 * Bend(h / 2) - Bend(h)).max(initial=0)
            self.is_bent |= bool(bend > _BEND * np.abs(slope).max(initial=0))
        return InitializeAutoDiff(Of(point), slope @ ExtractGradient(x)).ravel()

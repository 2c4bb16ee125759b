"""A diagram, cut open at some input ports, as a function with slopes.

The slopes are those of the diagram that Drake converts to AutoDiffXd. If a block does
not convert, they are central differences of the diagram itself.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.systems.framework import (
    Context,
    Diagram,
    InputPort,
    InputPortIndex,
    OutputPort,
    System,
)

from teleop_drake.arrays import Array
from teleop_drake.blocks.environments import SurfacesOf
from teleop_drake.contexts import ContextsIn
from teleop_drake.engine.flatten import Block, Flatten, OutputOf
from teleop_drake.kernel.block import DualBlock
from teleop_drake.numerics.differences import differentiate

Contexts = Mapping[System, Context]

# How far apart slopes are compared, relative to values of 1 and more, and by which
# share of the largest one they may differ. Curvature makes far less of so short a way.
_NEAR = 1e-9
_BEND = 1e-4


@dataclass(frozen=True, eq=False)
class States:
    """The first continuous states of a block, which are states of a model.

    Attributes:
        system: The block.
        context: Its Context.
        size: How many of its states.
    """

    system: System
    context: Context
    size: int

    def Get(self) -> Array:
        """Returns their values."""
        state = self.context.get_continuous_state_vector()
        return state.CopyToVector()[: self.size]

    def Set(self, values: Array) -> None:
        """Gives them values."""
        _SetFirstStates(self.context, values)


@dataclass(eq=False)
class Cut:
    """Input ports of blocks at which a diagram is cut open: an input of its model.

    Attributes:
        ports: The ports, which all receive the same signal.
        contexts: Of every system.
        entering: The port whose signal they receive as long as nothing is cut, except
            for a delay; None: nothing is connected to them.
        value: What they receive at the operating point.
        delay: The block between `entering` and the ports that delays the signal, if
            any.
    """

    ports: list[InputPort]
    contexts: Contexts
    entering: InputPort | OutputPort | None
    value: Array
    delay: System | None = None

    def Set(self, value: Array) -> None:
        """Fixes the ports at a value."""
        self.value = value
        for port in self.ports:
            port.FixValue(self.contexts[port.get_system()], value)

    def Settle(self) -> None:
        """Fixes the ports at what enters now."""
        assert self.entering is not None
        context = self.contexts[self.entering.get_system()]
        self.Set(np.array(self.entering.Eval(context)))


def CutBehind(
    entering: OutputPort, ports: Sequence[InputPort], contexts: Contexts
) -> Cut:
    """Returns the cut at input ports, of systems at any depth, behind an output."""
    leaves = [leaf for port in ports for leaf in LeafPorts(port)]
    value = np.zeros(entering.size())
    return Cut(leaves, contexts, entering, value)


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
        value=np.array(delay.get_output_port().Eval(contexts[delay])),
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


class _Twin(NamedTuple):
    """A system of a diagram, or of the diagram that it was converted to."""

    system: Any
    context: Any

    def Eval(self, port: InputPort | OutputPort) -> Array:
        """Returns the value of its port that corresponds to one of the original."""
        index = int(port.get_index())
        if isinstance(port, OutputPort):
            return self.system.get_output_port(index).Eval(self.context)
        return self.system.get_input_port(index).Eval(self.context)


class CutDiagram:
    """The function that a diagram is of some of its states and of what enters its cuts.

        [rates of the states; what is seen] = f(states; what is delivered at the cuts)

    Args:
        diagram: The diagram.
        contexts: Of every system in it, by ContextsIn(): the operating point.
        states: The states.
        cuts: The cuts. A cut at a delay delivers what the delay would. Where two cuts
            have the same port, the first of them counts.
        seen: Ports at which values are wanted.

    Attributes:
        by_differences: Paths of the blocks that do not convert to AutoDiffXd. If there
            is one, all slopes are central differences.
    """

    def __init__(
        self,
        diagram: Diagram,
        contexts: Contexts,
        *,
        states: Sequence[States],
        cuts: Sequence[Cut],
        seen: Sequence[InputPort | OutputPort],
    ):
        self._contexts = contexts
        self._states = states
        self._cuts = cuts
        self._blocks = Flatten(diagram)
        self._seen = [self._CutOrPort(port) for port in seen]
        sizes = [x.size for x in states] + [port.size() for port in seen]
        self._value_ends = np.cumsum(sizes)[:-1]
        self._ports = _PortsOfEach(cuts)
        self._originals = {x: _Twin(x, context) for x, context in contexts.items()}
        self.by_differences: tuple[str, ...] = ()
        self._root = contexts[diagram]
        self._duals: dict[System, _Twin] = {}
        dual = diagram.ToAutoDiffXdMaybe()
        if dual is None:
            self._UseDifferences()
            return
        self._dual_root = dual.CreateDefaultContext()
        twins = map(_Twin._make, ContextsIn(dual, self._dual_root).items())
        self._duals = dict(zip(contexts, twins, strict=True))
        for i in range(diagram.num_input_ports()):
            port = diagram.get_input_port(i)
            if port.HasValue(self._root):
                value = port.Eval(self._root)
                dual.get_input_port(i).FixValue(self._dual_root, value)

    def Evaluate(self, step: float) -> tuple[Array, Array]:
        """Returns rates of the states and what is seen (K), and the slopes of both.

        Args:
            step: The longest difference where slopes are differences, as a share of a
                value of 1 and more.

        Returns:
            The values (K) and their slopes by the N states and inputs (K, N).
        """
        point = self._Point()
        exact = self._Exact(point)
        if exact is not None:
            return exact
        steps = step * np.maximum(1.0, np.abs(point))
        slopes = differentiate(self._Values, point, steps)
        # Evaluated last, so that the Contexts stay at the operating point.
        values = self._Values(point)
        return values, slopes

    def Bends(self, step: float, slopes: Array) -> bool:
        """Returns whether anything has two slopes here.

        Args:
            step: As for Evaluate().
            slopes: At the point, by Evaluate().
        """
        point = self._Point()
        sizes = np.maximum(1.0, np.abs(point))
        # A direction that lies in no surface on which a law bends: no two elements are
        # alike. numpy.random would have to be imported.
        shares = 0.5 + (0.309 * np.arange(1, len(point) + 1)) % 0.5
        signs = (-1.0) ** np.arange(len(point))
        side = _NEAR * shares * signs * sizes
        ahead = self._Exact(point + side)
        behind = self._Exact(point - side)
        if ahead is not None and behind is not None:
            return self._IsLarge(ahead[1] - behind[1], slopes)
        ways = np.diag(step * sizes / 8)
        bends = [self._IsLarge(self._Bend(point, way), slopes) for way in ways]
        self._Values(point)
        return any(bends)

    def _Bend(self, point: Array, way: Array) -> Array:
        """Returns by how much slopes differ on both sides of a point (K).

        For a smooth law, second differences shrink with the length of the way; their
        limit is extrapolated.
        """
        here = self._Values(point)

        def SecondDifference(way: Array) -> Array:
            second = self._Values(point + way) - 2 * here + self._Values(point - way)
            return second / np.abs(way).max()

        return 2 * SecondDifference(way / 2) - SecondDifference(way)

    def _IsLarge(self, change: Array, slopes: Array) -> bool:
        """Returns whether a change is large beside the slopes of the same signal."""
        changes = np.split(change, self._value_ends)
        sizes = np.split(slopes, self._value_ends)
        return any(
            np.abs(part).max(initial=0) > _BEND * np.abs(size).max(initial=0)
            for part, size in zip(changes, sizes, strict=True)
        )

    def _Point(self) -> Array:
        """Returns states and inputs at the operating point (N)."""
        for system, context in self._contexts.items():
            if context.get_accuracy() is None and SurfacesOf(system):
                # The position decides then, not the region that is held.
                system.ExecuteInitializationEvents(context)
        parts = [x.Get() for x in self._states] + [cut.value for cut in self._cuts]
        return np.concatenate([np.zeros(0), *parts])

    def _Exact(self, point: Array) -> tuple[Array, Array] | None:
        """Returns values and slopes by AutoDiffXd; None: a block does not convert."""
        if not self._duals:
            return None
        self._dual_root.SetTimeStateAndParametersFrom(self._root)
        seeds = InitializeAutoDiff(point, np.eye(len(point))).ravel()
        try:
            y = self._Evaluate(self._duals, seeds)
        except TypeError:
            # A function does not know AutoDiffXd, perhaps on a new branch.
            self._UseDifferences()
            if not self.by_differences:
                raise
            return None
        slopes = ExtractGradient(y)
        if slopes.size == 0:  # Nothing depends on the point.
            slopes = np.zeros((len(y), len(point)))
        return ExtractValue(y).ravel(), slopes

    def _Values(self, point: Array) -> Array:
        """Returns the values at a point (K), by the diagram itself."""
        return self._Evaluate(self._originals, point)

    def _Evaluate(self, twins: Mapping[System, _Twin], point: Array) -> Array:
        """Returns the values at a point (K), of the scalar type of the twins."""
        parts = self._Parts(point)
        for x, value in parts.items():
            self._Set(twins, x, value)
        rates = []
        for states in self._states:
            twin = twins[states.system]
            derivatives = twin.system.EvalTimeDerivatives(twin.context)
            rates.append(derivatives.CopyToVector()[: states.size])
        seen = [
            parts[x] if isinstance(x, Cut) else twins[x.get_system()].Eval(x)
            for x in self._seen
        ]
        return np.concatenate(rates + seen)

    def _Parts(self, point: Array) -> dict[States | Cut, Array]:
        """Returns the parts of a point."""
        sizes = [x.size for x in self._states] + [len(x.value) for x in self._cuts]
        values = np.split(point, np.cumsum(sizes)[:-1])
        return dict(zip([*self._states, *self._cuts], values, strict=True))

    def _Set(
        self, twins: Mapping[System, _Twin], x: States | Cut, value: Array
    ) -> None:
        """Sets states, or what is delivered at a cut."""
        if isinstance(x, States):
            _SetFirstStates(twins[x.system].context, value)
            return
        for port in self._ports[x]:
            twin = twins[port.get_system()]
            index = int(port.get_index())
            twin.system.get_input_port(index).FixValue(twin.context, value)

    def _CutOrPort(self, port: InputPort | OutputPort) -> Cut | InputPort | OutputPort:
        """Returns where a signal is read: the cut that replaces a delay, or a port."""
        if isinstance(port, InputPort):
            return LeafPorts(port)[0]
        index = int(port.get_index())
        source = OutputOf(self._blocks, port.get_system(), index)
        system = self._blocks[source.block].system
        for cut in self._cuts:
            if cut.delay is system:
                return cut
        return port

    def _UseDifferences(self) -> None:
        """Names the blocks that do not convert, and gives the conversion up."""
        self.by_differences = tuple(
            block.path
            for block in self._blocks
            if not _Converts(block.system, self._contexts[block.system])
        )
        self._duals = {}


def _PortsOfEach(cuts: Sequence[Cut]) -> dict[Cut, list[InputPort]]:
    """Returns the ports of each cut; one of two cuts is the first one's."""
    taken: set[str] = set()
    ports = {}
    for cut in cuts:
        names = {port.GetFullDescription(): port for port in cut.ports}
        ports[cut] = [port for name, port in names.items() if name not in taken]
        taken |= names.keys()
    return ports


def _SetFirstStates(context: Any, values: Array) -> None:
    """Sets the first continuous states in a Context of any scalar type."""
    x = context.get_continuous_state_vector().CopyToVector()
    x[: len(values)] = values
    context.SetContinuousState(x)


def _Converts(system: System, context: Context) -> bool:
    """Returns whether a block converts to AutoDiffXd, with all that it calls here."""
    dual = system.ToAutoDiffXdMaybe()
    if not isinstance(dual, DualBlock) or context.num_abstract_states():
        return dual is not None
    own = dual.CreateDefaultContext()
    own.SetTimeStateAndParametersFrom(context)
    for i in range(dual.num_input_ports()):
        port = system.get_input_port(i)
        has_value = port.HasValue(context)
        value = port.Eval(context) if has_value else np.zeros(port.size())
        dual.get_input_port(i).FixValue(own, value)
    try:
        dual.EvalTimeDerivatives(own)
        for i in range(dual.num_output_ports()):
            dual.get_output_port(i).Eval(own)
    except TypeError:
        return False
    return True

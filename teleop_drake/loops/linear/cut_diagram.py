"""A diagram that is cut open at some input ports, as a differentiable function.

Slopes, that is partial derivatives, come from a diagram of the blocks that Drake has
converted to AutoDiffXd. If a block does not convert, they are central differences of
the original diagram. Blocks on which nothing of the model depends, such as logs and
visualizers, are left out.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.systems.framework import (
    Context,
    Diagram,
    InputPort,
    OutputPort,
    System,
)

from teleop_drake.loops.engine.flatten import Block, Flatten, OutputOf, Reached, Source
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import (
    ContextsIn,
)
from teleop_drake.loops.framework.surface import SurfacesOf
from teleop_drake.loops.kernel import KernelIn
from teleop_drake.loops.kernel.linear_part import LinearPartOf
from teleop_drake.loops.linear.dual_diagram import (
    Converts,
    DualDiagram,
    NotConverted,
    Twin,
)
from teleop_drake.loops.linear.states import HeldStates, States, Twins
from teleop_drake.loops.numerics.differences import differentiate
from teleop_drake.loops.run.inputs import LeafInputs

Port: TypeAlias = InputPort | OutputPort

# The distance at which slopes on both sides are compared, relative to values of 1 and
# more, and the largest difference as a share of the largest slope.
_NEAR = 1e-7
_BEND = 1e-4

# A difference of slopes that may be a rounding error: relative to the value, and that
# of a value of 0.
_ROUNDING = 2e-8
_NOTHING = 1e-13


@dataclass(eq=False)
class Cut:
    """Input ports of blocks at which a diagram is cut open: an input of its model.

    Attributes:
        ports: The ports, which all receive the same signal.
        originals: Every system of the diagram and its Context.
        entering: The port whose signal the ports receive, possibly delayed, if nothing
            is cut; None if they are not connected.
        value: The value at which the ports are fixed, that of the operating point.
        delay: The block that delays the signal between `entering` and the ports, if
            any.
        time: The delay of that block in s.
        steering: The port of that block at which its delay is an input, if any.
    """

    ports: list[InputPort]
    originals: Twins
    entering: Port | None
    value: Array
    delay: System | None = None
    time: float = 0.0
    steering: InputPort | None = None

    def Get(self) -> Array:
        """Returns the value at which the ports are fixed."""
        return self.value

    def Set(self, value: Array) -> None:
        """Fixes the ports at a value."""
        self.value = value
        self.SetIn(self.originals, value)

    def SetIn(self, twins: Twins, value: Array) -> None:
        """Fixes the ports at a value in a diagram of any scalar type."""
        for port in self.ports:
            twin = twins.get(port.get_system())
            if twin is not None:  # A log, for example, has no counterpart.
                twin.PortOf(port).FixValue(twin.context, value)

    def Settle(self) -> None:
        """Fixes the ports at the present value of `entering`."""
        assert self.entering is not None
        twin = self.originals[self.entering.get_system()]
        self.Set(np.array(self.entering.Eval(twin.context)))
        self.ReadTime()

    def ReadTime(self) -> None:
        """Sets `time` to the value of a delay that is an input, if it is one."""
        if self.steering is not None:
            context = self.originals[self.steering.get_system()].context
            self.time = float(self.steering.Eval(context)[0])


Entry: TypeAlias = States | HeldStates | Cut
"""An argument of a CutDiagram."""


def Split(entries: Sequence[Entry], values: Array) -> list[Array]:
    """Returns the parts of a vector that belong to each of the states and cuts.

    The vector may have further elements at its end.
    """
    ends = np.cumsum([len(x.Get()) for x in entries], dtype=int)
    return np.split(values, ends)[:-1]


def TimesOf(delays: Sequence[Cut]) -> tuple[float, ...]:
    """Returns the delays in s at some cuts, an entry for each signal."""
    return tuple(cut.time for cut in delays for _ in cut.value)


class CutDiagram:
    """A diagram as a function of some of its states and of the values at its cuts.

        [rates of the states; observed signals] = f(states; values at the cuts)

    A discrete state has its value after the next update in place of a rate.

    Choose() determines the states, cuts and observed signals.

    Args:
        diagram: The diagram.
        root: The diagram's Context, which is the operating point.

    Attributes:
        blocks: The blocks of the diagram, at all depths.
        contexts: The Context of every system in the diagram.
        needed: The blocks on which the function depends.
        by_differences: Paths of the needed blocks that do not convert to AutoDiffXd. If
            there is one, all slopes are central differences.
    """

    def __init__(self, diagram: Diagram, root: Context):
        self.blocks = Flatten(diagram)
        self.contexts = ContextsIn(diagram, root)
        self.needed: list[Block] = []
        self.by_differences: tuple[str, ...] = ()
        self._root = root
        self._dual: DualDiagram | None = None
        self._originals = {x: Twin(x, own) for x, own in self.contexts.items()}
        self._sources = {
            (block.system, name): source
            for block in self.blocks
            for name, source in block.inputs.items()
        }
        self._entries: list[Entry] = []

    def CutAt(self, port: Port, entering: Port | None = None) -> Cut:
        """Returns the cut at all ports of blocks that receive a signal.

        Its value is the present value of the signal. Without such a port the cut is
        empty.

        Args:
            port: An input port of a system at any depth, or an output port, for the
                ports that receive its signal.
            entering: See Cut. By default it is the source of the signal.
        """
        ports = self._Receivers(port)
        cut = Cut(ports, self._originals, entering, np.zeros(port.size()))
        if not ports:
            return cut
        leaf = ports[0]
        system = leaf.get_system()
        context = self.contexts[system]
        if leaf.HasValue(context):
            cut.value = np.array(leaf.Eval(context))
        source = self._sources.get((system, leaf.get_name()))
        if entering is None and source is not None:
            cut.entering = self.blocks[source.block].system.GetOutputPort(source.port)
        return cut

    def CutAtDelay(self, delay: System, time: float | None = None) -> Cut:
        """Returns the cut at the ports that receive the output of a delay block.

        A delay that is an input is constant in the model: at an equilibrium, where the
        delayed signal has no slope, its deviations have no effect.

        Args:
            time: The delay in s; None: that of the block's Context.
        """
        cut = self.CutAt(delay.get_output_port(), delay.get_input_port(0))
        cut.delay = delay
        declared: Any = time
        if time is None:
            (declared,) = [x.time for x in KernelIn(delay, self.contexts[delay]).delays]
        if isinstance(declared, str):
            cut.steering = delay.GetInputPort(declared)
            cut.ReadTime()
        else:
            cut.time = declared
        return cut

    def _Receivers(self, port: Port) -> list[InputPort]:
        """Returns the ports of blocks that receive a signal."""
        if isinstance(port, InputPort):
            return LeafInputs(port)
        output = self._SourceOf(port)
        return [
            system.GetInputPort(name)
            for (system, name), source in self._sources.items()
            if source == output
        ]

    def _SourceOf(self, port: OutputPort) -> Source:
        """Returns the block and port from which an output's signal comes."""
        return OutputOf(self.blocks, port.get_system(), int(port.get_index()))

    def Choose(
        self,
        states: Sequence[States | HeldStates],
        cuts: Sequence[Cut],
        seen: Sequence[Port],
    ) -> None:
        """Chooses the arguments and the values of the function.

        Args:
            states: The states.
            cuts: The cuts. If two cuts have the same port, the first one is effective.
            seen: The ports whose signals are observed. The output of a delay that is
                cut has the value at the cut.
        """
        self._states = states
        self._entries = [*states, *cuts]
        self._seen = [self._CutOrPort(port, cuts) for port in seen]
        # The block that computes each part of the values, and its size.
        self._owners = [(x.system, x.size) for x in states]
        self._owners += [
            (self._OwnerOf(source), port.size())
            for source, port in zip(self._seen, seen, strict=True)
        ]
        systems = {x.system for x in states}
        systems |= {x.get_system() for x in self._seen if not isinstance(x, Cut)}
        self.needed = self._Upstream(systems, cuts)
        self._dual = DualDiagram(self.blocks, self.needed, self.contexts)

    def BlocksFor(self, ports: Sequence[Port]) -> list[Block]:
        """Returns the blocks that belong to a model with some ports.

        They are those on which a port, a continuous state or a delay depends.
        """
        systems = {
            block.system
            for block in self.blocks
            if block.system.num_continuous_states() or LinearPartOf(block.system).delay
        }
        for port in ports:
            if isinstance(port, OutputPort):
                sources = [self._SourceOf(port)]
            else:
                leaves = [(x.get_system(), x.get_name()) for x in LeafInputs(port)]
                sources = [self._sources[x] for x in leaves if x in self._sources]
            systems |= {self.blocks[source.block].system for source in sources}
        return self._Upstream(systems)

    def _Upstream(
        self, systems: Collection[System], cuts: Sequence[Cut] = ()
    ) -> list[Block]:
        """Returns the blocks of some systems, and those on which they depend.

        Args:
            cuts: The cuts, which interrupt connections.
        """
        is_cut = {
            (port.get_system(), port.get_name()) for cut in cuts for port in cut.ports
        }
        sources = {
            i: [
                source.block
                for name, source in block.inputs.items()
                if (block.system, name) not in is_cut
            ]
            for i, block in enumerate(self.blocks)
        }
        starts = [i for i, x in enumerate(self.blocks) if x.system in systems]
        return [self.blocks[i] for i in sorted(Reached(starts, sources))]

    def Evaluate(self, step: float) -> tuple[Array, Array]:
        """Returns the function's values at the operating point, and their slopes.

        Args:
            step: The longest step of central differences, relative to values of 1 and
                more.

        Returns:
            The values (K), which are rates of the states and observed signals, and
            their slopes by the N states and inputs (K, N).
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

    def Bends(self, slopes: Array) -> dict[int, str]:
        """Returns the values that have different slopes on both sides of the point.

        Args:
            slopes: The slopes at the point, from Evaluate().

        Returns:
            The paths of the blocks that compute these values, keyed by their indices.
        """
        point = self._Point()
        if point.size == 0:  # A plant without joints.
            return {}
        # A direction with different elements, which hardly lies in a surface on which a
        # law bends. It is not random, because numpy.random would have to be imported.
        shares = 0.5 + (0.309 * np.arange(1, len(point) + 1)) % 0.5
        signs = (-1.0) ** np.arange(len(point))
        way = _NEAR * shares * signs * np.maximum(1.0, np.abs(point))
        here = self._Values(point)

        def SecondDifference(way: Array) -> Array:
            second = self._Values(point + way) - 2 * here + self._Values(point - way)
            return second / np.abs(way).max()

        # The difference of the slopes on both sides. For a smooth law it is
        # proportional to the distance; the limit at the distance 0 is extrapolated.
        bend = 2 * SecondDifference(way / 2) - SecondDifference(way)
        # Evaluated last, so that the Contexts stay at the operating point.
        self._Values(point)
        rounding = _ROUNDING * np.abs(here) + _NOTHING
        bent: dict[int, str] = {}
        begin = 0
        for owner, size in self._owners:
            part = slice(begin, begin + size)
            largest = np.abs(bend[part]).max(initial=0)
            own = np.abs(slopes[part]).max(initial=0)
            if largest > _BEND * own + rounding[part].max(initial=0):
                bent |= dict.fromkeys(range(begin, begin + size), self.PathOf(owner))
            begin += size
        return bent

    def PathOf(self, system: System) -> str:
        """Returns the path of a block of the diagram."""
        return next(block.path for block in self.blocks if block.system is system)

    def _Point(self) -> Array:
        """Returns states and inputs at the operating point (N)."""
        for system, context in self.contexts.items():
            if context.get_accuracy() is None and SurfacesOf(system):
                # The environment's region then follows from the position, instead of
                # the one that the Context holds.
                system.ExecuteInitializationEvents(context)
        return np.concatenate([np.zeros(0), *(x.Get() for x in self._entries)])

    def _Exact(self, point: Array) -> tuple[Array, Array] | None:
        """Returns values and slopes by AutoDiffXd; None if a block does not convert."""
        if self._dual is None or not self._dual.twins:
            return None
        self._dual.SetFrom(self._root)
        seeds = InitializeAutoDiff(point, np.eye(len(point))).ravel()
        try:
            y = self._Evaluate(self._dual.twins, seeds)
        except (TypeError, KeyError, NotConverted):
            # A block does not convert, or a function does not accept AutoDiffXd,
            # perhaps on a branch that is taken for the first time.
            self._UseDifferences()
            if not self.by_differences:
                raise
            return None
        slopes = ExtractGradient(y)
        if slopes.size == 0:  # No value depends on the point.
            slopes = np.zeros((len(y), len(point)))
        return ExtractValue(y).ravel(), slopes

    def _Values(self, point: Array) -> Array:
        """Returns the values at a point (K), evaluated by the original diagram."""
        return self._Evaluate(self._originals, point)

    def _Evaluate(self, twins: Twins, point: Array) -> Array:
        """Returns the values at a point (K), of the scalar type of the twins."""
        parts = dict(zip(self._entries, Split(self._entries, point), strict=True))
        # In reverse order, so that the first of two cuts at the same port is effective.
        for x in reversed(self._entries):
            x.SetIn(twins, parts[x])
        values = []
        for states in self._states:
            values.append(states.NextIn(twins))
        for port in self._seen:
            if isinstance(port, Cut):
                values.append(parts[port])
            else:
                twin = twins[port.get_system()]
                values.append(twin.PortOf(port).Eval(twin.context))
        return np.concatenate(values)

    def _CutOrPort(self, port: Port, cuts: Sequence[Cut]) -> Cut | Port:
        """Returns the source of an observed signal: the cut at a delay, or a port."""
        if isinstance(port, InputPort):
            return LeafInputs(port)[0]
        source = self._SourceOf(port)
        system = self.blocks[source.block].system
        cut = next((cut for cut in cuts if cut.delay is system), None)
        return cut or system.GetOutputPort(source.port)

    def _OwnerOf(self, seen: Cut | Port) -> System:
        """Returns the block that computes an observed signal, or receives it."""
        if not isinstance(seen, Cut):
            return seen.get_system()
        assert seen.delay is not None
        return seen.delay

    def _UseDifferences(self) -> None:
        """Switches to central differences and lists the blocks that do not convert."""
        assert self._dual is not None
        self.by_differences = tuple(
            block.path
            for block in self.needed
            if block.system in self._dual.mismatched
            or not Converts(block.system, self.contexts[block.system])
        )
        self._dual = None

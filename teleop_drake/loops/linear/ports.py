"""The linear model of any diagram between two of its ports, with its exact delays.

Drake's Linearize() accepts only continuous states. LinearizePorts() holds modes
constant, retains delays as exact delays, and lifts sampled loops exactly. The slopes
are computed by AutoDiffXd, or by central differences if a block does not convert; the
model then contains the block's path. DelayMargin() returns the delay that a loop
tolerates at one of its ports.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from pydrake.systems.framework import (
    Context,
    Diagram,
    InputPort,
    OutputPort,
    System,
)

from teleop_drake.loops.engine.flatten import Block
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.signals import CheckContext
from teleop_drake.loops.framework.surface import SurfacesOf
from teleop_drake.loops.framework.validation import CheckKind, Refuse, ScenarioError
from teleop_drake.loops.kernel.linear_part import LinearPartOf, Sampling
from teleop_drake.loops.linear.cut_diagram import Cut, CutDiagram, Port, Split, TimesOf
from teleop_drake.loops.linear.port_model import PortModel
from teleop_drake.loops.linear.sampled_model import (
    HeldIn,
    MakeSampledLoop,
    SampledModel,
)
from teleop_drake.loops.linear.states import HeldStates, States
from teleop_drake.loops.numerics.state_space import close_loops

# The longest step of central differences, relative to values of 1 and more. Surfaces
# must be farther away.
_STEP = 1e-4

# The largest derivative at an equilibrium, as in Drake's Linearize().
_AT_REST = 1e-6


def LinearizePorts(
    diagram: Diagram,
    context: Context,
    input_port: InputPort | OutputPort,
    output_port: OutputPort | None = None,
    *,
    is_opened: bool = False,
    is_settled: bool = False,
    is_moving: bool = False,
) -> Any:
    """Linearises a diagram from one of its ports to another one, at any depth.

    A deviation is added to the signal that the input port receives, as in a closed
    loop. With `is_opened` it replaces the signal, so that the loop is open there.
    Without `output_port` the model is then the loop transfer function L at the port,
    with the sign of negative feedback: it is minus the signal that comes back, and the
    loop has the closed-loop response L/(1 + L).

    Every continuous state is a state of the model, including the estimates of an
    adaptive law. A TransportDelay is an exact delay, and so is a VariableDelay whose
    delay is an input, with its value at the operating point. The mode of an operator
    and the layer of an environment are held constant.

    The operating point is a Context at its time, in general an equilibrium; nothing is
    trimmed. The diagram's own inputs have the values of that Context, or are 0. The
    model is valid for small deviations from this point.

    Args:
        diagram: Any diagram with at least one continuous state or delay.
        context: The operating point, a Context of this diagram, for example from a
            Simulator. It is not changed.
        input_port: The port at which the deviation acts, of the diagram or of a system
            in it. For an output port, it acts at all ports that receive its signal.
        output_port: The port that is observed, of the diagram or of a system in it. By
            default it is the source of the input port's signal, and with `is_opened`
            the model is L.
        is_opened: Whether the deviation replaces the signal that the port receives.
        is_settled: Whether the output of each delay is set to its input, as at rest,
            instead of its value in the Context.
        is_moving: Whether the operating point may be an instant of a motion. The model
            then describes this instant, and no stability of the motion follows from it.

    Returns:
        The PortModel; a SampledModel if a discrete state of the diagram has a periodic
        update, as that of a hold, a sampled law, or a SampledDelay. A SampledModel is
        that of a loop only: with `is_opened` and without `output_port`.

    Raises:
        ValueError: If a port is not in the diagram, a block has other samples (a
            channel of packets, a delay by a profile or a conveyor, a discrete
            MultibodyPlant), a delay that is an input is out of its range, the operating
            point is no equilibrium and `is_moving` is not set, or a law bends
            there.
    """
    _CheckKinds(diagram, context, input_port, output_port)
    function = CutDiagram(diagram, CopyContext(diagram, context))
    for port in (input_port, output_port or input_port):
        if port.get_system() not in function.contexts:
            Refuse("port", _PathOf(port), "one in the diagram")
    opened = OpenDiagram(function, [input_port, output_port or input_port])
    if opened.samples and not (is_opened and output_port is None):
        names = ", ".join(map(function.PathOf, opened.samples))
        allowed = f"True, and output_port left out, because {names} takes samples"
        Refuse("is_opened", is_opened, allowed)
    if is_settled:
        opened.Settle()
    entry = function.CutAt(input_port)
    if not entry.ports:
        Refuse("port", _PathOf(input_port), "connected to another system")
    seen = output_port or entry.entering
    if seen is None:
        Refuse("output_port", None, "given, because the input is not connected")
    # The first output is the input port's own signal, if the loop stays closed.
    entering = [] if is_opened or entry.entering is None else [entry.entering]
    slopes = opened.Slopes([entry], [*entering, seen], is_moving=is_moving)
    for path in function.Bends(slopes).values():
        RefuseBend(context, path)
    slopes = opened.CloseZeroDelays(slopes)
    if opened.samples:
        return SampledModel(
            loop=MakeSampledLoop(
                slopes, opened.states, opened.sampled, opened.delays, opened.samplers
            ),
            by_differences=function.by_differences,
            held=opened.held,
        )
    n = sum(x.size for x in opened.states)
    # The loop is closed: the input is the deviation plus the port's own signal.
    back = n + np.arange(input_port.size() if entering else 0)
    model = PortModel(
        matrix=np.delete(close_loops(slopes, back), back, axis=0),
        num_states=n,
        delays=TimesOf(opened.delays),
        by_differences=function.by_differences,
        held=opened.held,
        is_loop=is_opened and output_port is None,
    )
    return -model if model.is_loop else model


def DelayMargin(
    diagram: Diagram,
    context: Context,
    port: InputPort | OutputPort,
    *,
    is_moving: bool = False,
) -> float:
    """Returns the additional delay in s that a loop tolerates at a port.

    The loop is stable if the signal at the port is delayed by less than this. All
    delays are exact. Stable means that small deviations from an equilibrium decay.

    Args:
        diagram: A diagram that LinearizePorts() accepts.
        context: The equilibrium, a Context of this diagram. The output of each delay is
            set to its input there. The Context is not changed.
        port: The port of a system in the diagram. For an output port, the delay acts on
            all ports that receive its signal.
        is_moving: Whether the Context may be an instant of a motion; see
            LinearizePorts().

    Returns:
        The margin; 0 if the loop is unstable without additional delay, infinity if it
        is stable with every delay. LinearizePorts(..., is_opened=True).margins()
        returns further margins, and what would stabilise an unstable loop. Where a
        block samples, the delay is searched up to 40 of the shortest period; infinity:
        there is no limit up to there.

    Raises:
        ValueError: As in LinearizePorts(), and if a delay is in a loop without a hold
            while another loop has one.
    """
    model = LinearizePorts(
        diagram, context, port, is_opened=True, is_settled=True, is_moving=is_moving
    )
    return model.margins(remedies=False).delay


def CheckPoint(diagram: Any, context: Any) -> None:
    """Refuses a diagram or a Context of another class, or of another diagram.

    Raises:
        ValueError: If an argument is of another class, or the Context is that of
            another diagram.
    """
    allowed = "a Diagram; of a scenario, AnalyzeStability(scenario) finds the margins"
    CheckKind("diagram", diagram, System, allowed)
    CheckContext(diagram, context)


def _CheckKinds(diagram: Any, context: Any, input_port: Any, output_port: Any) -> None:
    """Refuses arguments of LinearizePorts() that are of other classes.

    Raises:
        ValueError: As CheckPoint(), and if a port is of another class.
    """
    CheckPoint(diagram, context)
    allowed = (
        "an InputPort or OutputPort in the diagram, such as "
        f"diagram.GetSubsystemByName({_NameIn(diagram)!r}).get_output_port()"
    )
    for port in (input_port, output_port or input_port):
        CheckKind("port", port, InputPort | OutputPort, allowed)


def _NameIn(diagram: System) -> str:
    """Returns the name of the first system in a diagram that has an output."""
    parts = diagram.GetSystems() if isinstance(diagram, Diagram) else []
    return next((x.get_name() for x in parts if x.num_output_ports() > 0), "plant")


@dataclass(eq=False)
class OpenedDiagram:
    """A diagram that is cut open at its delays and samplers, at an operating point.

    Attributes:
        function: The diagram as a function.
        states: The continuous states.
        sampled: The discrete states that periodic updates change.
        delays: The cuts at the delays.
        samplers: The cuts at the blocks that sample and delay.
        held: Paths of the blocks whose discrete state is held constant.
    """

    function: CutDiagram
    states: list[States]
    sampled: list[HeldStates]
    delays: list[Cut]
    samplers: list[tuple[Cut, Sampling]]
    held: tuple[str, ...]

    @property
    def cuts(self) -> list[Cut]:
        """The cuts at delays and samplers."""
        return [*self.delays, *(cut for cut, _ in self.samplers)]

    @property
    def samples(self) -> list[System]:
        """The blocks that sample."""
        cuts = [cut.delay for cut, _ in self.samplers if cut.delay is not None]
        return [*(x.system for x in self.sampled), *cuts]

    def Settle(self) -> None:
        """Sets the output of each delay to its input, also of delays in series."""
        # In each round a value passes one more delay.
        for _ in self.cuts:
            before = [cut.value.tolist() for cut in self.cuts]
            for cut in self.cuts:
                cut.Settle()
            if [cut.value.tolist() for cut in self.cuts] == before:
                return

    def Slopes(
        self, cuts: Sequence[Cut], seen: Sequence[Port], *, is_moving: bool
    ) -> Array:
        """Returns the slopes of [rates; discrete states; seen; signals into delays].

        They are those by [states; discrete states; signals at the cuts; signals that
        leave the delays]. A discrete state has its value after the next update.

        Args:
            cuts: Further cuts.
            seen: The ports that are observed.
            is_moving: Whether the operating point may be an instant of a motion.

        Raises:
            ValueError: If the operating point is no equilibrium. There all rates are 0,
                an update changes no discrete state, and each delay delivers the signal
                that enters it.
        """
        states: list[States | HeldStates] = [*self.states, *self.sampled]
        for x in states:
            if not np.isfinite(x.Get()).all():  # As that of a block before a run.
                path = self.function.PathOf(x.system)
                Refuse(f"context: state of {path}", x.Get(), "finite")
        late = [cut.entering for cut in self.cuts if cut.entering is not None]
        for cut in self.delays:
            longest = cut.delay and LinearPartOf(cut.delay).delay
            if cut.steering is not None and longest and not 0 <= cut.time <= longest:
                path = self.function.PathOf(cut.steering.get_system())
                Refuse(f"context: delay of {path}", cut.time, f"0 to {longest:g} (s)")
        self.function.Choose(states, [*cuts, *self.cuts], [*seen, *late])
        values, slopes = self.function.Evaluate(_STEP)
        if not is_moving:
            self._CheckRest(values)
        return slopes

    def CloseZeroDelays(self, slopes: Array) -> Array:
        """Returns the slopes with the outputs of delays of 0 s closed to their inputs.

        These delays are no longer among `delays`.

        Args:
            slopes: The result of Slopes().

        Raises:
            ValueError: If a signal then depends on itself.
        """
        first = len(slopes) - len(TimesOf(self.cuts))
        closed = first + np.flatnonzero(np.array(TimesOf(self.delays)) == 0)
        self.delays = [cut for cut in self.delays if cut.time > 0]
        slopes = close_loops(slopes, closed)
        return np.delete(np.delete(slopes, closed, axis=0), closed, axis=1)

    def _CheckRest(self, values: Array) -> None:
        """Raises a ValueError if the values are not those of an equilibrium."""
        parts = Split([*self.states, *self.sampled], values)
        changes = [
            (x.system, "a derivative of", rate)
            for x, rate in zip(self.states, parts, strict=False)
        ]
        changes += [
            (x.system, "a discrete state that changes by", new - x.Get())
            for x, new in zip(self.sampled, parts[len(self.states) :], strict=True)
        ]
        entering = values[len(values) - len(TimesOf(self.cuts)) :]
        changes += [
            (cut.delay, "an output that differs from its input by", u - cut.value)
            for cut, u in zip(self.cuts, Split(self.cuts, entering), strict=True)
        ]
        largest = max(changes, key=lambda x: np.abs(x[2]).max(), default=None)
        if largest is None or np.abs(largest[2]).max() <= _AT_REST:
            return
        system, name, change = largest
        k = int(np.abs(change).argmax())
        raise ScenarioError(
            f"context = {self.function.PathOf(system)!r} with {name} {change[k]:.4g} "
            f"(element {k}): must be an equilibrium, with each delay at its input "
            "(is_settled=True); is_moving=True takes an instant of a motion"
        )


def OpenDiagram(function: CutDiagram, ports: Sequence[Port]) -> OpenedDiagram:
    """Opens a diagram at its delays and samplers.

    Args:
        function: The diagram at the operating point.
        ports: Ports of the model; blocks without influence on them, on a continuous
            state or on a delay are left out.

    Raises:
        ValueError: If a block has another kind of state.
    """
    blocks = function.BlocksFor(ports)
    held, sampled = _Discrete(blocks, function.contexts)
    return OpenedDiagram(
        function=function,
        states=[
            States(block.system, function.contexts[block.system], size)
            for block in blocks
            if (size := block.system.num_continuous_states())
        ],
        sampled=sampled,
        delays=[
            function.CutAtDelay(block.system)
            for block in blocks
            if LinearPartOf(block.system).delay
        ],
        samplers=[
            (function.CutAtDelay(block.system, sampling.delay), sampling)
            for block in blocks
            if (sampling := LinearPartOf(block.system).sampling) is not None
        ],
        held=held,
    )


def RefuseBend(context: Context, path: str) -> NoReturn:
    """Refuses an operating point at which the law of a block has no slope."""
    allowed = f"where every law has one slope; that of {path!r} bends, as at a surface"
    Refuse("context", f"at {context.get_time():g} s", allowed)


def CopyContext(diagram: Diagram, context: Context) -> Context:
    """Returns a copy of a Context; inputs of the diagram without a value are 0."""
    own = diagram.CreateDefaultContext()
    own.SetTimeStateAndParametersFrom(context)
    diagram.FixInputPortsFrom(diagram, context, own)
    for i in range(diagram.num_input_ports()):
        port = diagram.get_input_port(i)
        if not port.HasValue(own):
            port.FixValue(own, np.zeros(port.size()))
    return own


def _PathOf(port: InputPort | OutputPort) -> str:
    """Returns the path of a port's system, followed by the port's name."""
    return f"{port.get_system().GetSystemPathname()}:{port.get_name()}"


def _Discrete(
    blocks: list[Block], contexts: Mapping[System, Context]
) -> tuple[tuple[str, ...], list[HeldStates]]:
    """Returns the paths of blocks whose discrete state is constant, and other states.

    The other states are those of blocks with one periodic update.

    Raises:
        ValueError: If a block has a state of another kind.
    """
    held = []
    sampled = []
    for block in blocks:
        context = contexts[block.system]
        described = LinearPartOf(block.system)
        groups = context.num_discrete_state_groups() + context.num_abstract_states()
        is_cut = described.delay is not None or described.sampling is not None
        if groups == 0 or is_cut:
            continue
        if described.has_modes or SurfacesOf(block.system) is not None:
            held.append(block.path)
            continue
        states = HeldIn(block.system, context)
        if states is None:
            allowed = (
                "without packets, delays by a profile or a conveyor, discrete plants "
                "and several updates: a discrete state has a linear model if one "
                "periodic update changes it"
            )
            Refuse("diagram", block.path, allowed)
        sampled.append(states)
    return tuple(held), sampled

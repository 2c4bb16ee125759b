"""The linear model of any diagram between two of its ports, with its exact delays.

Drake's own Linearize() takes continuous states only. LinearizePorts() holds modes, cuts
delays open and retains them as delays; the slopes are those of AutoDiffXd. If a block
does not convert to AutoDiffXd, the slopes are central differences, and the model names
the block. DelayMargin() returns the delay that a loop tolerates at one of its ports.
"""

from collections.abc import Mapping

import numpy as np
from pydrake.systems.framework import (
    Context,
    Diagram,
    InputPort,
    OutputPort,
    System,
)

from teleop_drake.analysis.cut_diagram import CutDiagram, States, TimesOf
from teleop_drake.analysis.port_model import PortModel
from teleop_drake.blocks.environments import SurfacesOf
from teleop_drake.engine.flatten import Block
from teleop_drake.kernel.linear_part import LinearPartOf
from teleop_drake.numerics.state_space import close_loops
from teleop_drake.validation import Refuse

# The longest difference for blocks that do not convert to AutoDiffXd, as a share of a
# value of 1 and more. No surface may be as near.
_STEP = 1e-4


def LinearizePorts(
    diagram: Diagram,
    context: Context,
    input_port: InputPort | OutputPort,
    output_port: OutputPort | None = None,
    *,
    is_opened: bool = False,
    is_settled: bool = False,
) -> PortModel:
    """Linearises a diagram from one of its ports to another one, at any depth.

    A deviation is added to what the input port receives, as in a closed loop, or takes
    its place: then the loop is open there. Every continuous state is one of the model,
    the estimates of an adaptive law as well. What a TransportDelay holds is delayed
    exactly. The mode of an operator and the layer of an environment stay as they are.

    The operating point is a Context, at its time: nothing is trimmed. The diagram's own
    inputs have the values of that Context, or are 0. Deviations obey the model as long
    as the diagram does not move far from there.

    Args:
        diagram: Any, with at least one continuous state or delay.
        context: The operating point, of this diagram: from a Simulator, say; it is not
            changed.
        input_port: Where the deviation is: of a system in the diagram, or its own. Of
            an output port, it is at all ports that receive its signal.
        output_port: Where it is seen: of a system in the diagram, or its own. None:
            where the input comes from.
        is_opened: Whether the deviation takes the place of what the port receives.
        is_settled: Whether each delay delivers what goes into it, as at rest, instead
            of what it delivers in the Context.

    Returns:
        The model.

    Raises:
        ValueError: If a port is not in the diagram, a block holds samples (a channel of
            packets, a delay that varies), or a law bends at the operating point.
    """
    function = CutDiagram(diagram, _CopyContext(diagram, context))
    blocks = function.blocks
    contexts = function.contexts
    for port in (input_port, output_port or input_port):
        if port.get_system() not in contexts:
            Refuse("port", _PathOf(port), "one in the diagram")
    held = _Held(blocks, contexts)
    delays = [
        function.CutAtDelay(block.system)
        for block in blocks
        if LinearPartOf(block.system).delay
    ]
    if is_settled:
        # A value passes one more delay each time.
        for cut in delays * len(delays):
            cut.Settle()
    entry = function.CutAt(input_port)
    if not entry.ports:
        Refuse("port", _PathOf(input_port), "connected to another system")
    seen = output_port or entry.entering
    if seen is None:
        Refuse("output_port", None, "given, because the input is not connected")
    states = [
        States(block.system, contexts[block.system], size)
        for block in blocks
        if (size := block.system.num_continuous_states())
    ]
    # What the input port receives without a deviation comes first, where it counts.
    entering = [] if is_opened or entry.entering is None else [entry.entering]
    late = [cut.entering for cut in delays if cut.entering is not None]
    function.Choose(states, [entry, *delays], [*entering, seen, *late])
    _, slopes = function.Evaluate(_STEP)
    if function.Bends(slopes):
        allowed = "where every law has one slope; one bends here, as at a surface"
        Refuse("context", f"at {context.get_time():g} s", allowed)
    n = sum(x.size for x in states)
    # What is added to a signal that comes back goes around the loop.
    back = n + np.arange(input_port.size() if entering else 0)
    return PortModel(
        matrix=np.delete(close_loops(slopes, back), back, axis=0),
        num_states=n,
        delays=TimesOf(delays),
        by_differences=function.by_differences,
        held=held,
        is_opened=is_opened,
    )


def DelayMargin(
    diagram: Diagram, context: Context, port: InputPort | OutputPort
) -> float:
    """Returns the delay in s that a loop tolerates at a port, besides those in it.

    The loop is stable if the signal at the port comes less than this later. All delays
    are exact. Stable means that small deviations from an equilibrium decay.

    Args:
        diagram: Any that LinearizePorts() linearises.
        context: The equilibrium, of this diagram; each delay delivers there what goes
            into it. It is not changed.
        port: Of a system in the diagram. Of an output port, the signal comes later to
            all ports that receive it.

    Returns:
        The margin; 0 if the loop is unstable as it is, infinity if it is stable with
        every delay. LinearizePorts(..., is_opened=True).margins() tells more.

    Raises:
        ValueError: As LinearizePorts() does.
    """
    model = LinearizePorts(diagram, context, port, is_opened=True, is_settled=True)
    return model.margins().delay


def _CopyContext(diagram: Diagram, context: Context) -> Context:
    """Returns a copy of a Context that has values at the diagram's inputs."""
    own = diagram.CreateDefaultContext()
    own.SetTimeStateAndParametersFrom(context)
    diagram.FixInputPortsFrom(diagram, context, own)
    for i in range(diagram.num_input_ports()):
        port = diagram.get_input_port(i)
        if not port.HasValue(own):
            port.FixValue(own, np.zeros(port.size()))
    return own


def _PathOf(port: InputPort | OutputPort) -> str:
    """Returns a port's name behind the path of its system."""
    return f"{port.get_system().GetSystemPathname()}:{port.get_name()}"


def _Held(blocks: list[Block], contexts: Mapping[System, Context]) -> tuple[str, ...]:
    """Returns what has a discrete state that is held; refuses other such blocks."""
    held = []
    for block in blocks:
        context = contexts[block.system]
        described = LinearPartOf(block.system)
        groups = context.num_discrete_state_groups() + context.num_abstract_states()
        if groups == 0 or described.delay is not None:
            continue
        if not described.has_modes and SurfacesOf(block.system) is None:
            allowed = (
                "without samples: a block whose state is not continuous has no "
                "linear model, exact delays apart"
            )
            Refuse("diagram", block.path, allowed)
        held.append(block.path)
    return tuple(held)

"""The linear model of any diagram between two of its ports, with its exact delays.

Drake's own Linearize() takes continuous states only. LinearizePorts() holds modes, cuts
delays open and retains them as delays; the slopes are those of AutoDiffXd. If a block
does not convert to AutoDiffXd, the slopes are central differences, and the model names
the block.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import (
    Context,
    Diagram,
    InputPort,
    OutputPort,
)

from teleop_drake.analysis.cut_diagram import (
    Contexts,
    Cut,
    CutAtDelay,
    CutDiagram,
    LeafPorts,
    States,
)
from teleop_drake.arrays import Array, ComplexArray
from teleop_drake.blocks.environments import SurfacesOf
from teleop_drake.contexts import ContextsIn
from teleop_drake.engine.flatten import Block, Flatten
from teleop_drake.kernel.linear_part import LinearPartOf
from teleop_drake.numerics.state_space import StateSpace
from teleop_drake.validation import Refuse

# The longest difference for blocks that do not convert to AutoDiffXd, as a share of a
# value of 1 and more. No surface may be as near.
_STEP = 1e-4


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PortModel:
    """What small deviations at one port of a diagram do at another one.

    With the deviations u at the input, y at the output, x of the diagram's continuous
    states in their order, and d of what the delays T_i deliver,

        [y, what goes into the delays] = model(s) [u, d]
        d_i(t) = what goes into delay i, at t - T_i

    Attributes:
        model: From [u, d] to [y, what goes into the delays].
        delays: T_i in s, an entry for each signal.
        by_differences: Paths of the blocks that do not convert to AutoDiffXd. If there
            is one, all slopes are central differences.
        held: Systems with a mode or a layer, which is held.
    """

    model: StateSpace
    delays: tuple[float, ...]
    by_differences: tuple[str, ...]
    held: tuple[str, ...]

    def __repr__(self) -> str:
        """Returns sizes and delays on one line, without matrices."""
        num_outputs, num_inputs = (
            size - len(self.delays) for size in self.model.D.shape
        )
        delays = ", ".join(f"{delay:g}" for delay in sorted(set(self.delays)))
        names = ", ".join(self.by_differences)
        return (
            f"PortModel({num_inputs} -> {num_outputs}, {self.model.num_states} states, "
            f"delays [{delays}] s, {len(self.held)} held"
            + (f", by differences: {names})" if names else ")")
        )

    def Response(self, frequencies: ArrayLike) -> ComplexArray:
        """Returns the frequency response from u to y, (M, size of y, size of u).

        Args:
            frequencies: (M,) in rad/s, none of them an undamped mode.
        """
        return self.model.delayed_response(self.delays, frequencies)


def LinearizePorts(
    diagram: Diagram,
    context: Context,
    input_port: InputPort,
    output_port: OutputPort,
    *,
    is_opened: bool = False,
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
        input_port: Where the deviation is: of a system in the diagram, or its own.
        output_port: Where it is seen: of a system in the diagram, or its own.
        is_opened: Whether the deviation takes the place of what the port receives.

    Returns:
        The model.

    Raises:
        ValueError: If a port is not in the diagram, a block holds samples (a channel of
            packets, a delay that varies), or a law bends at the operating point.
    """
    own = _CopyContext(diagram, context)
    contexts = ContextsIn(diagram, own)
    for port in (input_port, output_port):
        if port.get_system() not in contexts:
            Refuse("port", port.GetFullDescription(), "one in the diagram")
    blocks = Flatten(diagram)
    held = _Held(blocks, contexts)
    entry = _CutAtPort(blocks, input_port, contexts)
    delays: list[float] = []
    delay_cuts = []
    states = []
    for block in blocks:
        delay = LinearPartOf(block.system).delay
        if delay:
            cut = CutAtDelay(blocks, block.system, contexts)
            delay_cuts.append(cut)
            delays += [delay] * len(cut.value)
        size = block.system.num_continuous_states()
        if size:
            block_context = contexts[block.system]
            states.append(States(block.system, block_context, size))
    # What the input port receives without a deviation comes first, where it counts.
    entering = [] if is_opened or entry.entering is None else [entry.entering]
    function = CutDiagram(
        diagram,
        contexts,
        states=states,
        cuts=[entry, *delay_cuts],
        seen=[*entering, output_port, *(cut.entering for cut in delay_cuts)],
    )
    _, slopes = function.Evaluate(_STEP)
    if function.Bends(_STEP, slopes):
        allowed = "where every law has one slope; one bends here, as at a surface"
        Refuse("context", f"at {context.get_time():g} s", allowed)
    num_states = sum(x.size for x in states)
    model = _ModelOf(slopes, num_states)
    if entering:
        model = _WithAddedInput(model, input_port.size())
    return PortModel(
        model=model,
        delays=tuple(delays),
        by_differences=function.by_differences,
        held=held,
    )


def _CopyContext(diagram: Diagram, context: Context) -> Context:
    """Returns a copy of a Context that has values at the diagram's inputs."""
    own = diagram.CreateDefaultContext()
    own.SetTimeStateAndParametersFrom(context)
    for i in range(diagram.num_input_ports()):
        port = diagram.get_input_port(i)
        is_known = port.HasValue(context)
        port.FixValue(own, port.Eval(context) if is_known else np.zeros(port.size()))
    return own


def _CutAtPort(blocks: list[Block], port: InputPort, contexts: Contexts) -> Cut:
    """Returns the cut at an input port, with what it receives now."""
    leaves = LeafPorts(port)
    leaf = leaves[0]
    system = leaf.get_system()
    (block,) = (x for x in blocks if x.system is system)
    source = block.inputs.get(leaf.get_name())
    entering = None
    if source is not None:
        entering = blocks[source.block].system.GetOutputPort(source.port)
    has_value = leaf.HasValue(contexts[system])
    value = leaf.Eval(contexts[system]) if has_value else np.zeros(leaf.size())
    return Cut(leaves, contexts, entering, np.array(value))


def _ModelOf(slopes: Array, num_states: int) -> StateSpace:
    """Returns the model whose rows and columns begin with the states."""
    n = num_states
    return StateSpace(
        A=slopes[:n, :n], B=slopes[:n, n:], C=slopes[n:, :n], D=slopes[n:, n:]
    )


def _WithAddedInput(model: StateSpace, size: int) -> StateSpace:
    """Returns the model whose first input is added to what the port receives.

    Args:
        model: From [what the port receives, d] to [what comes to the port, y, what goes
            into the delays].
        size: Width of the port.
    """
    # The loop is closed through a copy of the first input.
    both = StateSpace(
        A=model.A,
        B=np.hstack([model.B[:, :size], model.B]),
        C=model.C,
        D=np.hstack([model.D[:, :size], model.D]),
    )
    return both.closed(np.arange(size))


def _Held(blocks: list[Block], contexts: Contexts) -> tuple[str, ...]:
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

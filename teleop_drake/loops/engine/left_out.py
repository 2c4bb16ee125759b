"""The blocks that a program leaves out, because nothing depends on them."""

from collections.abc import Iterable, Mapping, Sequence

from pydrake.systems.framework import Context, OutputPort, System

from teleop_drake.loops.engine.flatten import (
    Block,
    OutputOf,
    Reached,
    UnsupportedSystem,
)
from teleop_drake.loops.engine.primitives import IsSilent, IsSink
from teleop_drake.loops.framework.wiring import InputPorts
from teleop_drake.loops.kernel import Kernel


def FindLeftOut(
    blocks: Sequence[Block],
    contexts: Mapping[System, Context],
    obstacles: Mapping[int, UnsupportedSystem],
    *,
    recorded: Iterable[OutputPort],
    needs_states: bool,
) -> set[int]:
    """Returns the indices of the blocks that a program leaves out.

    They are the sinks, see IsSink(), and the blocks without a kernel together with all
    blocks that depend on them.

    Args:
        blocks: The blocks, from Flatten().
        contexts: The Context of each system.
        obstacles: The reason why a block of Drake's has no kernel, by its index.
        recorded: The output ports of the recorded signals.
        needs_states: Whether a block with a state must not be left out, although no
            recorded signal depends on it.

    Raises:
        UnsupportedSystem: If a block without a kernel cannot be left out: a recorded
            signal, or code of a user's own, depends on it.
    """
    left_out = {
        i
        for i, block in enumerate(blocks)
        if i not in obstacles and IsSink(block.system, contexts[block.system])
    }
    if not obstacles:
        return left_out
    needed = {
        OutputOf(blocks, port.get_system(), int(port.get_index())).block
        for port in recorded
    }
    for i, block in enumerate(blocks):
        has_state = needs_states and HasState(contexts[block.system])
        is_own = _IsOwn(block.system)
        if has_state or (is_own and not IsSilent(block.system, contexts[block.system])):
            needed.add(i)
    receivers: dict[int, list[int]] = {i: [] for i, _ in enumerate(blocks)}
    for i, block in enumerate(blocks):
        for source in block.inputs.values():
            receivers[source.block].append(i)
    for i, obstacle in obstacles.items():
        dependents = Reached([i], receivers)
        if dependents & needed:
            raise obstacle
        left_out |= dependents
    return left_out


def HasState(context: Context) -> bool:
    """Returns whether a Context has a state of numbers, continuous or discrete."""
    has_discrete = context.num_discrete_state_groups() > 0
    return has_discrete or context.num_continuous_states() > 0


def _IsOwn(system: System) -> bool:
    """Returns whether a user has written a block."""
    return type(system).__module__.partition(".")[0] not in ("pydrake", "teleop_drake")


def EmptyKernel(system: System) -> Kernel:
    """Returns the kernel of a block that is left out: its state remains as it is."""
    inputs = tuple(port.get_name() for port in InputPorts(system))
    size = system.num_continuous_states()
    if size == 0:
        return Kernel(unused=inputs)
    return Kernel(unused=inputs, rate="at rest", parameters={"at rest": size * [0.0]})

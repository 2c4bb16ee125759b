"""Comparison of kernels with their blocks at an instant."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, Diagram, PortDataType, System

from teleop_drake.compiler.check_run import CheckRun, KernelDisagrees
from teleop_drake.compiler.engine import Visited
from teleop_drake.compiler.evaluator import Evaluator
from teleop_drake.contexts import ContextsIn

__all__ = ["CheckKernel", "CheckNear", "CheckVisited", "Compare", "KernelDisagrees"]

Array = NDArray[np.float64]

# Between what a kernel and its block compute, as a share of the largest element; the
# order of their operations differs.
_TOLERANCE = 1e-9


def CheckKernel(system: System, *, num_states: int = 10) -> list[str]:
    """Checks the kernel of a block, or those of all blocks in a diagram.

    Outputs and time derivatives are compared at random inputs, states and times, and in
    the modes that the kernels get into there. A block by itself is compiled, too, where
    the extra `fast` is installed. If it has transitions or delays it is run as well,
    with sinusoids at its inputs, in Drake's Simulator and by its kernel: they show
    whether its modes change when and as they should. For that it becomes part of a
    diagram, and cannot be part of another one.

    Returns:
        The transitions, by the names in the kernel, that did not happen in the run and
        were therefore not compared with the block; see Transition.

    Raises:
        UnsupportedSystem: If a block offers no kernel, or one that cannot be compiled.
        KernelDisagrees: If a kernel is wrong; it names the block and what differs.
    """
    context = _DefaultContext(system)
    is_block = not isinstance(system, Diagram)
    evaluator = Evaluator(system, context)
    evaluators = [evaluator]
    rng = np.random.default_rng(0)
    for _ in range(num_states):
        for i in range(system.num_input_ports()):
            port = system.get_input_port(i)
            if port.get_data_type() == PortDataType.kVectorValued:
                port.FixValue(context, rng.normal(size=port.size()))
        context.SetTime(rng.uniform(0, 1))
        x = context.get_continuous_state_vector().CopyToVector()
        context.SetContinuousState(_Near(x, rng))
        if is_block and len(evaluators) == 1:
            evaluators.append(Evaluator(system, context, as_machine_code=True))
        for each in evaluators:
            Compare(each, system, context)
        if _ChangeModes(evaluator, context):
            for each in evaluators:
                Compare(each, system, context)
    program = evaluator.program
    if not is_block or not (program.transitions or program.delays):
        return []
    return CheckRun(system)


def _ChangeModes(evaluator: Evaluator, context: Context) -> bool:
    """Makes the transitions that are due in a context; returns whether any is.

    A periodic one is taken for due.
    """
    y, _ = evaluator.Evaluate(context)
    program = evaluator.program
    _, m, _ = evaluator.ReadContext(context)
    before = m.copy()
    for _, guard, source, target in program.transitions:
        if guard is None or y[guard][0] >= 0:
            m[target] = np.where(y[source] != before[target], y[source], m[target])
    _SetModes(evaluator, context, m)
    return not np.array_equal(m, before)


def _SetModes(evaluator: Evaluator, context: Context, m: Array) -> None:
    """Sets all discrete states."""
    contexts = ContextsIn(evaluator.system, context)
    for block, part in zip(evaluator.blocks, evaluator.program.modes, strict=True):
        own = contexts[block.system]
        first = part.start
        for i in range(own.num_discrete_state_groups()):
            size = own.get_discrete_state(i).size()
            own.SetDiscreteState(i, m[first : first + size])
            first += size


def CheckNear(
    evaluator: Evaluator, system: System, context: Context, *, num_states: int = 2
) -> None:
    """Checks an Evaluator at random states around a Context.

    Args:
        context: Its context, which is left as it is.

    Raises:
        KernelDisagrees: If a kernel is wrong; it names the block and what differs.
    """
    rng = np.random.default_rng(0)
    x = context.get_continuous_state_vector().CopyToVector()
    try:
        for _ in range(num_states):
            context.SetContinuousState(_Near(x, rng))
            try:
                Compare(evaluator, system, context)
            except KernelDisagrees:
                raise
            except Exception:
                if not _Raises(system, context):
                    raise
    finally:
        context.SetContinuousState(x)


def CheckVisited(
    evaluator: Evaluator, system: System, context: Context, visited: Iterable[Visited]
) -> None:
    """Checks an Evaluator where a run has been: time, state, modes, delayed signals.

    Args:
        context: Its context, which does not stay as it is.

    Raises:
        KernelDisagrees: If a kernel is wrong; it names the block and what differs.
    """
    program, contexts = evaluator.program, ContextsIn(system, context)
    parts = {part.start: part for _, _, part in program.delays}
    for t, x, m, y in visited:
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            continue
        context.SetTime(t)
        _SetModes(evaluator, context, m)
        for block in evaluator.blocks:
            for name, source in block.inputs.items():
                part = program.signals.get(source, slice(-1, -1))
                if part.start in parts:
                    port = block.system.GetInputPort(name)
                    port.FixValue(contexts[block.system], y[part])
        try:
            context.SetContinuousState(x)
            Compare(evaluator, system, context, y)
        except KernelDisagrees:
            # A step may end on an edge of a law, where rounding decides.
            context.SetContinuousState(x + 1e-7 * (1 + np.abs(x)))
            Compare(evaluator, system, context, y)


def _Raises(system: System, context: Context) -> bool:
    """Returns whether a system itself cannot be where a check has put it."""
    try:
        system.EvalTimeDerivatives(context)
    except Exception:
        return True
    return False


def _DefaultContext(system: System) -> Context:
    context = system.CreateDefaultContext()
    # Events are located if there is an accuracy, and some blocks then have modes.
    context.SetAccuracy(1e-4)
    for i in range(system.num_input_ports()):
        port = system.get_input_port(i)
        if port.get_data_type() == PortDataType.kVectorValued:
            port.FixValue(context, np.zeros(port.size()))
    system.ExecuteInitializationEvents(context)
    return context


def _Near(x: Array, rng: np.random.Generator) -> Array:
    return x + 0.1 * (1 + np.abs(x)) * rng.normal(size=x.size)


def Compare(
    evaluator: Evaluator,
    system: System,
    context: Context,
    delayed: Array | None = None,
) -> None:
    """Compares what an Evaluator computes in a context with what Drake does.

    Args:
        delayed: As Evaluate() takes it. What delays deliver is not compared then.

    Raises:
        KernelDisagrees: If anything differs; it names the block.
    """
    y, dx = evaluator.Evaluate(context, delayed)
    given = {part.start for _, _, part in evaluator.program.delays}
    program, contexts = evaluator.program, ContextsIn(system, context)
    for output, part in program.signals.items():
        block = evaluator.blocks[output.block]
        if not block.system.HasOutputPort(output.port):
            continue  # What belongs to a transition.
        if delayed is not None and part.start in given:
            continue
        port = block.system.GetOutputPort(output.port)
        if port.get_data_type() == PortDataType.kVectorValued:
            expected = port.Eval(contexts[block.system])
            _Compare(block.path, output.port, y[part], expected)
    x_dot = system.EvalTimeDerivatives(context).CopyToVector()
    for block, part in zip(evaluator.blocks, program.states, strict=True):
        _Compare(block.path, "rate", dx[part], x_dot[part])


def _Compare(path: str, name: str, value: Array, expected: Array) -> None:
    scale = max(1.0, np.abs(expected).max(initial=0.0))
    if np.abs(value - expected).max(initial=0.0) <= _TOLERANCE * scale:
        return  # allclose() takes ten times as long.
    if not np.allclose(value, expected, rtol=0, atol=_TOLERANCE * scale):
        raise KernelDisagrees(
            f"{path}: its kernel says {name} = {value.tolist()}, the block "
            f"{np.array(expected).tolist()}"
        )

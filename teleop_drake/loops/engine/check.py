"""Comparison of a program with Drake's callbacks, for a user's own blocks and laws."""

from collections.abc import Callable, Iterable
from functools import partial

import numpy as np
from pydrake.systems.analysis import (
    InitializeParams,
    Simulator,
    SimulatorStatus,
)
from pydrake.systems.framework import Context, PortDataType, System

from teleop_drake.loops.engine.block_events import OwnContext
from teleop_drake.loops.engine.evaluator import Evaluator, IsDelayed
from teleop_drake.loops.engine.flatten import Block, Source
from teleop_drake.loops.engine.run import CompiledRun, Visited
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import (
    ContextsIn,
    DiscreteState,
    SetDiscreteState,
)
from teleop_drake.loops.framework.signals import IsPlainLeaf
from teleop_drake.loops.kernel import KernelBlock
from teleop_drake.loops.kernel.events import Ticks

# The largest difference between a kernel and its block, as a share of the largest
# element (at least of 1). The order of their operations differs.
_TOLERANCE = 1e-9

# A step may end at a discontinuity of a law, where rounding selects the side. The state
# is then moved by this share, so that both are compared on the same side.
_BESIDE = 1e-7

# Packages whose own tests cover their blocks and laws.
_TESTED = ("teleop_drake", "pydrake")


class KernelDisagrees(ValueError):
    """Raised for a kernel whose values differ from those of its block's callbacks."""


class ReadingDisagrees(KernelDisagrees):
    """Raised for a block in Python that was not read as Drake calls it.

    Nobody wrote its kernel, so the block runs in Drake's Simulator.
    """


def HoldsOwnCode(evaluator: Evaluator) -> bool:
    """Returns whether a program contains a user's own block or function."""
    blocks = [type(block.system) for block in evaluator.blocks]
    code = [*blocks, *evaluator.program.laws]
    return bool(evaluator.read) or any(
        item.__module__.partition(".")[0] not in _TESTED for item in code
    )


def CheckVisited(
    evaluator: Evaluator, system: System, context: Context, visited: Iterable[Visited]
) -> None:
    """Compares an Evaluator with Drake's callbacks at states of a run.

    A comparison that fails is repeated with a slightly different state.

    Args:
        evaluator: The Evaluator of the system.
        system: The diagram.
        context: The Context of the system, which is changed.
        visited: Times, states, modes and delayed signals of the run.

    Raises:
        KernelDisagrees: If a kernel is wrong; the message names the block and the
            output.
    """
    program = evaluator.program
    contexts = ContextsIn(system, context)
    for t, x, m, y in visited:
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            continue
        context.SetTime(t)
        for block, mode in zip(evaluator.blocks, program.modes, strict=True):
            SetDiscreteState(contexts[block.system], m[mode])
        try:
            context.SetContinuousState(x)
            _CompareAll(evaluator, system, context, y)
        except KernelDisagrees:
            context.SetTime(t)
            context.SetContinuousState(x + _BESIDE * (1 + np.abs(x)))
            _CompareAll(evaluator, system, context, y)


def CheckRead(evaluator: Evaluator, context: Context) -> None:
    """Compares Python code that was read with Drake, at the first steps of a run.

    Args:
        context: The Context of the evaluator's system where runs begin.

    Raises:
        ReadingDisagrees: If Drake calls the code in another way.
    """
    if not evaluator.read:
        return
    end = context.get_time() + 1.0
    run = CompiledRun(evaluator, context, end=end, accuracy=1e-6, max_step=0.1)
    run.Advance(end)
    states = [run.start, *run.visited]
    CheckVisited(evaluator, evaluator.system, context.Clone(), states)


def _CompareAll(
    evaluator: Evaluator, system: System, context: Context, delayed: Array
) -> None:
    """Compares outputs, rates and transitions in a Context, which is changed.

    The inputs from delays are fixed to the outputs of these.
    """
    y, _ = evaluator.Evaluate(context, delayed)
    contexts = ContextsIn(system, context)
    for block in evaluator.blocks:
        for name, source in block.inputs.items():
            if IsDelayed(evaluator.program.kernels[source.block], source.port):
                value = y[evaluator.program.signals[source]]
                block.system.GetInputPort(name).FixValue(contexts[block.system], value)
    Compare(evaluator, system, context, delayed)
    CompareTransitions(evaluator, system, context, delayed)


def Compare(
    evaluator: Evaluator,
    system: System,
    context: Context,
    delayed: Array | None = None,
) -> None:
    """Compares outputs and rates of an Evaluator in a Context with those of Drake.

    Args:
        delayed: Signals y with the outputs of delays, as for Evaluator.Evaluate(). If
            they are given, they are not compared.

    Raises:
        KernelDisagrees: If an output or a rate differs; the message names the block.
    """
    y, dx = evaluator.Evaluate(context, delayed)
    program = evaluator.program
    contexts = ContextsIn(system, context)
    errors: dict[Source, KernelDisagrees] = {}

    def Note(i: int, name: str, value: Array, expected: Callable[[], Array]) -> None:
        block = evaluator.blocks[i]
        try:
            _CompareVector(block, name, value, _ExpectedOf(block, expected))
        except KernelDisagrees as error:
            errors[Source(i, name)] = error

    for output, part in program.signals.items():
        block = evaluator.blocks[output.block]
        kernel = program.kernels[output.block]
        if delayed is not None and IsDelayed(kernel, output.port):
            continue
        # A signal without a port is a guard, a new mode or an intermediate result.
        if not block.system.HasOutputPort(output.port):
            continue
        port = block.system.GetOutputPort(output.port)
        if port.get_data_type() == PortDataType.kVectorValued:
            Note(*output, y[part], partial(port.Eval, contexts[block.system]))
    for i, part in enumerate(program.states):
        leaf = evaluator.blocks[i].system
        if leaf.num_continuous_states() == 0:
            continue  # Some of Drake's discrete systems refuse the next call.
        Note(i, "rate", dx[part], partial(_RateOf, leaf, contexts[leaf]))
    # Name a block whose inputs agree, rather than one that receives a wrong signal.
    for (i, _), error in errors.items():
        if not errors.keys() & set(evaluator.blocks[i].inputs.values()):
            raise error
    for error in errors.values():
        raise error


def _RateOf(system: System, context: Context) -> Array:
    rate: Array = system.EvalTimeDerivatives(context).CopyToVector()
    return rate


def _ExpectedOf(block: Block, evaluate: Callable[[], Array]) -> Array:
    """Returns what Drake evaluates for a block.

    Raises:
        ReadingDisagrees: If the Python code of a block that was read raises an error.
    """
    try:
        return evaluate()
    except Exception as error:
        if not IsPlainLeaf(block.system):
            raise
        raise ReadingDisagrees(f"{block.path}: {error}") from error


def CompareTransitions(
    evaluator: Evaluator, system: System, context: Context, delayed: Array
) -> None:
    """Compares the new modes of an Evaluator with those of blocks with a kernel.

    The new modes and the guards of a KernelBlock are compared in the Context. Any other
    block executes its events by itself in Drake's Simulator, at the next tick of each
    periodic transition, with the states of the Context.

    Args:
        context: The Context of the system, of which the time is set.
        delayed: As for Compare().

    Raises:
        KernelDisagrees: If a value differs; the message names the block.
    """
    y, _ = evaluator.Evaluate(context, delayed)
    contexts = ContextsIn(system, context)
    time = context.get_time()
    for i, block in enumerate(evaluator.blocks):
        kernel = evaluator.program.kernels[i]
        if isinstance(block.system, KernelBlock):
            _CompareTerms(evaluator, i, contexts[block.system], y)
        elif _HasHandlers(block.system) and not kernel.delays:
            periodic = [x for x in kernel.transitions.values() if x.guard is None]
            due = {Ticks(x.period, x.offset).After(time) for x in periodic}
            for tick in sorted(due - {np.inf}):
                context.SetTime(tick)
                _CompareUpdate(evaluator, i, context, contexts[block.system], delayed)
            context.SetTime(time)


def _HasHandlers(system: System) -> bool:
    """Returns whether a block that is no KernelBlock has events in Python."""
    return hasattr(system, "Kernel") or IsPlainLeaf(system)


def _CompareTerms(evaluator: Evaluator, i: int, own: Context, y: Array) -> None:
    """Compares the guards and the new modes of a KernelBlock.

    Args:
        i: The index of the block.
        own: The Context of the block.
        y: The signals in that Context.
    """
    block = evaluator.blocks[i]
    program = evaluator.program
    for name, functions in block.system.transitions.items():
        for kind, value in zip(("guard", "mode"), functions, strict=True):
            if value is not None:
                found = y[program.SignalOf(i, kind, name)]
                _CompareVector(block, f"{kind} of {name}", found, value(own))


def _CompareUpdate(
    evaluator: Evaluator, i: int, context: Context, own: Context, delayed: Array
) -> None:
    """Compares the states of a block after the events at the time of a Context.

    Args:
        i: The index of the block, whose transitions are periodic.
        context: The Context of the diagram.
        own: The Context of the block in it, which is not changed.
    """
    block = evaluator.blocks[i]
    alone = OwnContext(block.system, own)
    x = alone.get_continuous_state_vector().CopyToVector()
    simulator = Simulator(block.system, alone)
    simulator.Initialize(InitializeParams(suppress_initialization_events=True))
    status = simulator.AdvancePendingEvents()
    if status.reason() != SimulatorStatus.ReturnReason.kReachedBoundaryTime:
        raise KernelDisagrees(
            f"{block.path}: the block ends the run at {own.get_time():g} s, which its "
            f"kernel does not: {status.message()}"
        )
    kept = alone.get_continuous_state_vector().CopyToVector()
    _CompareVector(block, "state after its event", x, kept)
    before = DiscreteState(own)
    for is_discrete in (False, True):
        y, _ = evaluator.Evaluate(context, delayed)
        SetDiscreteState(own, _ModeAfter(evaluator, i, own, y, is_discrete))
    mode = DiscreteState(own)
    SetDiscreteState(own, before)
    _CompareVector(block, "mode after its event", mode, DiscreteState(alone))


def _ModeAfter(
    evaluator: Evaluator, i: int, own: Context, y: Array, is_discrete: bool
) -> Array:
    """Returns the mode of a block after those periodic transitions that are due.

    Args:
        y: The signals.
        is_discrete: Whether the transitions are discrete updates, or the others.
    """
    before = DiscreteState(own)
    after = before.copy()
    for name, x in evaluator.program.kernels[i].transitions.items():
        is_due = Ticks(x.period, x.offset).At(own.get_time()) is not None
        if is_due and x.is_discrete == is_discrete:
            new = y[evaluator.program.SignalOf(i, "mode", name)]
            after = np.where(new != before, new, after)
    return after


def _CompareVector(block: Block, name: str, value: Array, expected: Array) -> None:
    """Raises KernelDisagrees, with the block's path, unless two vectors agree."""
    scale = max(1.0, np.nanmax(np.abs(expected), initial=0.0))
    tolerance = _TOLERANCE * scale
    if not np.isclose(value, expected, rtol=0, atol=tolerance, equal_nan=True).all():
        found = np.array(expected).tolist()
        if IsPlainLeaf(block.system):
            raise ReadingDisagrees(
                f"{block.path}: as read from its Python code, {name} = "
                f"{value.tolist()}; Drake has {found}"
            )
        raise KernelDisagrees(
            f"{block.path}: its kernel says {name} = {value.tolist()}, the block "
            f"{found}"
        )

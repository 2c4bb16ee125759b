"""Comparison of a program with Drake's callbacks, for a user's own blocks and laws."""

from collections.abc import Iterable

import numpy as np
from pydrake.systems.framework import Context, PortDataType, System

from teleop_drake.arrays import Array
from teleop_drake.contexts import ContextsIn, SetDiscreteState
from teleop_drake.engine.evaluator import Evaluator
from teleop_drake.engine.run import Visited

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


def HoldsOwnCode(evaluator: Evaluator) -> bool:
    """Returns whether a program contains a user's own block or function."""
    blocks = [type(block.system) for block in evaluator.blocks]
    code = [*blocks, *evaluator.program.laws]
    return any(item.__module__.partition(".")[0] not in _TESTED for item in code)


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
    delayed = {part.start for _, _, part in program.delays}
    for t, x, m, y in visited:
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            continue
        context.SetTime(t)
        for block, mode in zip(evaluator.blocks, program.modes, strict=True):
            own = contexts[block.system]
            SetDiscreteState(own, m[mode])
            # An input from a delay is set to the delay's output in the run.
            for name, source in block.inputs.items():
                part = program.signals.get(source)
                if part is not None and part.start in delayed:
                    block.system.GetInputPort(name).FixValue(own, y[part])
        try:
            context.SetContinuousState(x)
            Compare(evaluator, system, context, y)
        except KernelDisagrees:
            context.SetContinuousState(x + _BESIDE * (1 + np.abs(x)))
            Compare(evaluator, system, context, y)


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
    given = {part.start for _, _, part in program.delays if delayed is not None}
    for output, part in program.signals.items():
        block = evaluator.blocks[output.block]
        # A signal without a port is a guard, a new mode or an intermediate result.
        if part.start in given or not block.system.HasOutputPort(output.port):
            continue
        port = block.system.GetOutputPort(output.port)
        if port.get_data_type() == PortDataType.kVectorValued:
            expected = port.Eval(contexts[block.system])
            _CompareVector(block.path, output.port, y[part], expected)
    for block, part in zip(evaluator.blocks, program.states, strict=True):
        if block.system.num_continuous_states() == 0:
            continue  # Some of Drake's discrete systems refuse the next call.
        rate = block.system.EvalTimeDerivatives(contexts[block.system])
        _CompareVector(block.path, "rate", dx[part], rate.CopyToVector())


def _CompareVector(path: str, name: str, value: Array, expected: Array) -> None:
    """Raises KernelDisagrees, with the block's path, unless two vectors agree."""
    scale = max(1.0, np.nanmax(np.abs(expected), initial=0.0))
    tolerance = _TOLERANCE * scale
    if not np.isclose(value, expected, rtol=0, atol=tolerance, equal_nan=True).all():
        raise KernelDisagrees(
            f"{path}: its kernel says {name} = {value.tolist()}, the block "
            f"{np.array(expected).tolist()}"
        )

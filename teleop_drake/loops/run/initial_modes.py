"""The initial modes of blocks in a Context, where Drake has set others."""

from pydrake.systems.framework import Context

from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.framework.contexts import ContextsIn, SetDiscreteState
from teleop_drake.loops.kernel.terms import ContextReader


def SetInitialModes(evaluator: Evaluator, context: Context) -> None:
    """Sets the initial modes of blocks whose inputs depend on other constants.

    Args:
        evaluator: The evaluator with the constants.
        context: The Context of the diagram, in which Drake has set the modes with the
            diagram's own constants. Inputs of these blocks are fixed.
    """
    y, _ = evaluator.Evaluate(context)
    contexts = ContextsIn(evaluator.system, context)
    program = evaluator.program
    for block, kernel in zip(evaluator.blocks, program.kernels, strict=True):
        if kernel.initial_mode is None:
            continue
        own = contexts[block.system]
        for name, source in block.inputs.items():
            block.system.GetInputPort(name).FixValue(own, y[program.signals[source]])
        reader = ContextReader(block.system, kernel, "initial_mode")
        SetDiscreteState(own, reader.Read(kernel.initial_mode)(own))

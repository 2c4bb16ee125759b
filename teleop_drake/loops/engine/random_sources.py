"""Random sources of Drake in a compiled run.

pydrake binds neither the period nor the random numbers of a RandomSource. Drake's
Simulator therefore runs each source by itself, and the compiled run takes its draws: a
draw is an unrestricted update, whose new mode the caller of the run writes beforehand.
"""

from itertools import pairwise
from typing import NamedTuple

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from pydrake.systems.primitives import RandomSource

from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.primitives import DRAW
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import DiscreteState


class Draw(NamedTuple):
    """A new output of a random source.

    Attributes:
        time: The time of the draw, s.
        place: The slice of y of the source's new mode.
        value: The new output, which is the discrete state of the source (k).
    """

    time: float
    place: slice
    value: Array


def TakeDraws(evaluator: Evaluator, context: Context, end: float) -> list[Draw]:
    """Returns the draws of all random sources before a time in s, in their order.

    Args:
        context: The Context of the diagram, from which the draws go on. The states of
            its random sources are advanced to the end.
    """
    contexts = evaluator.ContextsIn(context)
    draws: list[Draw] = []
    for i, block in enumerate(evaluator.blocks):
        if type(block.system) is RandomSource:
            place = evaluator.program.SignalOf(i, "mode", DRAW)
            own = contexts[block.system]
            draws += _DrawsOf(block.system, own, place, end)
    return sorted(draws, key=lambda draw: draw.time)


def _DrawsOf(
    source: RandomSource, context: Context, place: slice, end: float
) -> list[Draw]:
    """Returns the draws of a source before a time in s, and advances its Context."""
    own = source.CreateDefaultContext()
    own.SetTimeStateAndParametersFrom(context)
    # The outputs at the ends of the steps. Drake draws at the begin of a step.
    shown = [Draw(own.get_time(), place, DiscreteState(own))]

    def NoteOutput(root: Context) -> None:
        shown.append(Draw(root.get_time(), place, DiscreteState(root)))

    simulator = Simulator(source, own)
    simulator.set_monitor(NoteOutput)
    simulator.AdvanceTo(end)  # Without a draw at this very time.
    simulator.clear_monitor()
    context.SetStateAndParametersFrom(own)
    return [
        after._replace(time=before.time)
        for before, after in pairwise(shown)
        if (after.value != before.value).any()
    ]

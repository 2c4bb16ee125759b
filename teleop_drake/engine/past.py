"""What was sent through delays before a run begins, from its Context and back.

Drake's delays have samples in their Contexts. advance() has rows: a signal is the
polynomial through the five rows of each step.
"""

from collections.abc import Iterator
from functools import partial
from itertools import zip_longest
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import Context

from teleop_drake.arrays import Array
from teleop_drake.contexts import ContextsIn
from teleop_drake.engine.delays import NODES
from teleop_drake.engine.evaluator import Evaluator
from teleop_drake.engine.problem import BREAKS, ROWS, Memory, Past
from teleop_drake.kernel import KernelBlock
from teleop_drake.kernel.delay_line import CLOSE, DelayLine
from teleop_drake.kernel.packet_line import PacketLine
from teleop_drake.numerics.step_polynomials import interpolate, steps_of


class _Line(NamedTuple):
    """A delay: its line, its block's Context, its signal's place in y."""

    line: DelayLine | PacketLine
    context: Context
    signal: slice


def _LinesIn(evaluator: Evaluator, context: Context) -> Iterator[_Line]:
    """Yields the delays of a diagram that have a line."""
    contexts = ContextsIn(evaluator.system, context)
    program = evaluator.program
    signals = iter([signal for _, signal, _ in program.delays])
    for block, kernel in zip(evaluator.blocks, program.kernels, strict=True):
        # A delay of 0 s has no line.
        lines = getattr(block.system, "delays", ())
        for line, _ in zip_longest(lines, kernel.delays):
            signal = next(signals)
            if line is not None:
                yield _Line(line, contexts[block.system], signal)


def CanWritePast(evaluator: Evaluator) -> bool:
    """Returns whether a Context can have all that a run has sent through delays."""
    return not any(
        kernel.delays and not isinstance(block.system, KernelBlock)
        for block, kernel in zip(
            evaluator.blocks, evaluator.program.kernels, strict=True
        )
    )


def ReadPast(evaluator: Evaluator, context: Context, y: Array) -> Past | None:
    """Returns what was sent before the time of a Context; None if nothing was.

    Args:
        context: Of the diagram; its inputs have values.
        y: The signals, with the initial values of what comes out of the delays.
    """
    lines = list(_LinesIn(evaluator, context))
    if not any(line.IsUnderWay(own) for line, own, _ in lines):
        return None
    sent = [line.Sent(own) for line, own, _ in lines]
    ends = _Distinct(np.concatenate([each.times for each in sent]))
    if len(ends) < 2:
        return None
    times = ends[:-1, np.newaxis] + np.diff(ends)[:, np.newaxis] * NODES
    times[:, -1] = ends[1:]
    rows = np.tile(y, (*times.shape, 1))
    for each, (_, _, signal) in zip(sent, lines, strict=True):
        for step, instants in enumerate(times):
            for node, time in enumerate(instants):
                rows[step, node, signal] = each.At(time, is_after=node == 0)
    arrivals = _Distinct(
        [
            time
            for line, own, _ in lines
            if isinstance(line, DelayLine)
            for time in line.JumpsAhead(own)
        ]
    )
    return Past(times.ravel(), rows.reshape(-1, len(y)), arrivals)


def _Distinct(times: ArrayLike) -> Array:
    """Returns times in s in their order; Drake's delays round each in its own way."""
    unique = np.unique(times)
    distinct: Array = unique[np.diff(unique, prepend=-np.inf) > CLOSE]
    return distinct


def WritePast(evaluator: Evaluator, context: Context, memory: Memory) -> None:
    """Writes what a run has sent into the delays of a Context at its end.

    Args:
        context: Of the diagram; it has the time of the end.
        memory: Of the run.
    """
    num_rows = memory.counts[ROWS]
    times = memory.row_times[:num_rows]
    steps = steps_of(memory.row_ends[:num_rows])
    # A step ends where any line has a jump or a bend: one of them has to have all.
    bends = memory.breaks[: memory.counts[BREAKS], 0].tolist()
    lines = sorted(_LinesIn(evaluator, context), key=lambda x: x.line.is_constant)
    for line, own, signal in lines[::-1]:
        rows = memory.rows[:num_rows, signal]
        if isinstance(line, PacketLine):
            line.SetSent(own, times[0], partial(interpolate, times, rows, steps))
            continue
        line.SetSent(own, times, rows, bends)
        bends = []

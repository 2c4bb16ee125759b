"""Transfers signals and packets under way from a Context to a run, and back.

In Drake, the delays store samples in their Contexts. advance() reads a delayed signal
from the recorded rows, as the polynomial through the five rows of each step.
"""

from collections.abc import Iterator
from functools import partial
from itertools import zip_longest
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import Context

from teleop_drake.loops.engine.delays import NODES
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.problem import BREAKS, ROWS, Memory, Past
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.kernel import KernelBlock
from teleop_drake.loops.kernel.delay_line import CLOSE, DelayLine
from teleop_drake.loops.kernel.packet_line import PacketLine
from teleop_drake.loops.numerics.step_polynomials import interpolate, steps_of


class _Line(NamedTuple):
    """A delay: its line, its block's Context, its signal's place in y."""

    line: DelayLine | PacketLine
    context: Context
    signal: slice


def _LinesIn(evaluator: Evaluator, context: Context) -> Iterator[_Line]:
    """Yields the delays of a diagram that have a line."""
    contexts = evaluator.ContextsIn(context)
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
    """Returns whether a Context can store all signals under way in the delays.

    A user's own block may have delays in its kernel and be no KernelBlock. Its Context
    has no place for them.
    """
    return not any(
        kernel.delays and not isinstance(block.system, KernelBlock)
        for block, kernel in zip(
            evaluator.blocks, evaluator.program.kernels, strict=True
        )
    )


def ReadPast(evaluator: Evaluator, context: Context, y: Array) -> Past | None:
    """Returns the delays' signals before the time of a Context; None: no signals.

    Args:
        context: The Context of the diagram, whose inputs have values.
        y: The signals at the start, with the initial outputs of the delays.
    """
    lines = list(_LinesIn(evaluator, context))
    if not any(line.IsUnderWay(own) for line, own, _ in lines):
        return None
    # Several delays may have the same signal. A line of packets knows it at the times
    # of its packets only, so that the other lines come later and replace its values.
    lines.sort(key=lambda x: isinstance(x.line, DelayLine))
    sent = [line.Sent(own) for line, own, _ in lines]
    # A step of the past ends at each sample of any delay, and has five rows.
    ends = _Distinct(np.concatenate([each.times for each in sent]))
    if len(ends) < 2:
        return None
    steps = ends[:-1, np.newaxis] + np.diff(ends)[:, np.newaxis] * NODES
    steps[:, -1] = ends[1:]
    times = np.append(ends[0], steps)
    rows = np.tile(y, (len(times), 1))
    for each, (line, _, signal) in zip(sent, lines, strict=True):
        begin, end = each.times[[0, -1]]
        for row, time in enumerate(times):
            is_known = begin - CLOSE <= time <= end + CLOSE
            if is_known or isinstance(line, PacketLine):
                # A step begins after a jump, and ends before one.
                rows[row, signal] = each.At(time, is_after=row % 5 == 1)
    # The arrivals of packets are known from the packets themselves.
    arrivals = _Distinct(
        [
            time
            for line, own, _ in lines
            if isinstance(line, DelayLine)
            for time in line.JumpsAhead(own)
        ]
    )
    return Past(times, rows, arrivals)


def _Distinct(times: ArrayLike) -> Array:
    """Returns times in s, sorted, without those that differ by rounding only."""
    unique = np.unique(times)
    distinct: Array = unique[np.diff(unique, prepend=-np.inf) > CLOSE]
    return distinct


def _Preference(line: _Line) -> tuple[bool, bool]:
    """Returns how well a line stores the bends of all delays, a key for sorting."""
    return getattr(line.line, "stores_bends", False), line.line.is_constant


def WritePast(evaluator: Evaluator, context: Context, memory: Memory) -> None:
    """Writes the signals and packets under way at the end of a run to a Context.

    Args:
        context: The Context of the diagram, with the time of the end.
        memory: The memory of the run.
    """
    num_rows = memory.counts[ROWS]
    times = memory.row_times[:num_rows]
    steps = steps_of(memory.row_ends[:num_rows])
    # A step ends at the jumps and bends of all delays, so one delay stores all of them.
    bends = memory.breaks[: memory.counts[BREAKS], 0].tolist()
    lines = sorted(_LinesIn(evaluator, context), key=_Preference)
    for line, own, signal in lines[::-1]:
        rows = memory.rows[:num_rows, signal]
        if isinstance(line, PacketLine):
            line.SetSent(own, times[0], partial(interpolate, times, rows, steps))
            continue
        line.SetSent(own, times, rows, bends)
        bends = []
    for line, own, _ in lines:
        if isinstance(line, DelayLine):
            line.Store(own)

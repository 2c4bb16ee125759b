"""A run in a page: the integrator, and what is measured of what it leaves behind.

All functions here are in the part of Python that machine_code/typed_code compiles.
"""

from collections.abc import Callable
from typing import NamedTuple

from teleop_drake.arrays import Array
from teleop_drake.integrator.advance import DONE, FULL, advance
from teleop_drake.integrator.measuring import Record, measure, mix, weigh
from teleop_drake.integrator.problem import ROWS, SAME, Memory, Problem

# How advance_and_measure() ended beside advance()'s own ways, or by how much more.
BEYOND = 3


class Measured(NamedTuple):
    """What belongs to a run beside what is integrated.

    Attributes:
        bounds: Begin and number of columns, what each has at the middle, and how far
            all are from there at most (b, 4).
        record: What is measured.
    """

    bounds: Array
    record: Record


def advance_and_measure(
    evaluate: Callable[..., None],
    problem: Problem,
    memory: Memory,
    measured: Measured,
    t_end: float,
    accuracy: float,
    max_step: float,
    is_last: bool,
) -> int:
    """Does what advance() does, until a bound does not hold; measures what has ended.

    Args:
        is_last: Whether the run ends at t_end.

    Returns:
        As advance(), or BEYOND and the number of the bound that does not hold.
    """
    first = memory.counts[ROWS]
    status = advance(evaluate, problem, memory, t_end, accuracy, max_step)
    bound = _stop(first, measured, memory)
    if bound >= 0:
        status = BEYOND + bound
    measured.record.places[3] = 0 if status == DONE else 1
    if is_last and status != FULL:
        measure(measured.record, memory)
    return status


def _beyond(row: int, t: float, measured: Measured, memory: Memory) -> int:
    """Returns the first bound that does not hold at a time in a step, -1 if all do."""
    bounds, record = measured.bounds, measured.record
    weigh(t, row, record, memory)
    for b in range(len(bounds)):
        total, first = 0.0, int(bounds[b, 0])
        for k in range(first, first + int(bounds[b, 1])):
            total += (mix(k, row, record, memory) - bounds[b, 2]) ** 2
        if not total**0.5 <= bounds[b, 3]:
            return b
    return -1


def _stop(first: int, measured: Measured, memory: Memory) -> int:
    """Ends the rows from one on where a bound does not hold; returns which, or -1."""
    counts, times, rows = memory.counts, memory.row_times, memory.rows
    record = measured.record
    for row in range(first, counts[ROWS]):
        if memory.row_ends[row] == 0:
            continue
        begin, bad, bound = times[row - 4], row - 4, -1
        while bad <= row and bound < 0:
            bound = _beyond(row, times[bad], measured, memory)
            bad += 1
        if bound < 0:
            continue
        low, high = begin, times[bad - 1]
        middle = (low + high) / 2
        while low < middle < high:
            if _beyond(row, middle, measured, memory) >= 0:
                high = middle
            else:
                low = middle
            middle = (low + high) / 2
        end = row
        if high - begin <= SAME:  # Nothing of a step that is not finite is known.
            end -= 4
        for k in range(rows.shape[1] if end == row else 0):
            for node in range(5):
                weigh(begin + node * (high - begin) / 4, row, record, memory)
                record.trace[node] = mix(k, row, record, memory)
            for node in range(5):
                rows[row - 4 + node, k] = record.trace[node]
        for node in range(5):
            times[row - 4 + node] = begin + node * (high - begin) / 4
        counts[ROWS] = end + 1
        return bound
    return -1

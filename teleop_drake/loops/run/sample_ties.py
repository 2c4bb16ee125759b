"""Samples of two blocks of Drake that are due at one instant, but for rounding."""

import itertools

from pydrake.systems.framework import Diagram, System

from teleop_drake.loops.framework.signals import PathsIn
from teleop_drake.loops.kernel.events import Ticks

# The most ticks of a block that are compared.
_MOST_TICKS = 1000


def NotesOnTies(diagram: System, start: float, end: float) -> list[str]:
    """Returns a note if rounding decides in Drake which of two samples is earlier.

    Drake computes the times of periodic events in floating point, where 33 * 0.02
    differs from 22 * 0.03. Blocks of this package and compiled runs treat both as one.

    Args:
        diagram: The simulated System.
        start: The time when the run begins, s.
        end: The time when it ends, s.
    """
    ticks: dict[Ticks, str] = {}
    for system, path in PathsIn(diagram):
        if isinstance(system, Diagram) or hasattr(system, "discrete_ticks"):
            continue
        found = system.GetUniquePeriodicDiscreteUpdateAttribute()
        if found is not None:
            ticks.setdefault(Ticks(found.period_sec(), found.offset_sec()), path)
    for first, second in itertools.combinations(ticks, 2):
        time = _RoundedTie(first, second, start, end)
        if time is not None:
            return [
                f"{ticks[first]} and {ticks[second]}: both sample at {time:.9g} s, and "
                "Drake's rounding of this time decides which one is earlier. A signal "
                "from one to the other has its value before or after the instant. The "
                "compiled engine takes the value before."
            ]
    return []


def _RoundedTie(first: Ticks, second: Ticks, start: float, end: float) -> float | None:
    """Returns the first common instant of two blocks that rounding separates, s."""
    k = first.From(start)
    for i in range(k, k + _MOST_TICKS):
        time = first.TimeOf(i)
        if time >= end:
            return None
        j = second.At(time)
        if j is not None and second.TimeOf(j) != time:
            return time
    return None

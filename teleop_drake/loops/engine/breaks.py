"""Breaks: the times ahead that no step may cross.

An event makes signals jump or bend. Its effect leaves each delay later, and is a break
at that time: the echo of the event.

All functions here are in the part of Python that jit/typed_code compiles.
"""

import math

from teleop_drake.loops.engine.delays import arrival
from teleop_drake.loops.engine.problem import BREAKS, ROWS, Delays, Memory
from teleop_drake.loops.engine.steered import note_jump
from teleop_drake.loops.numerics.instants import SAME

# Each passage through an integrator makes a jump smoother by one derivative. An echo of
# a higher order than this is smooth enough for the method, so that no step ends there.
MAX_ECHO = 4

# The order at a time without a break.
NO_BREAK = -1


def add_break(t: float, order: int, memory: Memory) -> None:
    """Adds a break of an order, a time in s that no step may cross."""
    num = memory.counts[BREAKS]
    memory.breaks[num, 0] = t
    memory.breaks[num, 1] = order
    memory.counts[BREAKS] = num + 1


def _order_after(order: int, d: int, delays: Delays, memory: Memory) -> int:
    """Returns the order of the present event's effect after it has passed delay d.

    The last two rows have the signals before and after the event. The effect of a jump
    has order 1, because a jump remains a jump after any number of delays.
    """
    row = memory.counts[ROWS] - 1
    echo = order + 1
    for i in range(delays.sizes[d]):
        before = memory.rows[row - 1, delays.signals[d] + i]
        after = memory.rows[row, delays.signals[d] + i]
        if abs(after - before) > 1e-9 * (abs(after) + abs(before)):
            echo = 1
    return echo


def add_echoes(t: float, order: int, delays: Delays, memory: Memory) -> None:
    """Adds a break where the effect of the present event leaves each delay.

    For the delays whose time is a signal, the event is noted as a jump.
    """
    for d in range(len(delays.times)):
        echo = _order_after(order, d, delays, memory)
        is_finite = delays.times[d] > 0.0 and delays.times[d] < math.inf
        if echo <= MAX_ECHO and is_finite:
            add_break(arrival(t, d, delays), echo, memory)
    if memory.steered is not None:
        least = MAX_ECHO + 1
        for k in range(len(delays.steering.delays)):
            echo = _order_after(order, delays.steering.delays[k], delays, memory)
            if echo < least:
                least = echo
        if least <= MAX_ECHO:
            note_jump(t, least, memory.steered, memory)


def take_break(t: float, memory: Memory) -> int:
    """Removes the breaks at a time; returns their least order, or NO_BREAK."""
    breaks = memory.breaks
    order = NO_BREAK
    num = 0
    for i in range(memory.counts[BREAKS]):
        if abs(breaks[i, 0] - t) > SAME:
            breaks[num, 0] = breaks[i, 0]
            breaks[num, 1] = breaks[i, 1]
            num += 1
        elif order == NO_BREAK or breaks[i, 1] < order:
            order = int(breaks[i, 1])
    memory.counts[BREAKS] = num
    return order

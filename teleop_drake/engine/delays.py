"""What comes out of the delays of the system that advance() integrates.

A delayed signal is a polynomial in each step, through the rows that are recorded at
five points of the step, so that no polynomial crosses a jump.

All functions here are in the part of Python that jit/typed_code compiles.
"""

import math

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.engine.problem import END, ROWS, Delays, Memory
from teleop_drake.numerics.instants import SAME
from teleop_drake.numerics.piecewise import NUM_COEFFICIENTS

NODES = np.array([0, 1 / 4, 1 / 2, 3 / 4, 1])
"""Points of a step at which signals are recorded, as shares of the step."""


def _add_past(
    s: float, is_after: bool, weight: float, d: int, delays: Delays, memory: Memory
) -> None:
    """Adds a signal as it was at a time to what comes out of its delay.

    Before the start it is what has come out in the first row.
    """
    times = memory.row_times
    signal = delays.signals[d]
    output = delays.outputs[d]
    # The last row before s, or at s, that does not end the last step.
    low = -1
    high = memory.counts[END] - 1
    while low < high:
        middle = (low + high + 1) // 2
        if times[middle] < s - SAME or (is_after and times[middle] <= s + SAME):
            low = middle
        else:
            high = middle - 1
    if low < 0:
        for i in range(delays.sizes[d]):
            memory.y[output + i] += weight * memory.rows[0, output + i]
        return
    end = low + 1
    while memory.row_ends[end] == 0:
        end += 1
    begin = end - 4
    theta = (s - times[begin]) / (times[end] - times[begin])
    theta = min(max(theta, 0.0), 1.0)
    for a in range(5):
        share = weight
        for b in range(5):
            if a != b:
                share *= (theta - NODES[b]) / (NODES[a] - NODES[b])
        for i in range(delays.sizes[d]):
            memory.y[output + i] += share * memory.rows[begin + a, signal + i]


def _add_sent(s: float, weight: float, d: int, delays: Delays, memory: Memory) -> None:
    """Adds the value of a signal before the events of an instant; see _add_past."""
    if abs(s - memory.clock[2]) <= SAME:
        for i in range(delays.sizes[d]):
            value = memory.rows[0, delays.signals[d] + i]
            memory.y[delays.outputs[d] + i] += weight * value
    else:
        _add_past(s, False, weight, d, delays, memory)


def evaluate_pieces(
    knots: Array, coefficients: Array, first: int, end: int, x: float
) -> float:
    """Returns the value at x of some pieces, beyond their ends that of the nearer end.

    Args:
        knots: As in piecewise.Pieces, and so are the coefficients.
        first: The index of the first piece.
        end: The index after the last piece.
        x: Where.
    """
    low = first
    high = end - 1
    while low < high:
        middle = (low + high + 1) // 2
        if knots[middle, 0] <= x:
            low = middle
        else:
            high = middle - 1
    length = knots[low, 1] - knots[low, 0]
    share = (2 * x - knots[low, 0] - knots[low, 1]) / length
    share = min(max(share, -1.0), 1.0)
    value = 0.0
    for k in range(NUM_COEFFICIENTS):
        value = value * share + coefficients[low, NUM_COEFFICIENTS - 1 - k]
    return value


def delay_at(t: float, d: int, delays: Delays) -> float:
    """Returns a delay in s, infinity where packets are shown."""
    first = delays.piece_ranges[d, 0]
    end = delays.piece_ranges[d, 1]
    if first == end:
        return float(delays.times[d])
    return evaluate_pieces(delays.knots, delays.coefficients, first, end, t)


def arrival(s: float, d: int, delays: Delays) -> float:
    """Returns the time t in s at which a value sent at s arrives: t - T(t) = s."""
    if delays.piece_ranges[d, 0] == delays.piece_ranges[d, 1]:
        return s + float(delays.times[d])
    low = s
    high = s + delay_at(s, d, delays)
    while high - delay_at(high, d, delays) < s:
        low = high
        high = high + delay_at(high, d, delays)
    middle = (low + high) / 2
    while low < middle and middle < high:
        if middle - delay_at(middle, d, delays) < s:
            low = middle
        else:
            high = middle
        middle = (low + high) / 2
    return high


def fetch(t: float, delays: Delays, memory: Memory) -> None:
    """Writes the outputs of the delays into y.

    A jump at the start of the step is included, a later jump is not. In the first row
    they are what the caller has set.
    """
    if memory.counts[ROWS] == 0:
        return
    is_after = t <= memory.clock[0]
    for d in range(len(delays.times)):
        for i in range(delays.sizes[d]):
            memory.y[delays.outputs[d] + i] = 0.0
        if delays.times[d] < math.inf:
            s = t - delay_at(t, d, delays)
            _add_past(s, is_after, 1.0, d, delays, memory)
        elif memory.next_packets[d] == delays.packet_ranges[d, 0]:
            _add_sent(-math.inf, 1.0, d, delays, memory)
        else:
            k = memory.next_packets[d] - 1
            shown = delays.packets[k, 0]
            sent = delays.packets[k, 1]
            previous = delays.packets[k, 2]
            slope = 0.0
            if previous > -math.inf:
                slope = (t - shown) / (sent - previous)
                _add_sent(previous, -slope, d, delays, memory)
            _add_sent(sent, 1.0 + slope, d, delays, memory)

"""The outputs of delays, interpolated between the rows that advance() has recorded.

In each step, a signal is the polynomial of degree 4 through the rows at five points of
the step. No step crosses a jump, so no polynomial does.

All functions here are in the part of Python that jit/typed_code compiles.
"""

import math

import numpy as np

from teleop_drake.loops.engine.problem import END, FIRST, ROWS, Delays, Memory
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.numerics.instants import SAME
from teleop_drake.loops.numerics.piecewise import NUM_COEFFICIENTS

NODES = np.array([0, 1 / 4, 1 / 2, 3 / 4, 1])
"""The points of a step at which signals are recorded, as shares of its length."""


def _add_past(
    s: float, is_after: bool, weight: float, d: int, delays: Delays, memory: Memory
) -> None:
    """Adds the signal sent into delay d at a time, times a weight, to its output in y.

    The signal sent before the first row is the delay's output in the first row.

    Args:
        s: The time in s.
        is_after: Whether a jump at this time is included.
        weight: The factor of the signal.
    """
    times = memory.row_times
    signal = delays.signals[d]
    output = delays.outputs[d]
    # Bisection finds the last row before s (at s, too, if `is_after`). It is before the
    # end of the last step, so that a step begins there or goes on.
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
    # The rows of the step that contains s.
    end = low + 1
    while memory.row_ends[end] == 0:
        end += 1
    begin = end - 4
    theta = (s - times[begin]) / (times[end] - times[begin])
    theta = min(max(theta, 0.0), 1.0)
    # Lagrange's polynomial through the five rows.
    for a in range(5):
        share = weight
        for b in range(5):
            if a != b:
                share *= (theta - NODES[b]) / (NODES[a] - NODES[b])
        for i in range(delays.sizes[d]):
            memory.y[output + i] += share * memory.rows[begin + a, signal + i]


def _add_sent(s: float, weight: float, d: int, delays: Delays, memory: Memory) -> None:
    """Adds the signal sent before the events of time s; see _add_past()."""
    # The first row, and the first one of the run, hold the signals before the events of
    # their instants.
    row = -1
    first = memory.counts[FIRST]
    if abs(s - memory.clock[2]) <= SAME:
        row = 0
    elif first > 0 and abs(s - memory.row_times[first]) <= SAME:
        row = first
    if row < 0:
        _add_past(s, False, weight, d, delays, memory)
        return
    for i in range(delays.sizes[d]):
        value = memory.rows[row, delays.signals[d] + i]
        memory.y[delays.outputs[d] + i] += weight * value


def evaluate_pieces(
    knots: Array, coefficients: Array, first: int, end: int, x: float
) -> float:
    """Returns the value of piecewise polynomials at x; they are constant beyond an end.

    Args:
        knots: As in piecewise.Pieces.
        coefficients: As in piecewise.Pieces.
        first: The index of the first piece.
        end: The index after the last piece.
        x: The argument of the polynomials, in the unit of the knots.
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
    """Returns delay d at the time t, in s; infinity for a delay of packets."""
    first = delays.piece_ranges[d, 0]
    end = delays.piece_ranges[d, 1]
    if first == end:
        return float(delays.times[d])
    return evaluate_pieces(delays.knots, delays.coefficients, first, end, t)


def arrival(s: float, d: int, delays: Delays) -> float:
    """Returns the time t in s at which a value sent at s arrives: t - T(t) = s."""
    if delays.piece_ranges[d, 0] == delays.piece_ranges[d, 1]:
        return s + float(delays.times[d])
    # An interval in which it arrives, and then bisection down to neighbouring floats.
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


def fetch(t: float, is_after: bool, delays: Delays, memory: Memory) -> None:
    """Writes the outputs of the delays at the time t into y.

    For the first row, y keeps the outputs that the caller has set.

    Args:
        is_after: Whether a jump that arrives at the time t is included.
    """
    if memory.counts[ROWS] == 0:
        return
    for d in range(len(delays.times)):
        for i in range(delays.sizes[d]):
            memory.y[delays.outputs[d] + i] = 0.0
        if delays.times[d] < math.inf:
            s = t - delay_at(t, d, delays)
            _add_past(s, is_after, 1.0, d, delays, memory)
        elif memory.next_packets[d] == delays.packet_ranges[d, 0]:
            # No packet has been shown: this adds the initial output.
            _add_sent(-math.inf, 1.0, d, delays, memory)
        else:
            # The packet that is shown, held or continued along a line.
            k = memory.next_packets[d] - 1
            shown = delays.packets[k, 0]
            sent = delays.packets[k, 1]
            previous = delays.packets[k, 2]
            slope = 0.0
            if previous > -math.inf:
                slope = (t - shown) / (sent - previous)
                _add_sent(previous, -slope, d, delays, memory)
            _add_sent(sent, 1.0 + slope, d, delays, memory)

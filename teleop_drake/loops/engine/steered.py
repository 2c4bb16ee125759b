"""Delays whose time is a signal: their outputs, and the jumps that they pass.

A value is delivered at the time t that was sent at s(t). The time s is t - T, with the
signal T, or the last time at which the position of a conveyor was less by its length.
It may go back, and may be within the present step.

Jumps of the signals are not predicted. Between two steps, an output is on a piece of
its signal that ends at two jumps, and stays there within the step. If s passes one of
them, advance() ends the step at that instant. The output then goes on to the next
piece, forwards or backwards.

All functions here are in the part of Python that jit/typed_code compiles.
"""

from teleop_drake.loops.engine.delays import NODES
from teleop_drake.loops.engine.problem import (
    AHEAD,
    BEYOND,
    JUMPS,
    ROWS,
    Delays,
    Memory,
    Steered,
)
from teleop_drake.loops.numerics.instants import SAME

# The output of a conveyor may always move by this in a step, s.
_FINE = 5e-4


def _weight(a: int, share: float) -> float:
    """Returns Lagrange's weight of row a of a step's five, at a share of the step."""
    weight = 1.0
    for b in range(5):
        if a != b:
            weight *= (share - NODES[b]) / (NODES[a] - NODES[b])
    return weight


def _value(share: float, begin: int, place: int, memory: Memory) -> float:
    """Returns a signal at a share of the step that begins in a row."""
    value = 0.0
    for a in range(5):
        value += _weight(a, share) * memory.rows[begin + a, place]
    return value


def _share_at(level: float, begin: int, place: int, memory: Memory) -> float:
    """Returns the share of a step at which a signal rises to a value: regula falsi.

    The weight of an end that stays is halved, as in the Illinois algorithm.
    """
    low = 0.0
    high = 1.0
    below = level - memory.rows[begin, place]
    above = memory.rows[begin + 4, place] - level
    for _ in range(60):
        if above + below <= 0.0 or high - low < 1e-15:
            break
        share = low + (high - low) * below / (below + above)
        rest = level - _value(share, begin, place, memory)
        if rest == 0.0:
            return share
        if rest > 0.0:
            low = share
            below = rest
            above = above / 2
        else:
            high = share
            above = -rest
            below = below / 2
    return high


def _end_of_piece(j: int, steered: Steered, memory: Memory) -> int:
    """Returns the last row that ends a step between jump j and the next one.

    It is the row after jump j if no step has been recorded since.
    """
    first = int(steered.jumps[j, 2])
    last = memory.counts[ROWS] - 1
    if j + 1 < steered.marks[JUMPS]:
        last = int(steered.jumps[j + 1, 2]) - 1
    # An event without a jump has recorded a row, too, which ends no step.
    while last > first and memory.row_ends[last] == 0:
        last -= 1
    return last


def _sent_on_conveyor(
    k: int, t: float, steered: Steered, delays: Delays, memory: Memory
) -> float:
    """Returns the last time at which the position of conveyor k was less by its length.

    The position is monotone between two jumps, because the conveyor turns at an event.
    """
    place = delays.steering.controls[k]
    level = memory.y[place] - delays.steering.lengths[k]
    rows = memory.rows
    times = memory.row_times
    # Within the present step, of which there may be a try.
    begin = steered.marks[AHEAD]
    if begin > 0 and rows[begin, place] < level and level < rows[begin + 4, place]:
        share = _share_at(level, begin, place, memory)
        return float(times[begin] + share * (times[begin + 4] - times[begin]))
    if level > rows[memory.counts[ROWS] - 1, place]:
        return t
    # The last piece that begins below the value.
    j = steered.marks[JUMPS] - 1
    while j >= 0 and rows[int(steered.jumps[j, 2]), place] > level:
        j -= 1
    if j < 0:
        return float(memory.clock[2]) - 1.0
    return _last_below(level, place, j, steered, memory)


def _last_below(
    level: float, place: int, j: int, steered: Steered, memory: Memory
) -> float:
    """Returns the last time, s, from jump j to the next one that a signal is <= level.

    The signal rises from a value below the level.
    """
    last = _end_of_piece(j, steered, memory)
    low = int(steered.jumps[j, 2])
    high = last
    while low < high:
        middle = (low + high + 1) // 2
        if memory.rows[middle, place] <= level:
            low = middle
        else:
            high = middle - 1
    times = memory.row_times
    if low == last:
        return float(times[last])
    end = low + 1
    while memory.row_ends[end] == 0:
        end += 1
    share = _share_at(level, end - 4, place, memory)
    return float(times[end - 4] + share * (times[end] - times[end - 4]))


def _sent(k: int, t: float, steered: Steered, delays: Delays, memory: Memory) -> float:
    """Returns when the value was sent that steered delay k delivers at t, in s.

    The signal that steers the delay is read from y. A delay < 0 counts as 0.
    """
    if delays.steering.lengths[k] > 0.0:
        return _sent_on_conveyor(k, t, steered, delays, memory)
    return t - max(float(memory.y[delays.steering.controls[k]]), 0.0)


def _sent_from_piece(
    s: float, k: int, steered: Steered, delays: Delays, memory: Memory
) -> float:
    """Returns when the output was sent if it stays on its piece, s.

    Args:
        s: When it was sent if it passes all jumps.
    """
    side = steered.sides[k]
    if side < steered.marks[JUMPS] and s >= steered.jumps[side, 0]:
        s = float(steered.jumps[side, 0])
        if delays.steering.lengths[k] > 0.0:
            # The output may have left the piece before its end, where it turns.
            place = delays.steering.controls[k]
            level = memory.y[place] - delays.steering.lengths[k]
            s = min(s, _last_below(level, place, side - 1, steered, memory))
    return max(s, float(steered.jumps[side - 1, 0]))


def _side_of(s: float, steered: Steered) -> int:
    """Returns the number of jumps up to a time in s."""
    low = 0
    high = steered.marks[JUMPS]
    while low < high:
        middle = (low + high) // 2
        if steered.jumps[middle, 0] <= s + SAME:
            low = middle + 1
        else:
            high = middle
    return low


def _begin_of_step(s: float, first: int, last: int, memory: Memory) -> int:
    """Returns the row at which the step begins that contains a time in s.

    Args:
        first: The first row of a piece.
        last: The last row of the piece, which ends a step.
    """
    low = first
    high = last - 1
    while low < high:
        middle = (low + high + 1) // 2
        if memory.row_times[middle] <= s:
            low = middle
        else:
            high = middle - 1
    end = low + 1
    while memory.row_ends[end] == 0:
        end += 1
    return end - 4


def _deliver(s: float, begin: int, d: int, delays: Delays, memory: Memory) -> None:
    """Writes the output of delay d that was sent in the step that begins in a row."""
    times = memory.row_times
    share = (s - times[begin]) / (times[begin + 4] - times[begin])
    output = delays.outputs[d]
    for i in range(delays.sizes[d]):
        memory.y[output + i] = 0.0
    for a in range(5):
        weight = _weight(a, share)
        for i in range(delays.sizes[d]):
            value = memory.rows[begin + a, delays.signals[d] + i]
            memory.y[output + i] += weight * value


def fetch_steered(
    t: float, passes: bool, steered: Steered, delays: Delays, memory: Memory
) -> None:
    """Writes the outputs of the delays whose time is a signal into y.

    For the first row, y keeps the outputs that the caller has set.

    Args:
        passes: Whether an output may pass jumps now.
    """
    if memory.counts[ROWS] == 0:
        return
    marks = steered.marks
    for k in range(len(delays.steering.delays)):
        steered.used[k] = memory.y[delays.steering.controls[k]]
        s = _sent(k, t, steered, delays, memory)
        if passes:
            steered.sides[k] = _side_of(s, steered)
        side = steered.sides[k]
        d = delays.steering.delays[k]
        if side == 0:  # The initial output.
            for i in range(delays.sizes[d]):
                output = delays.outputs[d] + i
                memory.y[output] = memory.rows[0, output]
            continue
        first = int(steered.jumps[side - 1, 2])
        last = _end_of_piece(side - 1, steered, memory)
        begin = last
        s = _sent_from_piece(s, k, steered, delays, memory)
        if side == marks[JUMPS] and s > memory.clock[0] + SAME:
            # From the last try or, without one, by the polynomial of the last step.
            marks[BEYOND] = 1
            if marks[AHEAD] > 0:
                begin = marks[AHEAD]
            elif last > first:
                begin = last - 4
        elif last > first:
            begin = _begin_of_step(s, first, last, memory)
        if begin != last:
            _deliver(s, begin, d, delays, memory)
            continue
        # No step has been recorded since the jump.
        for i in range(delays.sizes[d]):
            value = memory.rows[last, delays.signals[d] + i]
            memory.y[delays.outputs[d] + i] = value


def has_turned(steered: Steered, delays: Delays, memory: Memory) -> bool:
    """Returns whether a control differs from that with which its output was found."""
    for k in range(len(delays.steering.delays)):
        if memory.y[delays.steering.controls[k]] != steered.used[k]:
            return True
    return False


def is_passed(t: float, steered: Steered, delays: Delays, memory: Memory) -> bool:
    """Returns whether an output has to pass a jump at t, forwards or backwards."""
    for k in range(len(delays.steering.delays)):
        side = steered.sides[k]
        s = _sent(k, t, steered, delays, memory)
        if side < steered.marks[JUMPS] and s >= steered.jumps[side, 0]:
            return True
        if side > 0 and s < steered.jumps[side - 1, 0] - 2 * SAME:
            return True
    return False


def may_have_passed(t: float, steered: Steered, delays: Delays, memory: Memory) -> bool:
    """Returns whether an output may have passed a jump within the step and come back.

    It may for the reason given in transitions.is_near().
    """
    for k in range(len(delays.steering.delays)):
        side = steered.sides[k]
        s = _sent(k, t, steered, delays, memory)
        last = steered.sent[k, 0]
        change = abs(s - last) + abs(last - steered.sent[k, 1])
        if side < steered.marks[JUMPS] and s + change >= steered.jumps[side, 0]:
            return True
        if side > 0 and s - change < steered.jumps[side - 1, 0]:
            return True
    return False


def is_too_fast(t: float, steered: Steered, delays: Delays, memory: Memory) -> bool:
    """Returns whether the output of a conveyor has moved too far in a step up to t.

    Where the conveyor was slow, its signal leaves it fast: like a root of time beside
    an instant at which it stood or turned, which is a jump. A step may cover half of
    the way from or to a jump, or _FINE.
    """
    for k in range(len(delays.steering.delays)):
        side = steered.sides[k]
        if delays.steering.lengths[k] == 0.0 or side == 0:
            continue
        s = _sent(k, t, steered, delays, memory)
        s = _sent_from_piece(s, k, steered, delays, memory)
        last = steered.sent[k, 0]
        way = last - steered.jumps[side - 1, 0]
        if side < steered.marks[JUMPS]:
            way = min(way, steered.jumps[side, 0] - last)
        if abs(s - last) > max(_FINE, 0.5 * way):
            return True
    return False


def note_sent(
    t: float, has_jumped: bool, steered: Steered, delays: Delays, memory: Memory
) -> None:
    """Stores when the outputs were sent, as transitions.note_guards() does guards."""
    for k in range(len(delays.steering.delays)):
        steered.sent[k, 1] = steered.sent[k, 0]
        steered.sent[k, 0] = _sent(k, t, steered, delays, memory)
        if has_jumped:
            steered.sent[k, 1] = steered.sent[k, 0]


def note_jump(t: float, order: int, steered: Steered, memory: Memory) -> None:
    """Adds an event of an order to the jumps; the last row is the one after it."""
    num = steered.marks[JUMPS]
    steered.jumps[num, 0] = t
    steered.jumps[num, 1] = order
    steered.jumps[num, 2] = memory.counts[ROWS] - 1
    steered.marks[JUMPS] = num + 1


def order_passed(t: float, steered: Steered, delays: Delays, memory: Memory) -> int:
    """Returns the least order of the jumps that outputs have to pass; -1: none."""
    order = -1
    for k in range(len(delays.steering.delays)):
        new = _side_of(_sent(k, t, steered, delays, memory), steered)
        low = min(new, steered.sides[k])
        high = max(new, steered.sides[k])
        for j in range(int(low), int(high)):
            if order == -1 or steered.jumps[j, 1] < order:
                order = int(steered.jumps[j, 1])
    return order


def stand_before_jumps(
    t: float, steered: Steered, delays: Delays, memory: Memory
) -> None:
    """Puts the outputs before the jumps that they pass at t, at the start of a run."""
    if memory.counts[ROWS] == 0:
        return
    for k in range(len(delays.steering.delays)):
        s = _sent(k, t, steered, delays, memory)
        steered.sides[k] = _side_of(s - 3 * SAME, steered)


def is_refused(steered: Steered, delays: Delays, memory: Memory) -> bool:
    """Returns whether a delay is < 0 or longer than allowed in the last row."""
    row = memory.counts[ROWS] - 1
    for k in range(len(delays.steering.delays)):
        time = memory.rows[row, delays.steering.controls[k]]
        is_time = delays.steering.lengths[k] == 0.0
        if is_time and (time < -SAME or time > delays.steering.longest[k] + SAME):
            return True
    return False

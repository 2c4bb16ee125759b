"""Integrates a problem with delays and modes: Dormand-Prince 5(4) with dense output.

The equations are a function `evaluate(t, x, m, p, y, dx, wanted)`, which computes the
rate dx of the state x and the signals y; see engine.program. The outputs
of the delays are written into y before each evaluation. advance() repeats:

1. _next_stop() finds the latest time for the end of the step. No step crosses a break:
   the instant of an event or of its echo, at which its effect leaves a delay.
2. step() tries a step. If its error is too large, a shorter step is tried.
3. _end_step() accepts the step. If a guard reaches 0 within it, the instant is located
   on the dense output, and the step ends there. A guard that comes near to 0 is also
   evaluated within the step, because it may have been positive for a moment. Signals
   are recorded at five points of the step. A delayed signal is the polynomial through
   these rows; its error is O(step^5), as for the dense output.
4. _let_happen() executes the events at the end of the step, and records a further row.
   The step that ends there uses the values before the events, the next one those after.

All functions here are in the part of Python that jit/typed_code compiles.
"""

import math

from teleop_drake.loops.engine.breaks import MAX_ECHO, NO_BREAK, add_echoes, take_break
from teleop_drake.loops.engine.delays import NODES
from teleop_drake.loops.engine.dormand_prince import NUM_STAGES
from teleop_drake.loops.engine.problem import (
    AHEAD,
    BREAKS,
    END,
    EVALUATIONS,
    JUMPS,
    ROWS,
    STEPS,
    TRIES,
    Delays,
    Memory,
    Problem,
    Steered,
)
from teleop_drake.loops.engine.steered import (
    is_passed,
    is_refused,
    is_too_fast,
    may_have_passed,
    note_sent,
    order_passed,
    stand_before_jumps,
)
from teleop_drake.loops.engine.step import (
    WEIGHTS_AT_NODES,
    Evaluate,
    copy,
    evaluate_at,
    evaluate_beside,
    evaluate_with,
    evaluate_within,
    move,
    repeat,
    set_weights,
    step,
    write,
)
from teleop_drake.loops.engine.transitions import (
    change_modes,
    is_due,
    is_near,
    next_time,
    note_guards,
)
from teleop_drake.loops.jit.scalar_code import ALL, SIGNALS
from teleop_drake.loops.numerics.instants import SAME, same_within

# The most tries of one call of advance(). Between the calls, its caller can check the
# progress of the run, and Python handles Ctrl-C.
_MOST_TRIES = 500

# A step need not be shorter than this because of a delay whose time is a signal, s.
_SHORT = 0.01

# A step is not repeated to end where an output passes a jump so close to its end, s.
_CLOSE = 1e-7

# The error of a step, in multiples of the accuracy, in which a delayed signal moves too
# far: the next try has half the length.
_TOO_FAST = 20.0

# The results of advance().
DONE = 0
FULL = 1
STUCK = 2
REFUSED = 3


def _record_step(
    evaluate: Evaluate,
    length: float,
    h: float,
    end: float,
    problem: Problem,
    memory: Memory,
) -> None:
    """Records a step up to a length in s: three rows within it, and one at its end."""
    row = memory.counts[ROWS]
    # First the end, whose signals are in y until the evaluations below.
    write(row + 3, end, memory)
    for node in range(1, 4):
        s = NODES[node] * length
        if length == h:
            weights = WEIGHTS_AT_NODES[node]
            evaluate_with(weights, NODES[node], evaluate, h, problem, memory)
        else:
            evaluate_within(s / h, evaluate, h, problem, memory)
        write(row + node - 1, memory.clock[0] + s, memory)
    memory.row_ends[row + 3] = 1
    memory.counts[END] = row + 3
    memory.counts[ROWS] = row + 4
    if memory.steered is not None:
        memory.steered.marks[AHEAD] = 0


def _record(t: float, memory: Memory) -> None:
    """Records a row at a time; it does not end a step."""
    write(memory.counts[ROWS], t, memory)
    memory.counts[ROWS] += 1


def _settle(evaluate: Evaluate, order: int, problem: Problem, memory: Memory) -> None:
    """Executes the packets and transitions due at a break of an order, or NO_BREAK."""
    t = memory.clock[0]
    if _show_packets(t, problem.delays, memory) and order == NO_BREAK:
        order = MAX_ECHO  # Only a jump of a delay's signal has an echo.
    has_jumped = order != NO_BREAK
    for _ in range(10):  # A transition may make another one due.
        has_changed = change_modes(has_jumped, problem.transitions, memory)
        if not (has_changed or has_jumped):
            break
        if has_changed:
            order = 0
        evaluate_at(ALL, evaluate, t, memory.x, problem, memory, memory.stages[0])
        has_jumped = False
    if order != NO_BREAK:
        _record(t, memory)
        add_echoes(t, order, problem.delays, memory)
    note_guards(True, problem.transitions, memory)
    if memory.steered is not None:
        note_sent(t, True, memory.steered, problem.delays, memory)


def _show_packets(t: float, delays: Delays, memory: Memory) -> bool:
    """Shows the packets that are due at a time in s; returns whether there were any."""
    has_shown = False
    for d in range(len(delays.times)):
        while memory.next_packets[d] < delays.packet_ranges[d, 1] and (
            delays.packets[memory.next_packets[d], 0] <= t + SAME
        ):
            memory.next_packets[d] += 1
            has_shown = True
    return has_shown


def _let_happen(evaluate: Evaluate, problem: Problem, memory: Memory) -> None:
    """Executes the breaks, packets and transitions of this instant."""
    t = memory.clock[0]
    order = take_break(t, memory)
    rate = memory.stages[0]
    if memory.steered is not None:
        # The signals before any jump of this instant tell which jumps are passed.
        evaluate_beside(False, SIGNALS, evaluate, t, memory.x, problem, memory, rate)
        passed = order_passed(t, memory.steered, problem.delays, memory)
        if passed != NO_BREAK and (order == NO_BREAK or passed < order):
            order = passed
    # Transitions use the signals before the jumps that arrive now.
    is_after = order == NO_BREAK
    evaluate_beside(is_after, ALL, evaluate, t, memory.x, problem, memory, rate)
    _settle(evaluate, order, problem, memory)
    if memory.steered is not None:
        _settle_passing(evaluate, problem, memory, memory.steered)


def _settle_passing(
    evaluate: Evaluate, problem: Problem, memory: Memory, steered: Steered
) -> None:
    """Executes the jumps of this instant that leave delays of 0 s."""
    t = memory.clock[0]
    for _ in range(10):
        order = order_passed(t, steered, problem.delays, memory)
        if order == NO_BREAK:
            break
        _settle(evaluate, order, problem, memory)


def _next_stop(t_end: float, problem: Problem, memory: Memory) -> float:
    """Returns the time in s of the next packet, break or tick, or of the run's end."""
    stop = t_end
    delays = problem.delays
    transitions = problem.transitions
    for d in range(len(delays.times)):
        if memory.next_packets[d] < delays.packet_ranges[d, 1]:
            stop = min(stop, delays.packets[memory.next_packets[d], 0])
    for i in range(memory.counts[BREAKS]):
        stop = min(stop, memory.breaks[i, 0])
    for k in range(len(memory.ticks)):
        stop = min(stop, next_time(k, transitions, memory))
    if stop >= t_end - same_within(t_end):
        return t_end
    return stop


def _is_event(t: float, problem: Problem, memory: Memory) -> bool:
    """Returns whether a guard is due at t, or an output has to pass a jump."""
    if is_due(problem.transitions, memory):
        return True
    if memory.steered is not None:
        return is_passed(t, memory.steered, problem.delays, memory)
    return False


def _is_refused(delays: Delays, memory: Memory) -> bool:
    """Returns whether a signal that is a delay's time is outside of its range."""
    if memory.steered is not None:
        return is_refused(memory.steered, delays, memory)
    return False


def _find_moment(
    evaluate: Evaluate, h: float, problem: Problem, memory: Memory
) -> float:
    """Returns the first of nine shares of the step at which an event is due, or 1."""
    for node in range(1, 2 * len(NODES)):
        share = node / (2 * len(NODES))
        evaluate_within(share, evaluate, h, problem, memory)
        if _is_event(memory.clock[0] + share * h, problem, memory):
            return share
    return 1.0


def _locate(
    evaluate: Evaluate, h: float, high: float, problem: Problem, memory: Memory
) -> float:
    """Returns the share at which an event becomes due; at `high`, one is due."""
    low = 0.0
    while (high - low) * h > SAME:
        middle = (low + high) / 2
        if middle <= low or middle >= high:
            break
        evaluate_within(middle, evaluate, h, problem, memory)
        if _is_event(memory.clock[0] + middle * h, problem, memory):
            high = middle
        else:
            low = middle
    return high


def _time_to_passage(
    evaluate: Evaluate, h: float, problem: Problem, memory: Memory, steered: Steered
) -> float:
    """Returns after which time in a step of h an output passes a jump; h: it does not.

    Afterwards, y has the signals at the end of the step.
    """
    end = memory.clock[0] + h
    delays = problem.delays
    length = h
    if is_passed(end, steered, delays, memory):
        length = h * _locate(evaluate, h, 1.0, problem, memory)
    elif may_have_passed(end, steered, delays, memory):
        share = _find_moment(evaluate, h, problem, memory)
        if share < 1.0:
            length = h * _locate(evaluate, h, share, problem, memory)
    else:
        return h
    evaluate_at(SIGNALS, evaluate, end, memory.x_next, problem, memory, memory.dx)
    return length


def _start(evaluate: Evaluate, problem: Problem, memory: Memory) -> None:
    """Records the signals at the start, and executes the events of the start time.

    They are the signals before the jumps that leave a delay at the start.
    """
    t = memory.clock[0]
    rate = memory.stages[0]
    if memory.steered is not None:
        # Some jumps of the past are behind an output.
        evaluate_beside(True, SIGNALS, evaluate, t, memory.x, problem, memory, rate)
        stand_before_jumps(t, memory.steered, problem.delays, memory)
    evaluate_beside(False, ALL, evaluate, t, memory.x, problem, memory, rate)
    _record(t, memory)
    _settle(evaluate, 0, problem, memory)
    if memory.steered is not None:
        _settle_passing(evaluate, problem, memory, memory.steered)


def is_full(delays: Delays, memory: Memory) -> bool:
    """Returns whether there may be no room for the rows and breaks of another step."""
    counts = memory.counts
    room = 5
    if memory.steered is not None:
        # The rows of a try, and those of several events at one instant.
        room = 24
        if memory.steered.marks[JUMPS] + 12 > len(memory.steered.jumps):
            return True
    return counts[ROWS] + room > len(memory.row_times) or counts[BREAKS] + len(
        delays.times
    ) > len(memory.breaks)


def _limit(h: float, t: float, steered: Steered) -> float:
    """Returns a step's length h, at most the present steered delays or _SHORT, in s."""
    for k in range(len(steered.sides)):
        h = min(h, max(t - float(steered.sent[k, 0]), _SHORT))
    return h


def _length_of_step(h: float, t: float, stop: float) -> float:
    """Returns a length of about h, such that the last two before a stop are equal."""
    if t + 1.01 * h >= stop:
        return stop - t
    if t + 2 * h > stop:
        return (stop - t) / 2
    return h


def _growth_of_step(error: float, accuracy: float) -> float:
    """Returns the factor of the next step's length, 0.1 to 5; the error has order 5."""
    if error == 0.0:
        return 5.0
    if error < math.inf:
        return min(5.0, max(0.1, 0.9 * float((accuracy / error) ** (1 / 5))))
    return 0.1


def advance(
    evaluate: Evaluate,
    problem: Problem,
    memory: Memory,
    t_end: float,
    accuracy: float,
    max_step: float,
) -> int:
    """Integrates until the end time, until the memory is full, or for _MOST_TRIES.

    Args:
        memory: The state and the recorded rows. Each step adds three rows within it and
            one at its end, and a break adds another row at the same time. The delays
            read the signals sent into them from these rows.
        t_end: The end time in s. Events at this very time are not executed.
        accuracy: The largest absolute error of a step in any state.
        max_step: The longest step in s.

    Returns:
        DONE; FULL if advance() has to be called again, with more memory or for more
        tries; STUCK if even the smallest step is too inaccurate; or REFUSED if the
        signal that is a delay's time is outside of its range.
    """
    clock = memory.clock
    counts = memory.counts
    delays = problem.delays
    # A step must not be longer than a delay, whose signal would not be recorded yet.
    longest = max_step
    for d in range(len(delays.times)):
        if delays.times[d] > 0.0:
            longest = min(longest, delays.times[d])
    if counts[EVALUATIONS] == 0:
        _start(evaluate, problem, memory)
    last_try = counts[TRIES] + _MOST_TRIES
    # Where an output passes a jump within the step that has been tried, s.
    passage = math.inf
    while clock[0] < t_end - SAME:
        if is_full(delays, memory) or counts[TRIES] == last_try:
            return FULL
        counts[TRIES] += 1
        t = clock[0]
        stop = _next_stop(t_end, problem, memory)
        if stop - t <= SAME:  # Events at the end of the last call, left until now.
            _let_happen(evaluate, problem, memory)
            passage = math.inf
            continue
        h = min(clock[1], longest)
        if memory.steered is not None:
            stop = min(stop, passage)
            h = _limit(h, t, memory.steered)
            memory.steered.marks[AHEAD] = 0
        h = _length_of_step(h, t, stop)
        error = step(evaluate, h, problem, memory)
        if memory.steered is not None:
            steered = memory.steered
            error = repeat(error, evaluate, h, accuracy, problem, memory, steered)
            if error <= accuracy and is_too_fast(t + h, steered, delays, memory):
                error = _TOO_FAST * accuracy
        factor = _growth_of_step(error, accuracy)
        if not error <= accuracy:
            clock[1] = h * min(factor, 0.9)
            if clock[1] < 1e-14 * max(1.0, abs(t)):
                return STUCK
            continue
        if memory.steered is not None:
            time = _time_to_passage(evaluate, h, problem, memory, memory.steered)
            if time > 2 * SAME and time < h - _CLOSE:
                passage = t + time
                continue
            passage = math.inf
        counts[STEPS] += 1
        _end_step(evaluate, h, h * factor, stop, t_end, problem, memory)
        if _is_refused(delays, memory):
            return REFUSED
    return DONE


def _end_step(
    evaluate: Evaluate,
    h: float,
    next_h: float,
    stop: float,
    t_end: float,
    problem: Problem,
    memory: Memory,
) -> None:
    """Accepts a step: to its full length, or until a guard becomes due.

    Args:
        h: The length of the step in s.
        next_h: The length that accuracy permits for the next step, s.
        stop: The time at which the step must end at the latest, s.
        t_end: The end time of the run, s.
    """
    clock = memory.clock
    t = clock[0]
    # Whether a guard becomes due in the step, and at which share of it.
    has_come = _is_event(t + h, problem, memory)
    is_searched = not has_come and is_near(problem.transitions, memory)
    share = 1.0
    if is_searched:
        share = _find_moment(evaluate, h, problem, memory)
        has_come = share < 1.0
    length = h
    if has_come:
        length = h * _locate(evaluate, h, share, problem, memory)
        if length < h:
            set_weights(length / h, memory.weights)
            move(memory.x, memory.weights, h, memory.stages, memory.x_next)
    if has_come or is_searched:
        # The search has overwritten the signals at the end of the step.
        evaluate_at(
            SIGNALS, evaluate, t + length, memory.x_next, problem, memory, memory.dx
        )
    note_guards(False, problem.transitions, memory)
    if memory.steered is not None:
        note_sent(t + length, False, memory.steered, problem.delays, memory)
    # The step is recorded, and its end becomes the state.
    is_at_stop = h == stop - t and length == h
    end = t + length
    if is_at_stop:
        end = stop
    _record_step(evaluate, length, h, end, problem, memory)
    copy(memory.x_next, memory.x)
    # A step that a stop has shortened does not shorten the next one.
    if not is_at_stop or next_h > clock[1]:
        clock[1] = next_h
    clock[0] = end
    if (has_come or is_at_stop) and end < t_end:
        _let_happen(evaluate, problem, memory)
        return
    # Without an event, the last stage is the first stage of the next step.
    copy(memory.stages[NUM_STAGES - 1], memory.stages[0])

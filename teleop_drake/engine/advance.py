"""Integrates a problem with delays and modes: Dormand-Prince 5(4) with dense output.

The equations are a function `evaluate(t, x, m, p, y, dx, wanted)`, which computes the
rate dx of the state x and the signals y; see teleop_drake.engine.program. The outputs
of the delays are written into y before each evaluation. advance() repeats:

1. _next_stop() finds the latest time for the end of the step. No step crosses a break:
   the instant of an event or of its echo, at which its effect leaves a delay.
2. _step() tries a step. If its error is too large, a shorter step is tried.
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
from collections.abc import Callable

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.engine.breaks import MAX_ECHO, NO_BREAK, add_echoes, take_break
from teleop_drake.engine.delays import NODES, fetch
from teleop_drake.engine.dormand_prince import NUM_STAGES, A, C, E, P
from teleop_drake.engine.problem import (
    BREAKS,
    END,
    EVALUATIONS,
    ROWS,
    STEPS,
    TRIES,
    Delays,
    Memory,
    Problem,
)
from teleop_drake.engine.transitions import (
    change_modes,
    is_due,
    is_near,
    next_time,
    note_guards,
)
from teleop_drake.jit.scalar_code import ALL, RATE, SIGNALS
from teleop_drake.numerics.instants import SAME, same_within

Evaluate = Callable[..., None]

# The most tries of one call of advance(). Between the calls, its caller can check the
# progress of the run, and Python handles Ctrl-C.
_MOST_TRIES = 500

# The weights of the stages in the dense output at NODES (5, 7).
WEIGHTS_AT_NODES = (NODES[:, np.newaxis] ** np.arange(1, 5)) @ P.T

# The results of advance().
DONE = 0
FULL = 1
STUCK = 2


def _evaluate(
    wanted: int,
    evaluate: Evaluate,
    t: float,
    x: Array,
    problem: Problem,
    memory: Memory,
    dx: Array,
) -> None:
    """Writes the outputs of the delays into y, and evaluates RATE, ALL or SIGNALS.

    At the start of the step, jumps that arrive at that instant are included.
    """
    is_after = t <= memory.clock[0]
    _evaluate_beside(is_after, wanted, evaluate, t, x, problem, memory, dx)


def _evaluate_beside(
    is_after: bool,
    wanted: int,
    evaluate: Evaluate,
    t: float,
    x: Array,
    problem: Problem,
    memory: Memory,
    dx: Array,
) -> None:
    """Evaluates after the jumps that arrive at the time t, or before them."""
    fetch(t, is_after, problem.delays, memory)
    evaluate(t, x, memory.m, problem.p, memory.y, dx, wanted)
    memory.counts[EVALUATIONS] += 1


def _move(start: Array, weights: Array, h: float, stages: Array, target: Array) -> None:
    """Writes a state plus the change by the weighted rates of all stages in a step.

    There is a variable for each row: the processor adds several elements at once.
    """
    k0 = stages[0]
    k1 = stages[1]
    k2 = stages[2]
    k3 = stages[3]
    k4 = stages[4]
    k5 = stages[5]
    k6 = stages[6]
    w0 = h * weights[0]
    w1 = h * weights[1]
    w2 = h * weights[2]
    w3 = h * weights[3]
    w4 = h * weights[4]
    w5 = h * weights[5]
    w6 = h * weights[6]
    for i in range(len(target)):
        first = w0 * k0[i] + w1 * k1[i] + w2 * k2[i] + w3 * k3[i]
        target[i] = start[i] + first + (w4 * k4[i] + w5 * k5[i] + w6 * k6[i])


def _set_weights(share: float, weights: Array) -> None:
    """Computes the weights of the stages in the dense output at a share of the step."""
    for s in range(NUM_STAGES):
        power = share
        weights[s] = 0.0
        for k in range(4):
            weights[s] += P[s, k] * power
            power *= share


def _evaluate_within(
    share: float, evaluate: Evaluate, h: float, problem: Problem, memory: Memory
) -> None:
    """Evaluates all signals at a share of the step, on the dense output."""
    _set_weights(share, memory.weights)
    _evaluate_with(memory.weights, share, evaluate, h, problem, memory)


def _evaluate_with(
    weights: Array,
    share: float,
    evaluate: Evaluate,
    h: float,
    problem: Problem,
    memory: Memory,
) -> None:
    """Evaluates all signals at a share of the step, given the weights of its stages."""
    _move(memory.x, weights, h, memory.stages, memory.x_stage)
    t = memory.clock[0] + share * h
    _evaluate(SIGNALS, evaluate, t, memory.x_stage, problem, memory, memory.dx)


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
    _write(row + 3, end, memory)
    for node in range(1, 4):
        s = NODES[node] * length
        if length == h:
            weights = WEIGHTS_AT_NODES[node]
            _evaluate_with(weights, NODES[node], evaluate, h, problem, memory)
        else:
            _evaluate_within(s / h, evaluate, h, problem, memory)
        _write(row + node - 1, memory.clock[0] + s, memory)
    memory.row_ends[row + 3] = 1
    memory.counts[END] = row + 3
    memory.counts[ROWS] = row + 4


def _copy(source: Array, target: Array) -> None:
    for i in range(len(source)):
        target[i] = source[i]


def _clear(target: Array) -> None:
    for i in range(len(target)):
        target[i] = 0.0


def _write(row: int, t: float, memory: Memory) -> None:
    """Copies the signals y to a row of the recording, with their time."""
    memory.row_times[row] = t
    memory.row_ends[row] = 0
    _copy(memory.y, memory.rows[row])


def _record(t: float, memory: Memory) -> None:
    """Records a row at a time; it does not end a step."""
    _write(memory.counts[ROWS], t, memory)
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
        _evaluate(ALL, evaluate, t, memory.x, problem, memory, memory.stages[0])
        has_jumped = False
    if order != NO_BREAK:
        _record(t, memory)
        add_echoes(t, order, problem.delays, memory)
    note_guards(True, problem.transitions, memory)


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
    # Transitions use the signals before the jumps that arrive now.
    is_after = order == NO_BREAK
    rate = memory.stages[0]
    _evaluate_beside(is_after, ALL, evaluate, t, memory.x, problem, memory, rate)
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


def _step(evaluate: Evaluate, h: float, problem: Problem, memory: Memory) -> float:
    """Tries a step of the length h; returns its largest error in any state, or inf.

    Afterwards, x_next and y have the state and the signals at the end of the step.
    """
    t = memory.clock[0]
    stages = memory.stages
    for s in range(1, NUM_STAGES):
        # A rate of nan from the last step would count even with a weight of 0.
        _clear(stages[s])
    for s in range(1, NUM_STAGES):
        is_last = s == NUM_STAGES - 1
        target = memory.x_stage
        wanted = RATE
        if is_last:
            target = memory.x_next
            wanted = ALL
        _move(memory.x, A[s], h, stages, target)
        _evaluate(wanted, evaluate, t + C[s] * h, target, problem, memory, stages[s])
    error = 0.0
    errors = memory.dx
    _clear(errors)
    _move(errors, E, h, stages, errors)
    for i in range(len(errors)):
        # This comparison is false for nan, too.
        if not abs(errors[i]) < math.inf:
            return math.inf
        error = max(error, abs(errors[i]))
    return error


def _find_moment(
    evaluate: Evaluate, h: float, problem: Problem, memory: Memory
) -> float:
    """Returns the first of nine shares of the step at which a guard is due, or 1."""
    for node in range(1, 2 * len(NODES)):
        share = node / (2 * len(NODES))
        _evaluate_within(share, evaluate, h, problem, memory)
        if is_due(problem.transitions, memory):
            return share
    return 1.0


def _locate(
    evaluate: Evaluate, h: float, high: float, problem: Problem, memory: Memory
) -> float:
    """Returns the share at which a guard becomes due; at `high`, one is due."""
    low = 0.0
    while (high - low) * h > SAME:
        middle = (low + high) / 2
        if middle <= low or middle >= high:
            break
        _evaluate_within(middle, evaluate, h, problem, memory)
        if is_due(problem.transitions, memory):
            high = middle
        else:
            low = middle
    return high


def _start(evaluate: Evaluate, problem: Problem, memory: Memory) -> None:
    """Records the signals at the start, and executes the events of the start time.

    They are the signals before the jumps that leave a delay at the start.
    """
    t = memory.clock[0]
    rate = memory.stages[0]
    _evaluate_beside(False, ALL, evaluate, t, memory.x, problem, memory, rate)
    _record(t, memory)
    _settle(evaluate, 0, problem, memory)


def is_full(delays: Delays, memory: Memory) -> bool:
    """Returns whether there may be no room for the rows and breaks of another step."""
    counts = memory.counts
    return counts[ROWS] + 5 > len(memory.row_times) or counts[BREAKS] + len(
        delays.times
    ) > len(memory.breaks)


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
        tries; or STUCK if even the smallest step is too inaccurate.
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
    while clock[0] < t_end - SAME:
        if is_full(delays, memory) or counts[TRIES] == last_try:
            return FULL
        counts[TRIES] += 1
        t = clock[0]
        stop = _next_stop(t_end, problem, memory)
        if stop - t <= SAME:  # Events at the end of the last call, left until now.
            _let_happen(evaluate, problem, memory)
            continue
        h = _length_of_step(min(clock[1], longest), t, stop)
        error = _step(evaluate, h, problem, memory)
        factor = _growth_of_step(error, accuracy)
        if not error <= accuracy:
            clock[1] = h * min(factor, 0.9)
            if clock[1] < 1e-14 * max(1.0, abs(t)):
                return STUCK
            continue
        counts[STEPS] += 1
        _end_step(evaluate, h, h * factor, stop, t_end, problem, memory)
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
    has_come = is_due(problem.transitions, memory)
    is_searched = not has_come and is_near(problem.transitions, memory)
    share = 1.0
    if is_searched:
        share = _find_moment(evaluate, h, problem, memory)
        has_come = share < 1.0
    length = h
    if has_come:
        length = h * _locate(evaluate, h, share, problem, memory)
        if length < h:
            _set_weights(length / h, memory.weights)
            _move(memory.x, memory.weights, h, memory.stages, memory.x_next)
    if has_come or is_searched:
        # The search has overwritten the signals at the end of the step.
        _evaluate(
            SIGNALS, evaluate, t + length, memory.x_next, problem, memory, memory.dx
        )
    note_guards(False, problem.transitions, memory)
    # The step is recorded, and its end becomes the state.
    is_at_stop = h == stop - t and length == h
    end = t + length
    if is_at_stop:
        end = stop
    _record_step(evaluate, length, h, end, problem, memory)
    _copy(memory.x_next, memory.x)
    # A step that a stop has shortened does not shorten the next one.
    if not is_at_stop or next_h > clock[1]:
        clock[1] = next_h
    clock[0] = end
    if (has_come or is_at_stop) and end < t_end:
        _let_happen(evaluate, problem, memory)
        return
    # Without an event, the last stage is the first stage of the next step.
    _copy(memory.stages[NUM_STAGES - 1], memory.stages[0])

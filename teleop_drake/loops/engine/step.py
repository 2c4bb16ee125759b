"""The steps of advance(): evaluations at their stages, tries, and their dense output.

All functions here are in the part of Python that jit/typed_code compiles.
"""

import math
from collections.abc import Callable

import numpy as np

from teleop_drake.loops.engine.delays import NODES, fetch
from teleop_drake.loops.engine.dormand_prince import NUM_STAGES, A, C, E, P
from teleop_drake.loops.engine.problem import (
    AHEAD,
    BEYOND,
    EVALUATIONS,
    ROWS,
    Delays,
    Memory,
    Problem,
    Steered,
)
from teleop_drake.loops.engine.steered import fetch_steered, has_turned
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.jit.scalar_code import ALL, RATE, SIGNALS

Evaluate = Callable[..., None]

# The weights of the stages in the dense output at NODES (5, 7).
WEIGHTS_AT_NODES = (NODES[:, np.newaxis] ** np.arange(1, 5)) @ P.T

# The most tries of a step whose own signals leave a delay within it.
_MOST_REPEATS = 10


def evaluate_at(
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
    evaluate_beside(is_after, wanted, evaluate, t, x, problem, memory, dx)


def evaluate_beside(
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
    if memory.steered is not None:
        steered = memory.steered
        _find_steered(is_after, evaluate, t, x, problem, memory, steered, dx)
    evaluate(t, x, memory.m, problem.p, memory.y, dx, wanted)
    memory.counts[EVALUATIONS] += 1


def _find_steered(
    is_after: bool,
    evaluate: Evaluate,
    t: float,
    x: Array,
    problem: Problem,
    memory: Memory,
    steered: Steered,
    dx: Array,
) -> None:
    """Writes the outputs of the delays whose time is a signal into y.

    The time of a delay may depend on the output of another one, and so on.
    """
    delays = problem.delays
    for k in range(len(delays.steering.delays)):
        evaluate(t, x, memory.m, problem.p, memory.y, dx, RATE)
        memory.counts[EVALUATIONS] += 1
        if k > 0 and not has_turned(steered, delays, memory):
            break
        fetch_steered(t, is_after, steered, delays, memory)


def move(start: Array, weights: Array, h: float, stages: Array, target: Array) -> None:
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


def set_weights(share: float, weights: Array) -> None:
    """Computes the weights of the stages in the dense output at a share of the step."""
    for s in range(NUM_STAGES):
        power = share
        weights[s] = 0.0
        for k in range(4):
            weights[s] += P[s, k] * power
            power *= share


def evaluate_within(
    share: float, evaluate: Evaluate, h: float, problem: Problem, memory: Memory
) -> None:
    """Evaluates all signals at a share of the step, on the dense output."""
    set_weights(share, memory.weights)
    evaluate_with(memory.weights, share, evaluate, h, problem, memory)


def evaluate_with(
    weights: Array,
    share: float,
    evaluate: Evaluate,
    h: float,
    problem: Problem,
    memory: Memory,
) -> None:
    """Evaluates all signals at a share of the step, given the weights of its stages."""
    move(memory.x, weights, h, memory.stages, memory.x_stage)
    t = memory.clock[0] + share * h
    evaluate_at(SIGNALS, evaluate, t, memory.x_stage, problem, memory, memory.dx)


def copy(source: Array, target: Array) -> None:
    """Copies an array into another one."""
    for i in range(len(source)):
        target[i] = source[i]


def clear(target: Array) -> None:
    """Sets the elements of an array to 0."""
    for i in range(len(target)):
        target[i] = 0.0


def write(row: int, t: float, memory: Memory) -> None:
    """Copies the signals y to a row of the recording, with their time."""
    memory.row_times[row] = t
    memory.row_ends[row] = 0
    copy(memory.y, memory.rows[row])


def step(evaluate: Evaluate, h: float, problem: Problem, memory: Memory) -> float:
    """Tries a step of the length h; returns its largest error in any state, or inf.

    Afterwards, x_next and y have the state and the signals at the end of the step.
    """
    t = memory.clock[0]
    stages = memory.stages
    if memory.steered is not None:
        memory.steered.marks[BEYOND] = 0
    for s in range(1, NUM_STAGES):
        # A rate of nan from the last step would count even with a weight of 0.
        clear(stages[s])
    for s in range(1, NUM_STAGES):
        is_last = s == NUM_STAGES - 1
        target = memory.x_stage
        wanted = RATE
        if is_last:
            target = memory.x_next
            wanted = ALL
        move(memory.x, A[s], h, stages, target)
        evaluate_at(wanted, evaluate, t + C[s] * h, target, problem, memory, stages[s])
    error = 0.0
    errors = memory.dx
    clear(errors)
    move(errors, E, h, stages, errors)
    for i in range(len(errors)):
        # This comparison is false for nan, too.
        if not abs(errors[i]) < math.inf:
            return math.inf
        error = max(error, abs(errors[i]))
    return error


def repeat(
    error: float,
    evaluate: Evaluate,
    h: float,
    accuracy: float,
    problem: Problem,
    memory: Memory,
    steered: Steered,
) -> float:
    """Repeats a step with the signals of its own last try in the delays, if needed.

    Args:
        error: The error of the step.

    Returns:
        The error, as step(); infinity if the tries do not converge.
    """
    if steered.marks[BEYOND] == 0:
        return error
    delays = problem.delays
    t = memory.clock[0]
    # Beside the rows that the recording of the step will write.
    row = memory.counts[ROWS] + 8
    for _ in range(_MOST_REPEATS):
        copy(memory.x_next, steered.x_before)
        change = math.inf
        if steered.marks[AHEAD] > 0:
            change = _change_of_try(row + 4, delays, memory)
        copy(memory.rows[memory.counts[ROWS] - 1], memory.rows[row])
        memory.row_times[row] = t
        write(row + 4, t + h, memory)
        for node in range(1, 4):
            weights = WEIGHTS_AT_NODES[node]
            evaluate_with(weights, NODES[node], evaluate, h, problem, memory)
            write(row + node, t + NODES[node] * h, memory)
        steered.marks[AHEAD] = row
        error = step(evaluate, h, problem, memory)
        for i in range(len(memory.x)):
            change = max(change, abs(memory.x_next[i] - steered.x_before[i]))
        if change <= 0.1 * accuracy:
            return error
    return math.inf


def _change_of_try(row: int, delays: Delays, memory: Memory) -> float:
    """Returns the largest change of a delay's signal since the row of the last try."""
    change = 0.0
    for d in range(len(delays.times)):
        for i in range(delays.sizes[d]):
            place = delays.signals[d] + i
            change = max(change, abs(memory.y[place] - memory.rows[row, place]))
    return change

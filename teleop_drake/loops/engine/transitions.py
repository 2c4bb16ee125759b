"""The guards and transitions of a problem, as advance() executes them.

All functions here are in the part of Python that jit/typed_code compiles.
"""

import math

from teleop_drake.loops.engine.problem import Memory, Transitions
from teleop_drake.loops.numerics.instants import same_within


def next_time(k: int, transitions: Transitions, memory: Memory) -> float:
    """Returns when periodic transition k happens next, s; infinity for a guarded one.

    The time is the offset plus a multiple of the period, so no rounding accumulates.
    """
    ticks = memory.ticks[k]
    time = float(transitions.offsets[k])
    if ticks > 0:
        time += ticks * transitions.periods[k]
    return time


def is_due(transitions: Transitions, memory: Memory) -> bool:
    """Returns whether any guard is at least 0, so that its transition is due."""
    for k in range(len(transitions.guards)):
        place = transitions.guards[k]
        if place >= 0 and memory.y[place] >= 0:
            return True
    return False


def change_modes(has_jumped: bool, transitions: Transitions, memory: Memory) -> bool:
    """Executes the transitions that are due; returns whether there were any.

    All of them use the signals from before any of them. Each changes those elements of
    the mode in which its new mode differs from the old one. Discrete updates use the
    signals after the other transitions and jumps of the instant. They therefore wait
    for a later call if another transition has been executed or if `has_jumped`.

    Args:
        has_jumped: Whether a signal jumps at this instant and y is still the value
            before the jump.
    """
    # First the other transitions, then the discrete updates.
    has_changed = False
    for is_discrete in range(2):
        if is_discrete == 1 and (has_changed or has_jumped):
            break
        for k in range(len(transitions.guards)):
            if transitions.are_discrete[k] != is_discrete:
                continue
            if _is_due_now(k, transitions, memory):
                _execute(k, transitions, memory)
                has_changed = True
    for i in range(len(memory.m)):
        memory.m_before[i] = memory.m[i]
    return has_changed


def _is_due_now(k: int, transitions: Transitions, memory: Memory) -> bool:
    """Returns whether transition k is due, by its guard or by its time."""
    place = transitions.guards[k]
    if place >= 0:
        return memory.y[place] >= 0
    t = memory.clock[0]
    time = next_time(k, transitions, memory)
    return abs(time - t) <= same_within(t)


def _execute(k: int, transitions: Transitions, memory: Memory) -> None:
    """Changes the mode by transition k, where its new mode differs from the old one."""
    if transitions.guards[k] < 0:
        memory.ticks[k] += 1
    for i in range(transitions.sizes[k]):
        element = transitions.targets[k] + i
        value = memory.y[transitions.sources[k] + i]
        if value != memory.m_before[element]:
            memory.m[element] = value


def note_guards(has_jumped: bool, transitions: Transitions, memory: Memory) -> None:
    """Stores the values of the guards at the start of a step.

    Args:
        has_jumped: Whether the guards may just have jumped. The values at the start of
            the step before are then replaced.
    """
    guards = memory.guards
    for k in range(len(transitions.guards)):
        place = transitions.guards[k]
        if place >= 0:
            guards[k, 1] = guards[k, 0]
            guards[k, 0] = memory.y[place]
            if has_jumped:
                guards[k, 1] = guards[k, 0]


def is_near(transitions: Transitions, memory: Memory) -> bool:
    """Returns whether a guard may have reached 0 within the step and turned back.

    It may if, at the end of the step, its distance from 0 is at most the sum of its
    changes over this step and over the step before. A guard that has turned back has
    changed in at least one of the two.
    """
    guards = memory.guards
    for k in range(len(transitions.guards)):
        place = transitions.guards[k]
        # A guard of -infinity, as of a region without an end, is never due.
        if place >= 0 and memory.y[place] > -math.inf:
            change = abs(memory.y[place] - guards[k, 0])
            change += abs(guards[k, 0] - guards[k, 1])
            if memory.y[place] + change >= 0:
                return True
    return False

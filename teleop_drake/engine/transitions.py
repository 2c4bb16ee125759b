"""Guards and modes of the system that advance() integrates.

All functions here are in the part of Python that jit/typed_code compiles.
"""

import math

from teleop_drake.engine.problem import Memory, Transitions
from teleop_drake.numerics.instants import same_within


def next_time(k: int, transitions: Transitions, memory: Memory) -> float:
    """Returns when a periodic transition happens next, s; infinity for others.

    The time is a multiple of the period, so that no rounding accumulates.
    """
    ticks = memory.ticks[k]
    time = float(transitions.offsets[k])
    if ticks > 0:
        time += ticks * transitions.periods[k]
    return time


def is_due(transitions: Transitions, memory: Memory) -> bool:
    """Returns whether a guard is not negative."""
    for k in range(len(transitions.guards)):
        place = transitions.guards[k]
        if place >= 0 and memory.y[place] >= 0:
            return True
    return False


def change_modes(has_jumped: bool, transitions: Transitions, memory: Memory) -> bool:
    """Executes the transitions that are due; returns whether there were any.

    All are evaluated with the values before any of them. Each changes those elements of
    the mode that differ between the old and its new mode. Discrete updates are executed
    after all others and, if a signal has just jumped, after its evaluation.
    """
    t = memory.clock[0]
    has_changed = False
    for is_discrete in range(2):
        if is_discrete == 1 and (has_changed or has_jumped):
            break
        for k in range(len(transitions.guards)):
            if transitions.are_discrete[k] != is_discrete:
                continue
            place = transitions.guards[k]
            if place >= 0:
                is_due = memory.y[place] >= 0
            else:
                time = next_time(k, transitions, memory)
                is_due = abs(time - t) <= same_within(t)
                if is_due:
                    memory.ticks[k] += 1
            if is_due:
                has_changed = True
                for i in range(transitions.sizes[k]):
                    element = transitions.targets[k] + i
                    value = memory.y[transitions.sources[k] + i]
                    if value != memory.m_before[element]:
                        memory.m[element] = value
    for i in range(len(memory.m)):
        memory.m_before[i] = memory.m[i]
    return has_changed


def note_guards(has_jumped: bool, transitions: Transitions, memory: Memory) -> None:
    """Stores the values of the guards at the start of a step."""
    guards = memory.guards
    for k in range(len(transitions.guards)):
        place = transitions.guards[k]
        if place >= 0:
            guards[k, 1] = guards[k, 0]
            guards[k, 0] = memory.y[place]
            if has_jumped:
                guards[k, 1] = guards[k, 0]


def is_near(transitions: Transitions, memory: Memory) -> bool:
    """Returns whether a guard may have ceased to be negative within the step.

    In that case its distance from 0 at the end is at most its change over this step and
    the last one. A guard that has already turned back has changed in one of the two.
    """
    guards = memory.guards
    for k in range(len(transitions.guards)):
        place = transitions.guards[k]
        # A region without an end has a guard that is infinite.
        if place >= 0 and memory.y[place] > -math.inf:
            change = abs(memory.y[place] - guards[k, 0])
            change += abs(guards[k, 0] - guards[k, 1])
            if memory.y[place] + change >= 0:
                return True
    return False

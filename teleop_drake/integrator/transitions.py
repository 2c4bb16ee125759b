"""Guards and modes of the system that advance() integrates.

All functions here are in the part of Python that machine_code/typed_code compiles.
"""

import math

from teleop_drake.integrator.problem import Memory, Transitions
from teleop_drake.numerics.instants import same_within


def next_time(k: int, transitions: Transitions, memory: Memory) -> float:
    """Returns when a periodic transition happens next, s; infinity for others.

    Periods are not added up, so that nothing drifts.
    """
    ticks = memory.ticks[k]
    time = float(transitions.offsets[k])
    return time + ticks * transitions.periods[k] if ticks > 0 else time


def is_due(transitions: Transitions, memory: Memory) -> bool:
    """Returns whether a guard is not negative."""
    for k in range(len(transitions.guards)):
        place = transitions.guards[k]
        if place >= 0 and memory.y[place] >= 0:
            return True
    return False


def change_modes(has_jumped: bool, transitions: Transitions, memory: Memory) -> bool:
    """Makes the transitions that are due; returns whether there were any.

    All see what was there before any of them, and each changes the elements in which
    its new mode differs from that. Discrete updates wait until nothing else is due, and
    if a signal has just jumped until it has been evaluated.
    """
    t = memory.clock[0]
    has_changed = False
    for is_discrete in range(2):
        if is_discrete and (has_changed or has_jumped):
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
    """Notes the guards at the begin of a step."""
    guards = memory.guards
    for k in range(len(transitions.guards)):
        place = transitions.guards[k]
        if place >= 0:
            guards[k, 1] = memory.y[place] if has_jumped else guards[k, 0]
            guards[k, 0] = memory.y[place]


def is_near(transitions: Transitions, memory: Memory) -> bool:
    """Returns whether a guard may have ceased to be negative within the step.

    Then it is as near to 0 at the end as it has changed in this step and the last one.
    A guard on its way back has changed in the one or in the other.
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

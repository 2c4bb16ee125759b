"""Guards and modes; test_advance.py integrates with them."""

import types

import numpy as np
import pytest

from teleop_drake.loops.engine.problem import Transitions
from teleop_drake.loops.engine.transitions import (
    change_modes,
    is_due,
    is_near,
    next_time,
    note_guards,
)

# One with a guard, one every 0.5 s, and a discrete update that comes with the latter.
TRANSITIONS = Transitions(
    guards=np.array([0, -1, -1]),
    sources=np.array([1, 3, 5]),
    targets=np.array([0, 0, 2]),
    sizes=np.array([2, 2, 1]),
    periods=np.array([np.inf, 0.5, 1.0]),
    offsets=np.array([np.inf, 0.0, 0.5]),
    are_discrete=np.array([0, 0, 1]),
)


def a_memory(time=0.2, guard=-1.0):
    return types.SimpleNamespace(
        clock=np.array([time]),
        y=np.array([guard, 7.0, 0.0, 0.0, 8.0, 9.0]),
        m=np.zeros(3),
        m_before=np.zeros(3),
        ticks=np.array([0, 1, 0]),
        guards=np.zeros((3, 2)),
    )


@pytest.mark.parametrize(
    ("time", "guard", "mode"),
    [
        (0.2, -1.0, [0, 0, 0]),
        (0.2, 0.0, [7, 0, 0]),
        (0.5, -1.0, [0, 8, 0]),
        (0.5 - 1e-13, 1.0, [7, 8, 0]),
        (0.5 - 1e-9, 1.0, [7, 0, 0]),
    ],
)
def test_modes_change_when_they_are_due(time, guard, mode):
    memory = a_memory(time, guard)
    assert is_due(TRANSITIONS, memory) == (guard >= 0)
    assert change_modes(False, TRANSITIONS, memory) == any(mode)
    assert memory.m.tolist() == mode
    is_tick = time > 0.5 - 1e-10
    assert next_time(1, TRANSITIONS, memory) == (1.0 if is_tick else 0.5)
    memory.y[0] = -1.0
    assert change_modes(False, TRANSITIONS, memory) == is_tick
    assert memory.m.tolist() == [*mode[:2], 9 if is_tick else 0]
    assert not change_modes(False, TRANSITIONS, memory)


def test_a_discrete_update_waits_until_a_jump_has_been_evaluated():
    memory = a_memory(0.5)
    memory.ticks[1] = 9  # It is due by itself.
    assert not change_modes(True, TRANSITIONS, memory)
    assert change_modes(False, TRANSITIONS, memory)


def test_a_guard_is_near_if_it_has_changed_as_much():
    memory = a_memory(guard=-1.0)
    note_guards(True, TRANSITIONS, memory)
    assert memory.guards[0].tolist() == [-1.0, -1.0]
    memory.y[0] = -0.6  # It rises by 0.4: once more would not reach 0.
    assert not is_near(TRANSITIONS, memory)
    note_guards(False, TRANSITIONS, memory)
    assert memory.guards[0].tolist() == [-0.6, -1.0]
    memory.y[0] = -0.3  # It could have been above 0 and be on its way back.
    assert is_near(TRANSITIONS, memory)

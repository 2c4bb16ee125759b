"""Guards and modes; test_delay_integrator.py integrates with them."""

import types

import numpy as np
import pytest

from teleop_drake.numerics.delay_problem import Transitions
from teleop_drake.numerics.transitions import (
    change_modes,
    is_due,
    is_near,
    note_guards,
)

# One with a guard, and one every 0.5 s; each puts a signal into the mode.
TRANSITIONS = Transitions(
    guards=np.array([0, -1]),
    sources=np.array([1, 2]),
    targets=np.array([0, 1]),
    sizes=np.array([1, 1]),
    periods=np.array([np.inf, 0.5]),
)


def a_memory(time=0.2, guard=-1.0):
    return types.SimpleNamespace(
        clock=np.array([time]),
        y=np.array([guard, 7.0, 8.0]),
        m=np.zeros(2),
        next_times=np.array([np.inf, 0.5]),
        guards=np.zeros((2, 2)),
    )


@pytest.mark.parametrize(
    ("time", "guard", "mode"),
    [(0.2, -1.0, [0, 0]), (0.2, 1.0, [7, 0]), (0.5, 0.0, [0, 8])],
)
def test_modes_change_when_they_are_due(time, guard, mode):
    memory = a_memory(time, guard)
    assert is_due(TRANSITIONS, memory) == (guard > 0)
    assert change_modes(TRANSITIONS, memory) == any(mode)
    assert memory.m.tolist() == mode
    assert memory.next_times[1] == (1.0 if time == 0.5 else 0.5)


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

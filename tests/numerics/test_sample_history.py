"""Tests of the samples on their way through a delay."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from teleop_drake.numerics.sample_history import SampleHistory

DELAY = 0.1


@given(steps=st.lists(st.floats(0.005, DELAY), min_size=10, max_size=80))
def test_a_new_sample_does_not_move_what_is_delivered_now(steps):
    history, time = SampleHistory(), 0.0
    for step in steps:
        value = np.array([np.sin(9 * time), np.cos(40 * time)])
        before = history.eval(time) if time > DELAY else None
        history = history.append(time + DELAY, value, now=time, spacing=DELAY / 1024)
        if before is not None:
            np.testing.assert_array_equal(history.eval(time), before)
        time += step


def test_evaluating_it_changes_nothing():
    asked = left_alone = SampleHistory()
    for time in np.arange(0.0, 2.0, 0.03).tolist():
        value = np.array([np.sin(9 * time)])
        asked, left_alone = (
            history.append(time + DELAY, value, now=time, spacing=DELAY / 1024)
            for history in (asked, left_alone)
        )
        for ahead in (0.0, 0.01, 0.09):
            asked.eval(time + ahead)
    for time in (2.0, 2.03, 2.06):
        np.testing.assert_array_equal(asked.eval(time), left_alone.eval(time))

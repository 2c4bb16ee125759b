"""The law of passivity control: no port releases more energy than its budget."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teleop_drake.model.laws.passivity import (
    energy_budget,
    injected_resistance,
    scaled_energy_rates,
)


@given(
    st.floats(-1, 1), st.floats(-1, 1), st.floats(-1e-3, 1e-3), st.floats(0.001, 0.1)
)
def test_no_more_leaves_than_there_is(force, velocity, budget, horizon):
    F = np.array([force])
    v = np.array([velocity])
    r = injected_resistance(F, v, np.array([budget]), horizon, 1e300)
    power = float((F * v - r * v * v)[0])
    assert r[0] >= 0
    if r[0] == 0:
        assert power <= max(budget, 0) / horizon + 1e-15 or v[0] ** 2 == 0
    else:
        assert power == pytest.approx(max(budget, 0) / horizon, abs=1e-12)
        # Damping never reverses the force.
        assert abs((F - r * v)[0]) <= abs(force) + 1e-12
    limited = injected_resistance(F, v, np.array([budget]), horizon, 0.5)
    assert limited[0] == min(r[0], 0.5)


def test_the_budget_is_what_came_in_less_what_went_out():
    """A port takes in 3 W for 0.2 s, then releases 2 W for 0.1 s."""
    scale = 0.01
    received = np.zeros(1)
    spent = np.zeros(1)
    for power, time in ((3.0, 0.2), (-2.0, 0.1)):
        rates = scaled_energy_rates(np.array([power]), scale)
        received += scale * rates[:1] * time
        spent += rates[1:] * time
    budget = energy_budget(0.05, received, spent, scale)
    assert budget == pytest.approx(0.05 + 0.6 - 0.2, abs=1e-12)

"""Passivity control on paper: no port gives more than it has."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teleop_drake.laws.passivity import (
    injected_resistance,
    master_mobility,
    scaled_energy_rates,
    slave_damping,
)


@given(
    st.floats(-1, 1), st.floats(-1, 1), st.floats(-1e-3, 1e-3), st.floats(0.001, 0.1)
)
def test_no_more_leaves_than_there_is(force, velocity, budget, horizon):
    F, v = np.array([force]), np.array([velocity])
    r = injected_resistance(F * v, v, np.array([budget]), horizon, 1e300)
    power = float((F * v - r * v * v)[0])
    assert r[0] >= 0
    if r[0] == 0:
        assert power <= max(budget, 0) / horizon + 1e-15 or v[0] ** 2 == 0
    else:
        assert power == pytest.approx(max(budget, 0) / horizon, abs=1e-12)
        # Damping never turns the force round.
        assert abs((F - r * v)[0]) <= abs(force) + 1e-12
    limited = injected_resistance(F * v, v, np.array([budget]), horizon, 0.5)
    assert limited[0] == min(r[0], 0.5)


def test_energy_flows_one_way_at_a_time():
    rates = scaled_energy_rates(np.array([2.0, -3.0]), 2.0)
    assert rates.tolist() == [1.0, 0.0, 0.0, 1.5]


def test_the_ports_differ_in_what_leaves():
    """At the master -F v leaves towards the hand, at the slave F v towards the tool."""
    F, v, empty = np.array([2.0, -2.0]), np.array([0.5, 0.5]), np.zeros(2)
    assert master_mobility(F, v, empty, 0.01, 9.0) == pytest.approx([0.0, 0.25])
    assert slave_damping(F, v, empty, 0.01, 9.0) == pytest.approx([4.0, 0.0])

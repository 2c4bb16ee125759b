"""The law of passivity control: no port releases more energy than its budget."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teleop_drake.model.laws.passivity import (
    injected_resistance,
)


@given(
    st.floats(-1, 1), st.floats(-1, 1), st.floats(-1e-3, 1e-3), st.floats(0.001, 0.1)
)
def test_no_more_leaves_than_there_is(force, velocity, budget, horizon):
    F, v = np.array([force]), np.array([velocity])
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

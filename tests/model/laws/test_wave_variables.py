"""The power of the wave line; test_felt_stiffness has the stiffness that it adds."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teleop_drake.model.laws.wave_variables import (
    master_velocity,
    passive_scaling,
    reflected_wave,
    slave_force,
    wave_root,
)

numbers = st.floats(-1e3, 1e3)
vectors = st.lists(numbers, min_size=2, max_size=2).map(np.array)


@given(vectors, vectors, st.floats(0.1, 10), st.floats(0.1, 10), st.floats(-0.9, 0.9))
def test_power_is_the_difference_of_the_waves(first, second, b1, b2, r):
    b12 = r * math.sqrt(b1 * b2)
    b = np.array([[b1, b12], [b12, b2]])
    S = wave_root(b)
    assert pytest.approx(2 * b) == S @ S
    scale = 1 + abs(first).max() ** 2 + abs(second).max() ** 2
    # At the slave, v and u are given.
    F = slave_force(first, second, root=S)
    w = reflected_wave(first, second, root=S)
    assert F @ first == pytest.approx((second @ second - w @ w) / 2, abs=1e-8 * scale)
    # The definitions of u and w.
    assert S @ second == pytest.approx(b @ first + F, abs=1e-9 * scale)
    assert S @ w == pytest.approx(b @ first - F, abs=1e-9 * scale)
    # At the master, F and w are given.
    v = master_velocity(first, second, root=S, damping=np.zeros((2, 2)))
    u = reflected_wave(v, second, root=S)
    assert first @ v == pytest.approx((u @ u - second @ second) / 2, abs=1e-7 * scale)


@pytest.mark.parametrize(("slope", "factor"), [(-1.0, 1.0), (0.0, 1.0), (0.36, 0.8)])
def test_a_delay_that_grows_stretches_the_wave(slope, factor):
    assert passive_scaling(slope) == pytest.approx(factor)
    with pytest.raises(ValueError, match="max_slope"):
        passive_scaling(1.0)

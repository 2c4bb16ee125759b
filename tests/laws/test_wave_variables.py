"""The wave line on paper: its power, and what it feels like."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teleop_drake.laws.wave_variables import (
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
    # The slave: v and u are given.
    F, w = (
        slave_force(first, second, root=S),
        reflected_wave(first, second, root=S),
    )
    assert F @ first == pytest.approx((second @ second - w @ w) / 2, abs=1e-8 * scale)
    # Both definitions.
    assert S @ second == pytest.approx(b @ first + F, abs=1e-9 * scale)
    assert S @ w == pytest.approx(b @ first - F, abs=1e-9 * scale)
    # The master: F and w are given.
    v = master_velocity(first, second, root=S, damping=np.zeros((2, 2)))
    u = reflected_wave(v, second, root=S)
    assert first @ v == pytest.approx((u @ u - second @ second) / 2, abs=1e-7 * scale)


def InputImpedance(b, T, omega, load):
    """F/v at the master's end of a line of round trip T with Z = load(s) behind."""
    s = 1j * omega
    S = wave_root([[b]])
    z = cmath.exp(-s * T / 2)

    def Returned(u):
        """The wave that comes back to the master, all as phasors."""
        u = np.array([u * z])
        # slave_force is affine in v: F(v) = F(0) + v (F(1) - F(0)) = load v.
        F0 = slave_force(np.zeros(1), u, root=S)[0]
        F1 = slave_force(np.ones(1), u, root=S)[0]
        v = 0 if load is None else F0 / (load(s) - (F1 - F0))
        return reflected_wave(np.array([v]), u, root=S)[0] * z

    gain = Returned(1.0)
    # u = S v - w and w = gain u, so that v = (1 + gain) u / S.
    w = gain / (1 + gain) * S[0, 0]
    # With v = 1 the law must give that force back.
    F0 = master_velocity(np.zeros(1), np.array([w]), root=S, damping=np.zeros((1, 1)))[
        0
    ]
    F1 = master_velocity(np.ones(1), np.array([w]), root=S, damping=np.zeros((1, 1)))[0]
    return (1 - F0) / (F1 - F0)


B, T = 0.92, 0.2


@pytest.mark.parametrize("omega", [0.3, 2.0, 9.0])
def test_the_line_is_a_transmission_line(omega):
    s, tau = 1j * omega, T / 2
    free = InputImpedance(B, T, omega, lambda s: 0.0)
    assert free == pytest.approx(B * cmath.tanh(s * tau))
    wall = InputImpedance(B, T, omega, None)
    assert wall == pytest.approx(B / cmath.tanh(s * tau))
    matched = InputImpedance(B, T, omega, lambda s: B)
    assert matched == pytest.approx(B)


@pytest.mark.parametrize(("slope", "factor"), [(-1.0, 1.0), (0.0, 1.0), (0.36, 0.8)])
def test_a_delay_that_grows_stretches_the_wave(slope, factor):
    assert passive_scaling(slope) == pytest.approx(factor)
    with pytest.raises(ValueError, match="max_slope"):
        passive_scaling(1.0)

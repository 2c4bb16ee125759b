"""Lawrence's architecture on paper: ideal gains make both ends one body."""

import numpy as np
import pytest

from teleop_drake.laws.four_channel import (
    filtered_acceleration,
    master_packet,
    master_rate,
    slave_force,
    slave_packet,
)

RANDOM = np.random.default_rng(4)
START = np.array([0.5, -0.2])


def SymmetricPositive():
    A = RANDOM.normal(size=(2, 2))
    return A @ A.T + np.eye(2)


M_m, B_m, B_s, B_c, K_c, M_s = (SymmetricPositive() for _ in range(6))
x_m, v_m, a_m, p, v, a, F_h, F_e = RANDOM.normal(size=(8, 2))


def test_ideal_gains_leave_the_error_its_own_dynamics():
    """Z_m (v_m - v_s) + C_m (v_m - v_s) = (1 + C6) (F_h - F_e), with accelerations."""
    C6 = -0.3
    packet = np.concatenate([p, v, F_e, a])
    state = np.concatenate([x_m, v_m, v_m])
    factors = np.array([1 + C6, 1.0, C6])
    rate = master_rate(state, F_h, packet, START, M_m, B_m, K_c, factors, 50.0)
    np.testing.assert_array_equal(rate[:2], v_m)
    inertia = M_m @ (rate[2:4] - a)
    expected = (1 + C6) * (F_h - F_e) - B_m @ (v_m - v) - K_c @ (x_m - p)
    np.testing.assert_allclose(inertia, expected, rtol=1e-12)


def test_an_ideal_slave_moves_as_the_master_and_feels_what_he_feels():
    """With M dv/dt = F_c - F_e - B v the tool has the master's acceleration."""
    C5 = 0.4
    packet = np.concatenate([x_m, v_m, F_e, a_m])
    factors = np.array([1.0, 1 + C5, C5])
    F_c = slave_force(packet, x_m, v_m, F_e, START, M_s, B_s, B_c, K_c, factors)
    acceleration = np.linalg.solve(M_s, F_c - F_e - B_s @ v_m)
    np.testing.assert_allclose(acceleration, a_m, rtol=1e-10)


def test_packets_have_accelerations_behind_a_filter_or_none():
    filtered = filtered_acceleration(v, v_m, 50.0)
    assert filtered == pytest.approx(50 * (v - v_m))
    for packet, kinds in (
        (master_packet(np.concatenate([x_m, v_m]), F_h, 0.0), [x_m, v_m, F_h]),
        (slave_packet(np.array([]), p, v, F_e, 0.0), [p, v, F_e]),
        (slave_packet(v_m, p, v, F_e, 50.0), [p, v, F_e, filtered]),
        (
            master_packet(np.concatenate([x_m, v, v_m]), F_h, 50.0),
            [x_m, v, F_h, filtered],
        ),
    ):
        np.testing.assert_array_equal(packet, np.concatenate(kinds))

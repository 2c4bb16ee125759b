"""P+d on paper: a spring between the ends, and its condition of stability."""

import numpy as np
import pytest

from teleop_drake.laws.proportional import coupling_force, master_rate, slave_force

K, M, B = np.array([[5.0, 1.0], [1.0, 4.0]]), np.diag([2.0, 1.0]), np.diag([0.4, 0.1])


def test_without_delay_the_spring_pulls_both_ends_alike():
    x_m, p, v_m, v = np.random.default_rng(0).normal(size=(4, 2))
    F_h = np.array([0.3, -0.2])
    rate = master_rate(np.concatenate([x_m, v_m]), F_h, p, M, K, B)
    force = slave_force(x_m, p, v, K, B)
    np.testing.assert_array_equal(rate[:2], v_m)
    # What is left of the momentum of the two is the operator's force and the dampers'.
    total = M @ rate[2:] + force
    np.testing.assert_allclose(total, F_h - B @ v_m - B @ v, rtol=1e-12)
    assert coupling_force(x_m, p, K) == pytest.approx(K @ (x_m - p))

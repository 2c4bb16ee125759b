"""Tests of the friction of gears and joints, and of sampled sensors."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.model.laws.actuators import (
    delivered_force,
    friction_torque,
    next_normal,
    next_random,
    next_sample,
    quantized,
)


def test_friction_far_from_its_speed_and_near_zero():
    v = np.array([-50.0, -1e-9, 0.0, 1e-9, 50.0])
    expected = [-0.3 - 10, -3e-8 - 2e-10, 0, 3e-8 + 2e-10, 0.3 + 10]
    force = delivered_force(np.array([0.3, 0.01, 0.2]), np.ones(5), v)
    assert_allclose(1 - force, expected, rtol=1e-6)


@given(st.floats(-10, 10), st.floats(0, 5), st.floats(1e-4, 1), st.floats(0, 5))
def test_friction_dissipates(v, coulomb, speed, viscous):
    law = np.array([coulomb, speed, viscous])
    (force,) = -delivered_force(law, np.zeros(1), np.array([v]))
    assert force * v >= 0
    assert abs(force) <= (coulomb + viscous * abs(v)) * (1 + 1e-12)
    tau = friction_torque(np.array([coulomb]), np.array([viscous]), speed, np.array(v))
    assert (tau * v <= 0).all()


def test_friction_of_joints_is_the_published_one_and_creeps_at_rest():
    forward = np.array([2.0, 0.5])
    backward = np.array([1.0, 0.7])
    for sign, expected in ((1, -forward), (-1, backward)):
        v = sign * np.array([40.0, 50.0])
        tau = friction_torque(forward, backward, 0.01, v)
        assert_allclose(tau, expected, rtol=1e-6)
    slope = friction_torque(forward, backward, 0.05, np.full(2, 1e-7)) / 1e-7
    assert_allclose(slope, [-1.5 / 0.05, -0.6 / 0.05], rtol=1e-5)


def test_quantized():
    values = np.array([-0.26, -0.25, 0.0, 0.24, 0.25, 1.0])
    expected = [-0.5, 0.0, 0.0, 0.0, 0.5, 1.0]
    assert_allclose(quantized(0.5, values), expected)
    assert_array_equal(quantized(0.0, values), values)


def test_generators_are_exact():
    x_1 = 2147483562
    x_2 = 2147483398
    generator = np.array([x_1, x_2], dtype=float)
    for _ in range(1000):
        number, generator = next_random(generator)
        x_1 = 40014 * x_1 % 2147483563
        x_2 = 40692 * x_2 % 2147483399
        assert generator.tolist() == [x_1, x_2]
        assert number[0] == ((x_1 - x_2 - 1) % 2147483562 + 1) / 2147483563


def test_noise_is_normal_and_white():
    generator = np.random.default_rng(1).integers(1, 2**31 - 300, 40) * 1.0
    rows = []
    for _ in range(1000):
        normal, generator = next_normal(generator)
        rows.append(normal)
    x = np.array(rows)
    moments = [np.mean(x), np.mean(x**2), np.mean(x**3), np.mean(x**4)]
    assert_allclose(moments, [0, 1, 0, 3], atol=0.15)
    assert abs(np.mean(x[1:] * x[:-1])) < 0.03
    assert abs(np.mean(x[:, 1:] * x[:, :-1])) < 0.03


def test_a_sample_has_the_rate_of_the_encoder():
    mode = np.array([0.0, 7.0, 0.0, 5.0, 6.0])
    mode = next_sample(mode, np.array([0.26]), 0.5, 0.0, 0.01)
    assert mode[:3].tolist() == [1, 0.5, 0]
    mode = next_sample(mode, np.array([1.1]), 0.5, 0.0, 0.01)
    assert mode[:3].tolist() == [2, 1.0, 50]

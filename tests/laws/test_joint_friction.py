"""Coulomb friction of joints."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from teleop_drake.laws.joint_friction import friction_torque

torques = st.floats(0, 30)


def test_it_is_the_published_friction_of_a_joint_that_moves():
    forward, backward = np.array([2.0, 0.5]), np.array([1.0, 0.7])
    for sign, expected in ((1, -forward), (-1, backward)):
        v = sign * np.array([40.0, 50.0])
        tau = friction_torque(forward, backward, 0.01, v)
        np.testing.assert_allclose(tau, expected, rtol=1e-6)


def test_a_joint_at_rest_creeps():
    h = 1e-7
    slope = friction_torque(np.array([2.0]), np.array([1.0]), 0.05, np.array([h])) / h
    np.testing.assert_allclose(slope, -1.5 / 0.05, rtol=1e-5)


@given(torques, torques, st.floats(1e-3, 1), st.floats(-10, 10))
def test_it_never_gives_energy(forward, backward, speed, v):
    tau = friction_torque(np.array([forward]), np.array([backward]), speed, np.array(v))
    assert (tau * v <= 0).all()

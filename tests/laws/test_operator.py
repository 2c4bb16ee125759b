"""The operators' laws: a human by transfer functions, stated intentions (2.5)."""

import numpy as np

from teleop_drake.laws.operator import (
    HumanOperator,
    intended_velocity,
    rate_to_position,
    rate_to_velocity,
)

HUMAN = HumanOperator(
    start=np.array([0.1, 0.2]),
    velocity=np.array([0.03, -0.01]),
    crossover=1.5,
    lag=0.1,
    mass=0.8,
    damping=9.0,
    stiffness=150.0,
)
NOTHING = np.zeros(2)


def Matrices(rate, num_states, num_inputs):
    """Returns A and B of a linear rate(x, u)."""
    offset = rate(np.zeros(num_states), np.zeros(num_inputs))
    A = [rate(x, np.zeros(num_inputs)) - offset for x in np.eye(num_states)]
    B = [rate(np.zeros(num_states), u) - offset for u in np.eye(num_inputs)]
    return np.array(A).T, np.array(B).T


def Response(rate, num_states, w):
    """Returns v_d/[felt position, felt velocity, F_h] on the first axis at j w."""
    A, B = Matrices(rate, num_states, 6)
    C = np.array([intended_velocity(x, HUMAN) for x in np.eye(num_states)]).T
    H = C @ np.linalg.solve(1j * w * np.eye(num_states) - A, B)
    assert np.abs(H[0, 1::2]).max() == 0  # The axes do not couple.
    return H[0, ::2]


def test_transfer_functions():
    for w in (0.1, 1.0, 7.0):
        s = 1j * w
        arm = -s / (0.8 * s**2 + 9 * s + 150)
        position = Response(
            lambda x, u: rate_to_position(x, 0.0, u[:4], u[4:], HUMAN), 6, w
        )
        np.testing.assert_allclose(position, [-1.5 / (0.1 * s + 1), 0, arm], rtol=1e-12)
        velocity = Response(lambda x, u: rate_to_velocity(x, u[:4], u[4:], HUMAN), 8, w)
        expected = [0, -1.5 / s / (0.1 * s + 1), arm]
        np.testing.assert_allclose(velocity, expected, rtol=1e-12)


def test_on_the_goal_nothing_changes():
    """Felt where the goal is, the human does nothing; at its velocity, no more."""
    time = 2.0
    felt = np.concatenate([HUMAN.start + time * HUMAN.velocity, HUMAN.velocity])
    rest = np.zeros(6)
    assert not rate_to_position(rest, time, felt, NOTHING, HUMAN).any()
    error = np.array([0.2, -0.3])
    state = np.concatenate([HUMAN.crossover * error, np.zeros(4), error])
    np.testing.assert_allclose(
        rate_to_velocity(state, felt, NOTHING, HUMAN), 0, atol=1e-16
    )

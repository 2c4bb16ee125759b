"""The law of a human at the goal; operators/test_human.py has transfer functions."""

import numpy as np
from numpy.testing import assert_allclose

from teleop_drake.model.laws.operator import (
    HumanOperator,
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


def test_on_the_goal_nothing_changes():
    """With the tool felt at the goal, or with the goal's velocity, all rates are 0."""
    time = 2.0
    felt = np.concatenate([HUMAN.start + time * HUMAN.velocity, HUMAN.velocity])
    rest = np.zeros(6)
    assert not rate_to_position(rest, time, felt, NOTHING, HUMAN).any()
    error = np.array([0.2, -0.3])
    state = np.concatenate([HUMAN.crossover * error, np.zeros(4), error])
    assert_allclose(rate_to_velocity(state, felt, NOTHING, HUMAN), 0, atol=1e-16)

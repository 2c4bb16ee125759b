"""Tests of contact with a wall, against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from teleop_drake.laws.contact import hunt_crossley_force, wall_force


def bounce(k, p, alpha, mass, speed):
    """Returns the speed at which a mass leaves a wall that it meets."""

    def rate(t, state):
        force = hunt_crossley_force(k, p, alpha, *state)
        return [state[1], -force / mass]

    def leaves(t, state):
        return state[0]

    leaves.terminal, leaves.direction = True, -1.0
    run = solve_ivp(
        rate, (0, 10), [0, speed], events=leaves, rtol=1e-11, atol=1e-13, max_step=0.01
    )
    assert run.status == 1
    return -run.y[1, -1]


@pytest.mark.parametrize(
    ("k", "p", "alpha", "mass"), [(200.0, 1.0, 1.5, 0.3), (3e4, 1.5, 0.8, 2.0)]
)
def test_restitution(k, p, alpha, mass):
    b = 1.5 * alpha

    def g(v):
        return b * v - np.log1p(b * v)

    speed = 0.4
    expected = brentq(lambda v: g(speed) - g(-v), 0, speed, xtol=1e-14)
    assert bounce(k, p, alpha, mass, speed) == pytest.approx(expected, rel=1e-7)
    slow = 0.01
    restitution = bounce(k, p, alpha, mass, slow) / slow
    assert restitution == pytest.approx(1 - alpha * slow, abs=(alpha * slow) ** 2)


def test_indentation_at_rest():
    k, p, force = 400.0, 1.5, 0.7
    depth = (force / k) ** (1 / p)
    assert hunt_crossley_force(k, p, 3.0, depth, 0.0) == pytest.approx(force, rel=1e-14)
    assert hunt_crossley_force(k, p, 3.0, -depth, 9.0) == 0.0
    # It does not stick to a body that leaves fast.
    assert hunt_crossley_force(k, p, 3.0, depth, -9.0) == 0.0


numbers = st.floats(-2, 2)


@pytest.mark.parametrize("n", [1, 2, 3])
@given(data=st.data())
def test_friction(n, data):
    vectors = st.lists(numbers, min_size=n, max_size=n).map(np.array)
    point, p_WT, v_WT = (data.draw(vectors) for _ in range(3))
    normal = data.draw(vectors.filter(lambda x: np.linalg.norm(x) > 0.1))
    normal = normal / np.linalg.norm(normal)
    mu, v_s = data.draw(st.floats(0, 2)), data.draw(st.floats(1e-4, 0.1))
    law = np.array([300.0, 1.2, 0.5])
    F_e = wall_force(law, np.array([mu, v_s]), np.array([point, normal]), p_WT, v_WT)
    depth, speed = normal @ (p_WT - point), normal @ v_WT
    F_n = hunt_crossley_force(*law, depth, speed)
    assert normal @ F_e == pytest.approx(F_n, rel=1e-9, abs=1e-9)
    F_t, v_t = F_e - F_n * normal, v_WT - speed * normal
    # Against the motion, never more than Coulomb's, and all of it in fast sliding.
    assert F_t @ v_t >= -1e-9
    assert np.linalg.norm(F_t) <= mu * F_n * (1 + 1e-9) + 1e-9
    if np.linalg.norm(v_t) > 0.5:
        assert np.linalg.norm(F_t) == pytest.approx(mu * F_n, rel=0.03, abs=1e-9)

"""Tests of contact with walls and tissue, against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from teleop_drake.model.laws.contact import (
    creep_rate,
    hunt_crossley_force,
    solid_force,
    wall_force,
)


def bounce(k, p, alpha, mass, speed):
    """Returns the speed with which a mass rebounds from a wall."""

    def rate(t, state):
        force = hunt_crossley_force(k, p, alpha, *state)
        return [state[1], -force / mass]

    def leaves(t, state):
        return state[0]

    leaves.terminal = True
    leaves.direction = -1.0
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
    k = 400.0
    p = 1.5
    force = 0.7
    depth = (force / k) ** (1 / p)
    assert hunt_crossley_force(k, p, 3.0, depth, 0.0) == pytest.approx(force, rel=1e-14)
    assert hunt_crossley_force(k, p, 3.0, -depth, 9.0) == 0.0
    # The wall does not pull at a body that leaves fast.
    assert hunt_crossley_force(k, p, 3.0, depth, -9.0) == 0.0


numbers = st.floats(-2, 2)


@pytest.mark.parametrize("n", [1, 2, 3])
@given(data=st.data())
def test_friction(n, data):
    vectors = st.lists(numbers, min_size=n, max_size=n).map(np.array)
    point, p_WT, v_WT = (data.draw(vectors) for _ in range(3))
    normal = data.draw(vectors.filter(lambda x: np.linalg.norm(x) > 0.1))
    normal = normal / np.linalg.norm(normal)
    mu = data.draw(st.floats(0, 2))
    v_s = data.draw(st.floats(1e-4, 0.1))
    law = np.array([300.0, 1.2, 0.5])
    F_e = wall_force(law, np.array([mu, v_s]), np.array([point, normal]), p_WT, v_WT)
    depth = normal @ (p_WT - point)
    speed = normal @ v_WT
    F_n = hunt_crossley_force(*law, depth, speed)
    assert normal @ F_e == pytest.approx(F_n, rel=1e-9, abs=1e-9)
    F_t = F_e - F_n * normal
    v_t = v_WT - speed * normal
    # Friction acts against the motion. It is at most Coulomb's, which it reaches in
    # fast sliding.
    assert F_t @ v_t >= -1e-9
    assert np.linalg.norm(F_t) <= mu * F_n * (1 + 1e-9) + 1e-9
    if np.linalg.norm(v_t) > 0.5:
        assert np.linalg.norm(F_t) == pytest.approx(mu * F_n, rel=0.03, abs=1e-9)


# Viscoelastic tissue.

SOLID = np.array([20.0, 80.0, 0.5])
NORMAL = np.array([0.6, 0.0, -0.8])
PLANE = np.array([0.1 * NORMAL, NORMAL])


def at(depth):
    return (0.1 + depth) * NORMAL + np.array([0.8, 3.0, 0.6])


def run(depth, time, creep=0.0):
    """Returns z at the given times, for a tool at depth(t)."""

    def rate(t, z):
        return creep_rate(SOLID, z, PLANE, at(depth(t)))

    span = time[0], time[-1]
    return solve_ivp(
        rate, span, [creep], t_eval=time, rtol=1e-9, atol=1e-13, max_step=0.02
    ).y.T


def force(creep, depth):
    F_e = solid_force(SOLID, creep, PLANE, at(depth))
    F_n = F_e @ NORMAL
    assert_allclose(F_e, F_n * NORMAL, atol=1e-14)
    return F_n


def test_a_step_relaxes():
    k, k_1, tau = SOLID
    depth = 0.02
    time = np.linspace(0, 2, 9)
    forces = [force(z, depth) for z in run(lambda t: depth, time)]
    expected = (k + k_1 * np.exp(-time / tau)) * depth
    assert_allclose(forces, expected, rtol=1e-8)


def test_the_surface_recovers_without_the_tool():
    """Without the tool, z decays with the creep time constant tau (k + k_1)/k."""
    k, k_1, tau = SOLID
    time = np.linspace(0, 5, 6)
    creep = 0.01
    z = run(lambda t: -0.5, time, creep)[:, 0]
    slow = tau * (k + k_1) / k
    assert_allclose(z, creep * np.exp(-time / slow), rtol=1e-8)
    surface = k_1 * creep / (k + k_1)
    assert force(np.array([creep]), surface) == pytest.approx(0, abs=1e-15)
    assert force(np.array([creep]), surface + 1e-4) == pytest.approx(1e-4 * (k + k_1))


def test_it_is_passive():
    """The tool's work is stored or dissipated, for any motion."""
    k, k_1, tau = SOLID
    time = np.linspace(0, 1, 1001)

    def depth(t):
        return 0.01 * np.sin(7 * t) + 0.008 * np.sin(23 * t + 1)

    z = run(depth, time)
    forces = np.array([force(*x) for x in zip(z, depth(time), strict=True)])
    assert forces.min() == pytest.approx(0, abs=1e-14)
    middle = (forces[1:] + forces[:-1]) / 2
    work = np.concatenate(([0], np.cumsum(middle * np.diff(depth(time)))))
    d = np.maximum(depth(time), k_1 * z[:, 0] / (k + k_1))
    stored = k * d**2 / 2 + k_1 * (d - z[:, 0]) ** 2 / 2
    lost = work - (stored - stored[0])
    assert np.diff(lost).min() > -1e-3 * lost[-1]
    rate = k_1 * (d - z[:, 0]) ** 2 / tau
    expected = np.sum((rate[1:] + rate[:-1]) / 2 * np.diff(time))
    assert lost[-1] == pytest.approx(expected, rel=2e-3)

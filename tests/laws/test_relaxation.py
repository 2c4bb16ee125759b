"""Tests of the standard linear solid, against closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from teleop_drake.laws.relaxation import creep_rate, solid_force

SOLID = np.array([20.0, 80.0, 0.5])
NORMAL = np.array([0.6, 0.0, -0.8])
PLANE = np.array([0.1 * NORMAL, NORMAL])


def at(depth):
    return (0.1 + depth) * NORMAL + np.array([0.8, 3.0, 0.6])


def run(depth, time, creep=0.0):
    """Returns z at some times, of a tool at depth(t)."""

    def rate(t, z):
        return creep_rate(SOLID, z, PLANE, at(depth(t)))

    span = time[0], time[-1]
    return solve_ivp(
        rate, span, [creep], t_eval=time, rtol=1e-10, atol=1e-14, max_step=0.01
    ).y.T


def force(creep, depth):
    F_e = solid_force(SOLID, creep, PLANE, at(depth))
    F_n = F_e @ NORMAL
    np.testing.assert_allclose(F_e, F_n * NORMAL, atol=1e-14)
    return F_n


def test_a_step_relaxes():
    k, k_1, tau = SOLID
    depth, time = 0.02, np.linspace(0, 2, 9)
    forces = [force(z, depth) for z in run(lambda t: depth, time)]
    expected = (k + k_1 * np.exp(-time / tau)) * depth
    np.testing.assert_allclose(forces, expected, rtol=1e-8)


def test_the_surface_recovers_without_the_tool():
    """Left at z, it comes back with the time constant tau (k + k_1)/k of creep."""
    k, k_1, tau = SOLID
    time, creep = np.linspace(0, 5, 6), 0.01
    z = run(lambda t: -0.5, time, creep)[:, 0]
    slow = tau * (k + k_1) / k
    np.testing.assert_allclose(z, creep * np.exp(-time / slow), rtol=1e-8)
    surface = k_1 * creep / (k + k_1)
    assert force(np.array([creep]), surface) == pytest.approx(0, abs=1e-15)
    assert force(np.array([creep]), surface + 1e-4) == pytest.approx(1e-4 * (k + k_1))


def test_it_is_passive():
    """What the tool does in work is stored or lost, whichever way it moves."""
    k, k_1, tau = SOLID
    time = np.linspace(0, 3, 6001)

    def depth(t):
        return 0.01 * np.sin(7 * t) + 0.008 * np.sin(23 * t + 1)

    z = run(depth, time)
    forces = np.array([force(*x) for x in zip(z, depth(time), strict=True)])
    assert forces.min() == pytest.approx(0, abs=1e-14)
    work = np.concatenate(
        ([0], np.cumsum((forces[1:] + forces[:-1]) / 2 * np.diff(depth(time))))
    )
    d = np.maximum(depth(time), k_1 * z[:, 0] / (k + k_1))
    stored = k * d**2 / 2 + k_1 * (d - z[:, 0]) ** 2 / 2
    lost = work - (stored - stored[0])
    assert np.diff(lost).min() > -1e-3 * lost[-1]
    rate = k_1 * (d - z[:, 0]) ** 2 / tau
    expected = np.sum((rate[1:] + rate[:-1]) / 2 * np.diff(time))
    assert lost[-1] == pytest.approx(expected, rel=1e-3)

"""The law of chapter 3 against closed forms and its own Lyapunov function."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from teleop_drake.model.laws.tracking import (
    TrackingGains,
    coupled_disturbance,
    tracking_error,
    tracking_force,
    weights_rate,
)

GAINS = TrackingGains(
    Lambda=np.array([[35.0, 3.0], [-2.0, 20.0]]),
    G1=np.array([[1.0, 0.4], [-0.3, 2.0]]),
    beta=5.0,
    nu=0.0,
)


def lyapunov_rate(seed, gains=GAINS, sign=1.0):
    """Returns (dV1/dt, -s^T G1 s) of a random robot; `sign` multiplies dW/dt."""
    rng = np.random.default_rng(seed)
    n = 2
    N = 7
    root = rng.normal(size=(n, n))
    M_r = root @ root.T + 0.5 * np.eye(n)
    h_r = rng.normal(size=n)
    Phi = rng.uniform(size=N)
    W, W_star = rng.normal(size=(2, n, N))
    r, v, r_d, v_d, a_d = rng.normal(size=(5, n))

    s = tracking_error(gains, r=r, v=v, r_d=r_d, v_d=v_d)
    known = np.concatenate((M_r.ravel(), h_r)), W.ravel(), Phi, s
    F_c = tracking_force(gains, *known, v, v_d, a_d)
    W_rate = sign * weights_rate(gains, *known).reshape(n, N)
    a = np.linalg.solve(M_r, F_c - W_star @ Phi - h_r)  # (3.6)
    s_rate = a - a_d + gains.Lambda @ (v - v_d)
    rate = s @ s_rate - np.sum((W_star - W) * W_rate) / gains.beta
    return rate, -s @ gains.G1 @ s


@pytest.mark.parametrize("seed", range(4))
def test_lyapunov_function_falls_as_in_3_20(seed):
    rate, expected = lyapunov_rate(seed)
    assert rate == pytest.approx(expected, rel=1e-9)


def test_with_the_printed_sign_it_does_not():
    differences = [np.subtract(*lyapunov_rate(seed, sign=-1.0)) for seed in range(20)]
    assert min(np.abs(differences)) > 1


def test_leakage_pulls_the_weights_to_zero():
    rng = np.random.default_rng(0)
    W = rng.normal(size=14)
    known = np.array([1, 0, 0, 1, 9, 9.0]), W, rng.uniform(size=7), rng.normal(size=2)
    pull = weights_rate(replace(GAINS, nu=0.25), *known) - weights_rate(GAINS, *known)
    assert_allclose(pull, -5.0 * 0.25 * W)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"Lambda": -np.eye(2)}, r"Lambda = .*must be a positive definite 2 x 2"),
        ({"Lambda": np.array(1.0)}, "Lambda = 1.0: must be a positive definite 1 x 1"),
        ({"G1": np.eye(3)}, "G1 = .*must be a positive definite 2 x 2 matrix"),
        ({"G1": np.diag([1.0, np.inf])}, "G1 = .*must be"),
        ({"beta": -1.0}, "beta = -1.0: must be a finite number >= 0"),
        ({"nu": np.nan}, "nu = nan: must be"),
    ],
)
def test_bad_gains(change, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        replace(GAINS, **change)


def test_gains_are_copies():
    Lambda = np.eye(2)
    gains = replace(GAINS, Lambda=Lambda)
    Lambda[0, 0] = 7
    assert gains.Lambda[0, 0] == 1
    assert not gains.Lambda.flags.writeable
    assert gains.num_axes == 2


def test_the_coupled_disturbance_is_that_of_equation_3_8():
    """F_e = K [x + x' z + 2 z' x + z^2, z + z' x + 2 z x' + x^2], by hand."""
    K = np.array([[2.0, 0.0], [1.0, 3.0]])
    x = 3.0
    z = 5.0
    x_dot = 7.0
    z_dot = 11.0
    first = 3.0 + 35.0 + 66.0 + 25.0
    second = 5.0 + 33.0 + 70.0 + 9.0
    F_e = coupled_disturbance(K, np.array([x, z]), np.array([x_dot, z_dot]))
    assert_allclose(F_e, [2 * first, first + 3 * second], rtol=1e-15)

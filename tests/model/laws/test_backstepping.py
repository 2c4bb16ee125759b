"""The backstepping law against its Lyapunov identity, on the plant of its proof."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from block_checks import Gains, backstepping_rate
from grids import Slow
from hypothesis import example, given, settings
from hypothesis import strategies as st
from independent_solver import Adaptive, AdaptiveLaw
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.model.laws.backstepping import (
    BacksteppingGains,
    BacksteppingState,
    adaptive_rate,
    auxiliary_error,
    damped_force_error,
    known,
    pack_state,
    project,
)
from teleop_drake.model.laws.gaussian_network import GaussianNetwork

seeds = st.integers(0, 2**32 - 1)
NO_LEAKAGE = {"nu1": 0.0, "nu3": 0.0, "Upsilon": 0.0}


def _definite(rng: np.random.Generator, n: int) -> np.ndarray:
    """Returns a symmetric, positive definite matrix without zeros."""
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.5 * np.eye(n)


def _skew(rng: np.random.Generator, n: int) -> np.ndarray:
    root = rng.normal(size=(n, n))
    return root - root.T


def _rotation(rng: np.random.Generator, n: int) -> np.ndarray:
    Q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    Q[:, 0] *= np.linalg.det(Q)
    return Q


def _far_from_singular(rng: np.random.Generator, n: int) -> np.ndarray:
    """Returns an unsymmetric matrix with det > 0 and singular values in [1, 3]."""
    return _rotation(rng, n) * rng.uniform(1.0, 3.0, n) @ _rotation(rng, n)


def _random_gains(
    rng: np.random.Generator, n: int, **overrides: Any
) -> BacksteppingGains:
    P = _definite(rng, n)
    values = {
        "Lambda": _definite(rng, n) + _skew(rng, n),
        "G1": np.linalg.solve(P, _definite(rng, n) + _skew(rng, n)),
        "G2": _definite(rng, n),
        "P": P,
        "beta1": rng.uniform(0.1, 2.0),
        "beta2": rng.uniform(0.1, 2.0),
        "beta3": rng.uniform(0.1, 2.0),
        "nu1": rng.uniform(0.1, 1.0),
        "nu3": rng.uniform(0.1, 1.0),
        "Upsilon": rng.uniform(0.1, 1.0),
        "Psi0": _far_from_singular(rng, n),
        "Psi_min": 0.05,
    }
    return BacksteppingGains(**(values | overrides))


@dataclass
class _Truth:
    """The true values W1*, Psi* and W3* of the estimates."""

    W1: np.ndarray
    Psi: np.ndarray
    W3: np.ndarray


def _random_truth(rng: np.random.Generator, n: int, N: int) -> _Truth:
    return _Truth(
        rng.normal(size=(n, N)), _far_from_singular(rng, n), rng.normal(size=(n, N))
    )


def _random_state(rng: np.random.Generator, n: int, N: int) -> BacksteppingState:
    return BacksteppingState(
        rng.normal(size=n),
        rng.normal(size=(n, N)),
        _far_from_singular(rng, n),
        rng.normal(size=(n, N)),
    )


def _z(gains, state, Phi, s, F_e):
    """Returns the control force error of (5.17), (5.22); numbers may be complex."""
    return state.F_c - F_e + np.linalg.inv(state.Psi) @ (state.W1 @ Phi + gains.G1 @ s)


def _V2(gains, truth, state, Phi, s, F_e):
    """Returns the Lyapunov function (5.26); numbers may be complex."""
    z = _z(gains, state, Phi, s, F_e)
    return (
        s @ gains.P @ s / 2
        + z @ z / 2
        + np.sum((truth.W1 - state.W1) ** 2) / (2 * gains.beta1)
        + np.sum((truth.Psi - state.Psi) ** 2) / (2 * gains.beta2)
        + np.sum((truth.W3 - state.W3) ** 2) / (2 * gains.beta3)
    )


def _dV2(seed: int, n: int, unknown: float = 0.0, sign: float = 1.0, **overrides: Any):
    """Returns dV2/dt at a random point, the terms of the proof, and the error of z.

    The derivative is a complex step. The plant is ds/dt = Psi* (F_c - F_e) + W1* Phi,
    dF_e/dt = W3* Phi. Leakage and supervision are on unless overridden. `unknown` is
    the size of an error of the law's dPhi/dt. With the sign -1 the third network learns
    as in the thesis, (4.43), (4.52), (5.42), (5.51).
    """
    rng = np.random.default_rng(seed)
    N = 4
    gains = _random_gains(rng, n, **overrides)
    truth = _random_truth(rng, n, N)
    state = _random_state(rng, n, N)
    Phi = rng.uniform(0, 1, N)
    Phi_dot = rng.normal(size=N)
    s, F_e, v_dd, F_hd = rng.normal(size=(4, n))
    v = s + v_dd - gains.Lambda @ (F_e - F_hd)

    error = unknown * rng.normal(size=N)
    known = Phi_dot + error
    rate = backstepping_rate(
        gains, state, Phi=Phi, Phi_dot=known, v=v, v_dd=v_dd, F_e=F_e, F_hd=F_hd
    )
    rate = rate._replace(W3=sign * rate.W3)
    s_dot = truth.Psi @ (state.F_c - F_e) + truth.W1 @ Phi
    F_e_dot = truth.W3 @ Phi
    h = 1e-30j
    moved = BacksteppingState(*(x + h * y for x, y in zip(state, rate, strict=True)))
    at = Phi + h * Phi_dot, s + h * s_dot, F_e + h * F_e_dot
    z = _z(gains, state, Phi, s, F_e)
    terms = [
        -s @ gains.P @ gains.G1 @ s,
        -z @ gains.G2 @ z,
        gains.nu1 * np.sum((truth.W1 - state.W1) * state.W1),
        gains.nu3 * np.sum((truth.W3 - state.W3) * state.W3),
        -gains.Upsilon * np.sum((truth.Psi - state.Psi) * (gains.Psi0 - state.Psi)),
        -z @ np.linalg.solve(state.Psi, state.W1 @ error),
    ]
    law_z = damped_force_error(state, Phi=Phi, F_e=F_e, damping=gains.G1 @ s)
    z_error = np.linalg.norm(law_z - z) / np.linalg.norm(z)
    return _V2(gains, truth, moved, *at).imag / h.imag, terms, z_error


@pytest.mark.parametrize(
    "options",
    [{}, NO_LEAKAGE, {"unknown": 1.0}],
    ids=["plain", "no leakage", "unknown"],
)
@pytest.mark.parametrize("n", [1, 2, 3])
@given(seed=seeds)
def test_lyapunov_identity_at_random_points(n, options, seed):
    V2_dot, terms, z_error = _dV2(seed, n, **options)
    assert abs(V2_dot - sum(terms)) < 1e-9 * np.sum(np.abs(terms))
    assert z_error < 1e-9


def test_printed_sign_makes_V2_grow():
    """V2 decreases at every point without leakage; with that sign it grows at some."""
    for sign, grows in ((1.0, False), (-1.0, True)):
        rates = [_dV2(seed, 1, sign=sign, **NO_LEAKAGE)[0] for seed in range(20)]
        assert (max(rates) > 0) == grows


@pytest.mark.parametrize("n", [1, 2, 3])
@given(seed=seeds)
def test_networks_of_position_and_velocity(n, seed):
    """Phi is evaluated at [r; v], and its rate with dv/dt = Psi (F_c - F_e)."""
    rng = np.random.default_rng(seed)
    network = GaussianNetwork(
        lower=[-1] * 2 * n, upper=[1] * 2 * n, count=[2] * 2 * n, width=1.0
    )
    state = _random_state(rng, n, network.num_functions)
    r, v, v_dd, F_e, F_hd = rng.normal(size=(5, n))
    gains = _random_gains(rng, n)
    numbers = network.as_numbers()
    x = pack_state(state)
    _, Phi, Phi_dot, _, _ = known(gains, numbers, x, r, v, v_dd, F_e, F_hd)
    assert_array_equal(Phi, network.evaluate(np.concatenate((r, v))))
    a = state.Psi @ (state.F_c - F_e)
    h = 1e-30j
    offsets = (
        np.concatenate((r + h * v, v + h * a)) - network.centres
    ) / network.widths
    expected = np.exp(-(offsets**2).sum(axis=1)).imag / h.imag
    assert_allclose(Phi_dot, expected, rtol=1e-9, atol=1e-12)
    # The law is that of the identity above, with these basis functions.
    rate = backstepping_rate(gains, state, Phi, Phi_dot, v, v_dd, F_e, F_hd)
    x_dot = adaptive_rate(gains, numbers, x, r, v, v_dd, F_e, F_hd)
    assert_array_equal(x_dot, pack_state(rate))


@pytest.mark.parametrize("n", [1, 2])
@given(seed=seeds)
def test_the_law_is_that_of_the_independent_solver(n, seed):
    """On one axis Psi is in [1, 3] and its limit 2, so that (4.53) is often active."""
    rng = np.random.default_rng(seed)
    limits = {"Psi0": [[4.0]], "Psi_min": 2.0} if n == 1 else {}
    gains = _random_gains(rng, n, beta1=0.7, beta2=0.7, nu1=0.4, nu3=0.4, **limits)
    basis = {"lower": [-1] * n, "upper": [1] * n, "count": [3] * n, "width": 0.8}
    network = GaussianNetwork(**basis)
    law = AdaptiveLaw(
        Adaptive(
            Lambda=gains.Lambda,
            G1=gains.G1,
            G2=gains.G2,
            P=gains.P,
            adaptation_rate=0.7,
            third_rate=gains.beta3,
            leakage=0.4,
            supervision=gains.Upsilon,
            initial_psi=gains.Psi0,
            minimum_psi=gains.Psi_min,
            **basis,
        ),
        gains.Psi0,
    )
    x = pack_state(_random_state(rng, n, network.num_functions))
    r, v, v_dd, F_e, F_hd = rng.normal(size=(5, n))
    rate = adaptive_rate(gains, network.as_numbers(), x, r, v, v_dd, F_e, F_hd)
    expected = law.rates(x, r, v, F_e, F_hd, v_dd)
    assert_allclose(rate, expected, rtol=1e-9, atol=1e-9)


def _at_the_limit(rng, n, num_at_limit, limit):
    """Returns a matrix whose num_at_limit smallest singular values are the limit."""
    sigma = limit + rng.uniform(0.5, 2.0, n)
    sigma[:num_at_limit] = limit
    return _rotation(rng, n) * sigma @ _rotation(rng, n)


LIMIT = 0.4
# Slightly more than LIMIT, so that LIMIT + rounding counts as at the limit.
LIMIT_UP = LIMIT * (1 + 1e-12)


@given(
    seed=seeds,
    sizes=st.sampled_from([(n, k) for n in (1, 2, 3, 4) for k in range(1, n + 1)]),
)
def test_projection_at_the_limit(seed, sizes):
    n, num_at_limit = sizes
    rng = np.random.default_rng(seed)
    Psi = _at_the_limit(rng, n, num_at_limit, LIMIT)
    update = rng.normal(size=(n, n))
    projected = project(Psi, update, LIMIT_UP)

    def sigma_min(A):
        return np.linalg.svd(A, compute_uv=False)[-1]

    h = 1e-6
    free_rate = (sigma_min(Psi + h * update) - LIMIT) / h
    rate = (sigma_min(Psi + h * projected) - LIMIT) / h
    assert rate > -1e-4  # the second order in h
    if free_rate > 1e-3:  # the update does not shrink the singular value
        assert_allclose(projected, update, atol=1e-12)
    # The removed part is orthogonal to the rest, and a second projection changes
    # nothing.
    assert np.sum(projected * (update - projected)) == pytest.approx(0.0, abs=1e-12)
    assert_allclose(project(Psi, projected, LIMIT_UP), projected, atol=1e-12)


@pytest.mark.parametrize("n", [2, 3])
@given(seed=seeds)
def test_projection_takes_out_the_component_along_u_v(n, seed):
    rng = np.random.default_rng(seed)
    Psi = _at_the_limit(rng, n, 1, LIMIT)
    U, _, Vt = np.linalg.svd(Psi)
    u = U[:, -1]
    v = Vt[-1]
    update = rng.normal(size=(n, n))
    expected = update - min(u @ update @ v, 0.0) * np.outer(u, v)
    assert_allclose(project(Psi, update, LIMIT_UP), expected, atol=1e-12)


@given(seed=seeds)
def test_projection_of_a_multiple_value_does_not_depend_on_its_basis(seed):
    rng = np.random.default_rng(seed)
    Q = _rotation(rng, 3)
    update = rng.normal(size=(3, 3))
    # Every orthonormal basis consists of singular vectors of LIMIT * Q.
    symmetric = (Q.T @ update + update.T @ Q) / 2
    eigenvalues, vectors = np.linalg.eigh(symmetric)
    expected = update - Q @ (vectors * np.minimum(eigenvalues, 0)) @ vectors.T
    assert_allclose(project(LIMIT * Q, update, LIMIT_UP), expected, atol=1e-12)


@example(psi=LIMIT, a=-1.0)
@given(psi=st.floats(0.01, 2.0), a=st.floats(-10, 10, allow_subnormal=False).map(float))
def test_projection_of_a_scalar_is_4_53(psi, a):
    projected = project(np.array([[psi]]), np.array([[a]]), LIMIT)
    assert projected == pytest.approx(0.0 if psi <= LIMIT and a < 0.0 else a)


def test_projection_is_inactive_above_the_limit():
    update = -10.0 * np.eye(2)
    projected = project(1.01 * LIMIT * np.eye(2), update, LIMIT)
    assert_array_equal(projected, update)


@pytest.mark.parametrize("n", Slow([1, 2, 3], but=[1]))
@settings(max_examples=4)
@given(seed=seeds)
def test_smallest_singular_value_stays_above_the_limit(n, seed):
    rng = np.random.default_rng(seed)
    Psi = _at_the_limit(rng, n, rng.integers(0, n + 1), 1.05 * LIMIT)
    amplitudes = rng.uniform(-1, 1, (3, n, n)) / n
    frequencies = rng.uniform(1, 10, 3)
    # size bounds |update|
    step = 5e-3
    size = 3.0

    def rate(t, Psi):
        update = np.tensordot(np.cos(frequencies * t), amplitudes, axes=1)
        return project(Psi, update, LIMIT)

    smallest = math.inf
    for t in step * np.arange(400):
        k1 = rate(t, Psi)
        k2 = rate(t + step / 2, Psi + step / 2 * k1)
        k3 = rate(t + step / 2, Psi + step / 2 * k2)
        k4 = rate(t + step, Psi + step * k3)
        Psi = Psi + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        smallest = min(smallest, np.linalg.svd(Psi, compute_uv=False)[-1])
    assert smallest > LIMIT - step * size


@pytest.mark.parametrize("n", [1, 2])
@given(seed=seeds, margin=st.sampled_from([-0.1, 0.0, 1e-9, 0.02, 0.05, 0.3]))
def test_law_projects_and_supervises_psi(n, seed, margin):
    """The law's shortcut far from the limit does not change the result."""
    rng = np.random.default_rng(seed)
    gains = _random_gains(rng, n, Psi_min=LIMIT_UP)
    Psi = _at_the_limit(rng, n, 1, LIMIT * (1 + margin))
    state = _random_state(rng, n, 3)._replace(Psi=Psi)
    Phi = rng.uniform(0, 1, 3)
    v, v_dd, F_e, F_hd = rng.normal(size=(4, n))
    s = auxiliary_error(gains, v=v, v_dd=v_dd, F_e=F_e, F_hd=F_hd)
    z = _z(gains, state, Phi, s, F_e)
    g = gains.P @ s + gains.G1.T @ np.linalg.solve(Psi.T, z)
    update = np.outer(g, state.F_c - F_e) + gains.Upsilon * (gains.Psi0 - Psi)
    rate = backstepping_rate(
        gains, state, Phi=Phi, Phi_dot=0 * Phi, v=v, v_dd=v_dd, F_e=F_e, F_hd=F_hd
    )
    assert_allclose(
        rate.Psi, gains.beta2 * project(Psi, update, LIMIT_UP), rtol=1e-9, atol=1e-9
    )


VALID = replace(Gains(2), Psi0=np.diag([2.0, 7.0]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"Lambda": 1.0}, r"^Lambda = 1\.0: must be a finite 1 x 1 matrix"),
        ({"G1": np.eye(3)}, r"^G1 = .*finite 2 x 2 matrix, the size of Lambda"),
        ({"P": [[1.0, np.nan], [0.0, 1.0]]}, r"^P = .*must be a finite 2 x 2 matrix"),
        ({"beta1": np.inf}, "^beta1 = inf: must be a finite number"),
        ({"Lambda": np.diag([1, -1])}, r"^Lambda = .*must be positive definite"),
        ({"G2": np.array([[2, 1], [0, 2]])}, r"^G2 = .*symmetric positive definite"),
        ({"nu3": -0.1}, "^nu3 = -0.1: must be"),
        ({"Upsilon": 1.5}, "^Upsilon = 1.5: must be a finite number >= 0 and <= 1"),
        ({"Psi_min": 0.0}, "^Psi_min = 0.0: must be a finite number > 0"),
        ({"Psi_min": 2.0}, r"^Psi0 = .*greater than Psi_min, 2"),
        ({"Psi0": np.diag([2.0, -7.0])}, "^Psi0 = .*must be of positive determinant"),
        ({"Psi0": np.ones((2, 2))}, "^Psi0 = "),
    ],
)
def test_bad_gains(change, message):
    with pytest.raises(ValueError, match=message):
        replace(VALID, **change)


def test_definite_P_and_G1_do_not_make_their_product_definite():
    """An example with s^T P G1 s < 0 although P > 0 and G1 > 0: P G1 is checked."""
    P = np.diag([1.0, 100.0])
    G1 = np.array([[1.0, 0.9], [0.9, 1.0]])
    for matrix in (P, G1):
        assert np.linalg.eigvalsh(matrix)[0] > 0
    s = np.array([1.0, -0.3])
    assert s @ P @ s > 0
    assert np.linalg.eigvalsh(P @ G1 + G1 @ P)[0] < 0
    with pytest.raises(
        ValueError, match=r"^G1 = .*such that P G1 is positive definite"
    ):
        replace(VALID, P=P, G1=G1)
    # With P = 1 the same G1 is allowed.
    assert replace(VALID, G1=G1).num_axes == 2


def test_gains_are_copies_and_cannot_change():
    Psi0 = np.diag([2.0, 7.0])
    gains = replace(VALID, Psi0=Psi0)
    Psi0[0, 0] = 3.0
    assert gains.Psi0[0, 0] == 2.0
    with pytest.raises(ValueError, match="read-only"):
        gains.Psi0[0, 0] = 3.0

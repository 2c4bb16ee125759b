"""The robust law against its proof: the identity, the bound, and the jumps."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose

from teleop_drake.model.laws.backstepping import (
    BacksteppingGains,
    BacksteppingState,
    adaptive_rate,
    initial_state,
    pack_state,
    unpack_state,
)
from teleop_drake.model.laws.gaussian_network import GaussianNetwork, gaussian_functions
from teleop_drake.model.laws.robust_backstepping import (
    RobustBounds,
    robust_errors,
    robust_rate,
)

BOUNDS = RobustBounds(rho1=0.7, eps1=0.2, rho3=1.3, eps3=0.3)
NONE = RobustBounds(rho1=0.0, eps1=1.0, rho3=0.0, eps3=1.0)
SMOOTHING = ((np.sqrt(5) + 1) / 2) ** -2.5


def _definite(rng, n):
    root = rng.normal(size=(n, n)) / 2
    return root @ root.T + 0.5 * np.eye(n)


@dataclass
class Case:
    """A law, and a plant that the networks represent up to remainders d1 and d3."""

    n: int

    def __post_init__(self):
        n = self.n
        rng = self.rng = np.random.default_rng(n)
        self.network = GaussianNetwork(
            lower=[-1] * n, upper=[1] * n, count=[2] * n, width=1.0
        )
        N = self.N = self.network.num_functions
        P = _definite(rng, n)
        skew = rng.normal(size=(n, n))
        self.Psi_star = 2 * np.eye(n) + 0.2 * rng.normal(size=(n, n))
        self.W1_star, self.W3_star = 0.3 * rng.normal(size=(2, n, N))
        self.gains = BacksteppingGains(
            Lambda=_definite(rng, n),
            G1=np.linalg.solve(P, _definite(rng, n) + skew - skew.T),
            G2=_definite(rng, n),
            P=P,
            beta1=1.1,
            beta2=0.2,
            beta3=0.9,
            nu1=0.8,
            nu3=0.7,
            Upsilon=0.9,
            Psi0=1.5 * np.eye(n),
            Psi_min=1e-3,
        )

    def Arrays(self):
        return self.gains, self.network

    def Damping(self, s, bounds=BOUNDS):
        """h(s), for real and complex numbers."""
        u = self.gains.P @ s
        return self.gains.G1 @ s + bounds.rho1 * u / np.sqrt(u @ u + bounds.eps1**2)

    def z(self, state, Phi, s, F_e, bounds=BOUNDS):
        push = state.W1 @ Phi + self.Damping(s, bounds)
        return state.F_c - F_e + np.linalg.inv(state.Psi) @ push

    def V2(self, state, Phi, s, F_e, bounds=BOUNDS):
        """Lyapunov function, for real and complex numbers."""
        gains = self.gains
        z = self.z(state, Phi, s, F_e, bounds)
        return (
            s @ gains.P @ s / 2
            + z @ z / 2
            + np.sum((self.W1_star - state.W1) ** 2) / (2 * gains.beta1)
            + np.sum((self.Psi_star - state.Psi) ** 2) / (2 * gains.beta2)
            + np.sum((self.W3_star - state.W3) ** 2) / (2 * gains.beta3)
        )

    def kappa(self):
        gains = self.gains
        PG1 = gains.P @ gains.G1
        least = np.linalg.eigvalsh((PG1 + PG1.T) / 2)[0]
        return min(
            2 * least / np.linalg.eigvalsh(gains.P)[-1],
            2 * np.linalg.eigvalsh(gains.G2)[0],
            gains.beta1 * gains.nu1,
            gains.beta3 * gains.nu3,
            gains.beta2 * gains.Upsilon,
        )

    def D(self):
        gains = self.gains
        b = BOUNDS
        return (
            SMOOTHING * (2 * b.rho1 * b.eps1 + b.rho3 * b.eps3)
            + gains.nu1 * np.sum(self.W1_star**2) / 2
            + gains.nu3 * np.sum(self.W3_star**2) / 2
            + gains.Upsilon * np.sum((self.Psi_star - gains.Psi0) ** 2) / 2
        )

    def Slope(self, s, bounds=BOUNDS):
        """H(s) by a complex step."""
        h = 1e-30
        return np.column_stack(
            [self.Damping(s + 1j * h * e, bounds).imag / h for e in np.eye(self.n)]
        )

    def Rates(self, law, t, r, s, F_e, x, bounds=BOUNDS):
        """Rates of the plant and the law, with the most unfavourable remainders."""
        v_dd = np.sin((1 + np.arange(self.n)) * t)
        F_hd = np.cos((2 + np.arange(self.n)) * t)
        v = s + v_dd - self.gains.Lambda @ (F_e - F_hd)
        state = unpack_state(x, self.n)
        Phi = self.network.evaluate(r)
        z = self.z(state, Phi, s, F_e, bounds)
        w = self.Slope(s, bounds).T @ np.linalg.inv(state.Psi).T @ z
        g = self.gains.P @ s + w
        d1 = BOUNDS.rho1 * g / np.sqrt(g @ g + 1e-4)
        d3 = -BOUNDS.rho3 * z / np.sqrt(z @ z + 1e-4)
        s_dot = self.Psi_star @ (state.F_c - F_e) + self.W1_star @ Phi + d1
        rate = law(*self.Arrays(), x, r, v, v_dd, F_e, F_hd)
        return v, s_dot, self.W3_star @ Phi + d3, rate, (g, w, z, d1, d3)

    def V2Rate(self, r, v, s, s_dot, F_e, F_e_dot, x, rate, bounds=BOUNDS):
        """dV2/dt by a complex step, without truncation error."""
        h = 1e-30
        state = unpack_state(x, self.n)
        x_dot = unpack_state(rate, self.n)
        Phi, Phi_dot = gaussian_functions(r, v, *self.network.as_numbers())
        moved = BacksteppingState(
            *(a + 1j * h * b for a, b in zip(state, x_dot, strict=True))
        )
        V2 = self.V2(
            moved,
            Phi + 1j * h * Phi_dot,
            s + 1j * h * s_dot,
            F_e + 1j * h * F_e_dot,
            bounds,
        )
        return V2.imag / h


def Robust(*arguments):
    return robust_rate(BOUNDS, *arguments)


@pytest.mark.parametrize("n", [1, 3])
def test_lyapunov_identity_at_random_points(n):
    case = Case(n)
    gains = case.gains
    rng = case.rng
    for _ in range(20):
        t = rng.uniform(0, 9)
        (r, s, F_e) = rng.normal(size=(3, n))
        x = pack_state(initial_state(gains, case.N))
        x = x + 0.3 * rng.normal(size=x.size)
        v, s_dot, F_e_dot, rate, (g, w, z, d1, d3) = case.Rates(Robust, t, r, s, F_e, x)
        V2_dot = case.V2Rate(r, v, s, s_dot, F_e, F_e_dot, x, rate)
        state = unpack_state(x, n)
        terms = [
            -s @ gains.P @ case.Damping(s),
            -z @ gains.G2 @ z,
            g @ d1,
            -z @ d3,
            -BOUNDS.rho1 * (w @ w) / np.sqrt(w @ w + BOUNDS.eps1**2),
            -BOUNDS.rho3 * (z @ z) / np.sqrt(z @ z + BOUNDS.eps3**2),
            gains.nu1 * np.sum((case.W1_star - state.W1) * state.W1),
            gains.nu3 * np.sum((case.W3_star - state.W3) * state.W3),
            -gains.Upsilon
            * np.sum((case.Psi_star - state.Psi) * (gains.Psi0 - state.Psi)),
        ]
        assert abs(V2_dot - sum(terms)) < 1e-9 * np.abs(terms).sum()
        assert (
            V2_dot
            < -case.kappa() * case.V2(state, case.network.evaluate(r), s, F_e)
            + case.D()
        )


@pytest.mark.parametrize("n", [1, 3])
def test_robust_terms_hold_what_the_law_of_chapter_5_does_not(n):
    """The estimates are exact and z = 0, so that V2 depends only on s."""
    case = Case(n)
    gains = case.gains
    b = BOUNDS
    x = np.concatenate(
        (np.zeros(n), case.W1_star.ravel(), case.Psi_star.ravel(), case.W3_star.ravel())
    )
    r = np.zeros(n)
    s = np.ones(n)
    F_e = np.zeros(n)
    limit = SMOOTHING * (2 * b.rho1 * b.eps1 + b.rho3 * b.eps3)
    for law, bounds, holds in ((Robust, BOUNDS, True), (adaptive_rate, NONE, False)):
        state = unpack_state(x, n)
        x[:n] -= case.z(state, case.network.evaluate(r), s, F_e, bounds)
        v, s_dot, F_e_dot, rate, _ = case.Rates(law, 0.0, r, s, F_e, x, bounds)
        V2_dot = case.V2Rate(r, v, s, s_dot, F_e, F_e_dot, x, rate, bounds)
        assert (V2_dot < -s @ gains.P @ gains.G1 @ s + limit) == holds


@pytest.mark.parametrize("n", [1, 3])
def test_without_bounds_it_is_the_law_of_backstepping(n):
    case = Case(n)
    r, v, v_dd, F_e, F_hd = case.rng.normal(size=(5, n))
    x = pack_state(initial_state(case.gains, case.N))
    x = x + 0.1 * case.rng.normal(size=x.size)
    taken = (*case.Arrays(), x, r, v, v_dd, F_e, F_hd)
    assert_allclose(
        robust_rate(NONE, *taken),
        adaptive_rate(*taken),
        rtol=1e-12,
        atol=1e-12,
    )


@pytest.mark.parametrize("n", [1, 3])
def test_a_puncture_raises_the_root_of_v2_by_no_more_than_stated(n, subtests):
    case = Case(n)
    gains = case.gains
    rng = case.rng
    b = BOUNDS
    root_of_P = np.linalg.cholesky(gains.P).T
    for size in (0.01, 1.0, 10.0):
        with subtests.test(size=size):
            J, F_e, v, v_dd, F_hd, r = rng.normal(size=(6, n))
            J = size * J
            x = pack_state(initial_state(gains, case.N))
            state = unpack_state(x, n)
            Phi = case.network.evaluate(r)
            roots = []
            errors = []
            for F in (F_e, F_e + J):
                error = robust_errors(b, *case.Arrays(), x, r, v, v_dd, F, F_hd)
                s = error[:n]
                assert_allclose(error[n:], case.z(state, Phi, s, F))
                roots.append(np.sqrt(2 * case.V2(state, Phi, s, F)))
                errors.append(error)
            assert_allclose((errors[1] - errors[0])[:n], gains.Lambda @ J)
            LJ = gains.Lambda @ J
            change = min(2 * b.rho1, b.rho1 * np.linalg.norm(gains.P @ LJ) / b.eps1)
            limit = (
                np.linalg.norm(root_of_P @ LJ)
                + np.linalg.norm(J)
                + np.linalg.norm(np.linalg.inv(state.Psi), 2)
                * (np.linalg.norm(gains.G1 @ LJ) + change)
            )
            assert abs(roots[1] - roots[0]) <= limit

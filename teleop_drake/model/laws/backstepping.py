"""Neural-adaptive backstepping with tuning functions (chapters 4 and 5).

The law has n task axes: chapter 4 is n = 1, chapter 5 is n = 2. Hats are left out: W1,
Psi and W3 are the estimates of the true values W1*, Psi* and W3*. The thesis numbers
the third network 6 in chapter 5.

    s  = (v - v_dd) + Lambda (F_e - F_hd)          auxiliary error       (4.2, 5.2)
    ds/dt   = Psi* (F_c - F_e) + W1* Phi           the plant, as modelled (4.8, 4.9)
    dF_e/dt = W3* Phi                              the environment      (4.25, 5.25)
    alpha   = F_e - Psi^-1 (W1 Phi + G1 s)         virtual control      (4.23, 5.22)
    z       = F_c - alpha                          control force error  (4.18, 5.17)

with the tool's velocity v and the commanded velocity v_dd = v_d(t - T_f) in m/s (n),
the robot's force F_e on the environment and the operator's force F_hd = F_h(t - T_f) in
N (n), and the basis functions Phi at the tool's position (N), whose rate Phi_dot is in
1/s.

Proof of the law below, with X~ = X* - X and |X|^2 = tr(X^T X), for

    V2 = s^T P s/2 + z^T z/2 + |W1~|^2/(2 beta1) + |Psi~|^2/(2 beta2)
         + |W3~|^2/(2 beta3),                                           (4.27, 5.26)

exact networks, no leakage (nu = 0), no supervision (Upsilon = 0) and the projection
inactive. s' and alpha' are the law's estimates of the rates of s and alpha (s_dot and
alpha_dot in the code); e = ds/dt - s' = Psi~ (F_c - F_e) + W1~ Phi.

1.  F_c - F_e = z - Psi^-1 (W1 Phi + G1 s), hence ds/dt = Psi z - G1 s + e, and with
    P = P^T:    d/dt s^T P s/2 = -s^T P G1 s + s^T P Psi z + s^T P e.
2.  alpha' differs from the true d(alpha)/dt in two terms only, dF_e/dt and ds/dt:
    alpha' - d(alpha)/dt = -W3~ Phi + Psi^-1 G1 e. Hence
    d/dt z^T z/2 = -z^T G2 z - z^T Psi^T P s - z^T W3~ Phi + z^T Psi^-1 G1 e.
3.  s^T P Psi z cancels z^T Psi^T P s. Both e terms together are g^T e with
    g = P s + G1^T Psi^-T z, and g^T e = <Psi~, g (F_c - F_e)^T> + <W1~, g Phi^T>.
4.  The weights add -<W1~, dW1/dt>/beta1 - <Psi~, dPsi/dt>/beta2
    - <W3~, dW3/dt>/beta3. With the update laws they cancel step 3 and -z^T W3~ Phi.

The result is  dV2/dt = -s^T P G1 s - z^T G2 z  exactly (4.44, 5.43). No step requires
Lambda, G1 or G2 to be diagonal or symmetric. V2 decreases if and only if the symmetric
parts of P G1 and G2 are positive definite. For P G1 this is NOT implied by P > 0 and
G1 > 0, the only conditions in the thesis.

The networks' input u is the tool's position p or [p; v]. For [p; v], Phi_dot contains
the tool's acceleration, for which the law uses the estimate Psi (F_c - F_e). It is
exact if Lambda D_e = 0, Psi = Psi* and W1* Phi = 0. Otherwise its error adds
-z^T Psi^-1 W1 (Phi_dot - dPhi/dt) to dV2/dt, with the law's Phi_dot.

Step 4 requires dW3/dt = -beta3 z Phi^T. The thesis loses this sign between (4.38) and
(4.39), (5.37) and (5.39), and prints the opposite sign in (4.43), (4.52), (5.42) and
(5.51).
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import CheckGain, CheckNumber, Refuse
from teleop_drake.loops.numerics.jacobi import singular_values
from teleop_drake.model.laws.gains import LawGains, min_eigenvalue
from teleop_drake.model.laws.gaussian_network import Lattice, gaussian_functions
from teleop_drake.model.laws.task_space import position_rate


@dataclass(frozen=True, kw_only=True, eq=False)
class BacksteppingGains(LawGains):
    """The constants of the law; n is the number of task axes.

    "Positive definite" means x^T A x > 0 for every x != 0; such a matrix need not be
    symmetric. Matrices are copied and made read-only.

    Attributes:
        Lambda: Weight of the force error relative to the velocity error in m/(N s)
            (n, n), positive definite (4.2, 5.2).
        G1: Damping of s in 1/s (n, n), such that P G1 is positive definite
            (4.23, 5.22).
        G2: Damping of z in 1/s (n, n), symmetric, positive definite (4.32, 5.31).
        P: Weight of s in V2 (n, n), symmetric, positive definite (5.10); for one
            axis the thesis has 1.
        beta1: Adaptation rate of W1, >= 0.
        beta2: Adaptation rate of Psi, >= 0.
        beta3: Adaptation rate of W3, >= 0.
        nu1: Leakage of W1, >= 0 (4.52, 5.51).
        nu3: Leakage of W3, >= 0 (4.52, 5.51).
        Upsilon: Supervision, which returns Psi to Psi0, in [0, 1] (4.52, 5.51).
        Psi0: A-priori estimate of Psi* = (I + Lambda D_e) M_r^-1 in 1/kg (n, n). Its
            determinant is positive, like that of Psi*, and all its singular values
            are greater than `Psi_min`.
        Psi_min: Limit of the projection in 1/kg, > 0 (4.53, 5.53).

    Raises:
        ValueError: If a gain is not finite, has another size than Lambda or violates a
            condition above.
    """

    G1: Array
    G2: Array
    P: Array
    beta1: float
    beta2: float
    beta3: float
    nu1: float
    nu3: float
    Upsilon: float
    Psi0: Array
    Psi_min: float

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("G2", "P"):
            CheckGain(name, getattr(self, name), self.num_axes)
        if min_eigenvalue(self.Lambda) <= 0.0:
            Refuse("Lambda", self.Lambda, "positive definite")
        if min_eigenvalue(self.P @ self.G1) <= 0.0:
            allowed = "such that P G1 is positive definite (s^T P G1 s > 0)"
            Refuse("G1", self.G1, allowed)
        for name in ("beta1", "beta2", "beta3", "nu1", "nu3"):
            CheckNumber(name, getattr(self, name), minimum=0)
        CheckNumber("Upsilon", self.Upsilon, minimum=0, maximum=1)
        CheckNumber("Psi_min", self.Psi_min, above=0)
        sigma = np.linalg.svd(self.Psi0, compute_uv=False)[-1]
        if sigma <= self.Psi_min or np.linalg.det(self.Psi0) <= 0.0:
            allowed = "of positive determinant, its singular values greater than "
            Refuse("Psi0", self.Psi0, f"{allowed}Psi_min, {self.Psi_min:g}")


class BacksteppingState(NamedTuple):
    """The state of the law, or its time rate; N basis functions per network.

    Attributes:
        F_c: Control force in N (n).
        W1: Weights of network 1, which estimates the unknown part of ds/dt, in m/s^2
            (n, N).
        Psi: Estimate of (I + Lambda D_e) M_r^-1 in 1/kg (n, n).
        W3: Weights of network 3, which estimates dF_e/dt, in N/s (n, N).
    """

    F_c: Array
    W1: Array
    Psi: Array
    W3: Array


def pack_state(state: BacksteppingState) -> Array:
    """Returns the state as one vector [F_c, W1, Psi, W3], matrices row by row."""
    return np.concatenate(
        (state.F_c, state.W1.ravel(), state.Psi.ravel(), state.W3.ravel())
    )


def unpack_state(x: Array, num_axes: int) -> BacksteppingState:
    """Returns the parts of a vector made by pack_state, as views."""
    n = num_axes
    nN = (x.size - n - n * n) // 2
    return BacksteppingState(
        x[:n],
        x[n : n + nN].reshape(n, -1),
        x[n + nN : n + nN + n * n].reshape(n, n),
        x[n + nN + n * n :].reshape(n, -1),
    )


def initial_state(gains: BacksteppingGains, num_functions: int) -> BacksteppingState:
    """Returns the initial state: no force, no weights, Psi = Psi0."""
    n = gains.num_axes
    return BacksteppingState(
        np.zeros(n),
        np.zeros((n, num_functions)),
        gains.Psi0,
        np.zeros((n, num_functions)),
    )


def auxiliary_error(
    gains: BacksteppingGains, v: Array, v_dd: Array, F_e: Array, F_hd: Array
) -> Array:
    """Returns the auxiliary error s of (4.2), (5.2) in m/s (n)."""
    return (v - v_dd) + gains.Lambda @ (F_e - F_hd)


def damped_force_error(
    state: BacksteppingState, Phi: Array, F_e: Array, damping: Array
) -> Array:
    """Returns z = F_c - alpha of (4.18), (5.17) in N (n), with alpha by (4.23), (5.22).

    Args:
        state: The law's state.
        Phi: Basis functions at the present input (N).
        F_e: Force the robot exerts on the environment in N (n).
        damping: The damping of s in m/s^2 (n), in these equations G1 s.
    """
    alpha = F_e - np.linalg.inv(state.Psi) @ (state.W1 @ Phi + damping)
    return state.F_c - alpha


def project(Psi: Array, update: Array, Psi_min: float) -> Array:
    """Returns proj[update] of (4.53, 5.53), which keeps Psi invertible.

    Generalises (4.53) from a scalar to a matrix: the singular values of Psi, as it
    moves along proj[update], do not fall below Psi_min.

    Let Psi = U diag(sigma) V^T, and let U_m, V_m be the columns with
    sigma <= Psi_min. To first order those singular values move as the eigenvalues of
    the symmetric part of R = U_m^T update V_m. If S is that symmetric part and S_- its
    part with negative eigenvalues,

        proj[update] = update - U_m S_- V_m^T.

    With one singular value at the limit, an update that would shrink it loses its
    component along u v^T, and every other update is unchanged. Several singular values
    at the limit, equal or not, are treated together: S - S_- has no negative
    eigenvalue, so none of them shrinks, whichever bases U_m, V_m the decomposition
    returns. For n = 1 and Psi > 0 this is (4.53) with <= in place of <.

    At or below the limit d(sigma_min)/dt >= 0; above it the update is unchanged. An
    integrator may overshoot the limit by its own error; then Psi moves along the limit
    or back. The update is discontinuous in Psi at the limit.

    For n = 1 the projection never increases V2 as long as Psi* >= Psi_min. For n > 1
    this is not guaranteed, because the matrices with singular values >= Psi_min are not
    a convex set. There the projection only keeps Psi invertible.
    """
    U, sigma, Vt = singular_values(Psi)
    at_limit = sigma <= Psi_min
    if not at_limit.any():
        return update.copy()
    # R has full size, because compiled matrices have fixed sizes. Entries of other
    # singular values are 0.
    R = (U.T @ update @ Vt.T) * np.outer(at_limit, at_limit)
    S = (R + R.T) / 2
    # (S^2)^(1/2) has the eigenvectors of S and the magnitudes of its eigenvalues.
    _, sizes, Wt = singular_values(S)
    S_minus = (S - (Wt.T * sizes) @ Wt) / 2
    return update - U @ S_minus @ Vt


def damped_rate(
    gains: BacksteppingGains,
    state: BacksteppingState,
    Phi: Array,
    Phi_dot: Array,
    s: Array,
    F_e: Array,
    damping: Array,
    slope: Array,
) -> BacksteppingState:
    """Returns the time rate of the control force and of all estimates.

    See the top of this file for the derivation and the proof, where the damping of s is
    G1 s. Steps 1 to 4 hold with any damping(s) in place of G1 s and its slope in place
    of G1.

    Args:
        gains: The law's constants.
        state: The law's state.
        Phi: Basis functions at the present input (N).
        Phi_dot: Time rate of Phi in 1/s (N).
        s: Auxiliary error in m/s (n).
        F_e: Force the robot exerts on the environment in N (n).
        damping: The damping of s, a function of s, in m/s^2 (n).
        slope: The derivative of the damping with respect to s in 1/s (n, n).

    Raises:
        numpy.linalg.LinAlgError: If Psi is singular.
    """
    F_c, W1, Psi, W3 = state
    G2 = gains.G2
    Psi_min = gains.Psi_min
    Psi_inv = np.linalg.inv(Psi)
    dF = F_c - F_e

    y1 = W1 @ Phi  # (4.8, 5.8)
    y3 = W3 @ Phi  # (4.25, 5.25)
    offset = Psi_inv @ (y1 + damping)
    alpha = F_e - offset  # (4.23, 5.22)
    z = F_c - alpha  # (4.18, 5.17)

    # Update laws (4.52, 5.51), W3 with the sign of the derivation.
    Ps = gains.P @ s
    g = Ps + slope.T @ (Psi_inv.T @ z)
    g_column = g[:, np.newaxis]
    W1_dot = gains.beta1 * (g_column * Phi - gains.nu1 * W1)
    Psi_dot = g_column * dF + gains.Upsilon * (gains.Psi0 - Psi)
    # 1/sigma_min <= |Psi^-1|, so that far from the limit no decomposition is needed.
    if (Psi_inv * Psi_inv).sum() * Psi_min**2 > 0.9:
        Psi_dot = project(Psi, Psi_dot, Psi_min)  # (4.53, 5.53)
    Psi_dot = gains.beta2 * Psi_dot
    W3_dot = gains.beta3 * (-z[:, np.newaxis] * Phi - gains.nu3 * W3)

    # The law's estimate of the rate of the virtual control (4.31, 5.30).
    s_dot = Psi @ dF + y1  # (4.36, 5.35)
    y1_dot = W1_dot @ Phi + W1 @ Phi_dot
    alpha_dot = y3 + Psi_inv @ (Psi_dot @ offset) - Psi_inv @ (y1_dot + slope @ s_dot)
    F_c_dot = alpha_dot - Psi.T @ Ps - G2 @ z  # (4.32, 5.31)
    return BacksteppingState(F_c_dot, W1_dot, Psi_dot, W3_dot)


class Known(NamedTuple):
    """The quantities that a law uses at an instant; see known().

    Attributes:
        state: The law's state.
        Phi: Basis functions at the present input (N).
        Phi_dot: The law's estimate of the rate of Phi in 1/s (N).
        s: Auxiliary error in m/s (n).
        F_e: Force the robot exerts on the environment in N (n).
    """

    state: BacksteppingState
    Phi: Array
    Phi_dot: Array
    s: Array
    F_e: Array


def known(
    gains: BacksteppingGains,
    network: Lattice,
    x: Array,
    r: Array,
    v: Array,
    v_dd: Array,
    F_e: Array,
    F_hd: Array,
) -> Known:
    """Returns the quantities that a law with Gaussian networks uses at an instant.

    The networks' input is r, or [r; v] if the lattice has more dimensions than r.

    Args:
        gains: The law's constants.
        network: The lattice of the basis functions.
        x: The law's state as returned by pack_state().
        r: Position of the tool in m (n).
        v: Velocity of the tool in m/s (n).
        v_dd: Commanded velocity as received, in m/s (n).
        F_e: Force the robot exerts on the environment in N (n).
        F_hd: The operator's force as received, in N (n).
    """
    state = unpack_state(x, v.size)
    r_dot = position_rate(r, v)
    if network.widths.size > r.size:
        r_dot = np.concatenate((r_dot, state.Psi @ (state.F_c - F_e)))
        r = np.concatenate((r, v))
    Phi, Phi_dot = gaussian_functions(r, r_dot, network.centres, network.widths)
    s = auxiliary_error(gains, v, v_dd, F_e, F_hd)
    return Known(state, Phi, Phi_dot, s, F_e)


def adaptive_rate(gains: BacksteppingGains, *taken: Any) -> Array:
    """Returns the rate of the law's state with Gaussian networks as a vector.

    The arguments are those of known().
    """
    now = known(gains, *taken)
    return pack_state(damped_rate(gains, *now, gains.G1 @ now.s, gains.G1))


def adaptive_errors(gains: BacksteppingGains, *taken: Any) -> Array:
    """Returns [s in m/s; z in N] (2n).

    The arguments are those of known().
    """
    state, Phi, _, s, F_e = known(gains, *taken)
    return np.concatenate((s, damped_force_error(state, Phi, F_e, gains.G1 @ s)))

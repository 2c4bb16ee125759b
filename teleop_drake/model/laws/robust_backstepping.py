"""Backstepping with robust terms against approximation errors of the networks.

The law extends `laws.backstepping`, whose notation it uses. The plant has remainders,

    ds/dt   = Psi* (F_c - F_e) + W1* Phi + d1,     |d1| <= rho1
    dF_e/dt = W3* Phi + d3,                        |d3| <= rho3

which are the approximation errors of the networks. Only their bounds are known. With
the smoothed direction u/|u|_eps, where |u|_eps = sqrt(|u|^2 + eps^2), the robust law is

    h(s)    = G1 s + rho1 P s/|P s|_eps1               damping in place of G1 s
    H(s)    = dh/ds = G1 + rho1 (P - P s (P^2 s)^T/|P s|_eps1^2)/|P s|_eps1
    w       = H^T Psi^-T z
    dF_c/dt = (as in backstepping, with h for G1 s and H for G1)
              - rho1 Psi^-1 H w/|w|_eps1 - rho3 z/|z|_eps3

The update laws are those of backstepping with g = P s + w. Their leakage, nu and
Upsilon, is the sigma modification, which keeps estimates bounded without excitation.

Proof of uniform ultimate boundedness, with V2 of `laws.backstepping`, the projection
inactive and Psi*, W1*, W3* constant.

1.  Steps 1 to 4 there hold with h and H, because H is the derivative of h. They leave
    dV2/dt = -s^T P h - z^T G2 z + g^T d1 - z^T d3 - rho1 |w|^2/|w|_eps1
             - rho3 |z|^2/|z|_eps3 + L.
    The remainders enter as e does in step 3, and the leakage as
    L = nu1 <W1~, W1> + nu3 <W3~, W3> - Upsilon <Psi~, Psi0 - Psi>.
2.  With u = P s the robust terms and the remainders are three differences of the same
    form, for u, w and z:   u^T d - rho |u|^2/|u|_eps <= rho (|u| - |u|^2/|u|_eps)
    <= c rho eps. The maximum of x - x^2/sqrt(x^2 + 1) is c = phi^(-5/2) = 0.3003, with
    the golden ratio phi, at x^2 = 1/phi.
3.  <W1~, W1> = <W1~, W1* - W1~> <= (|W1*|^2 - |W1~|^2)/2, and the others alike.

Hence dV2/dt <= -kappa V2 + D with

    kappa = min(2 lambda_min(P G1)/lambda_max(P), 2 lambda_min(G2),
                beta1 nu1, beta3 nu3, beta2 Upsilon)
    D     = c (2 rho1 eps1 + rho3 eps3)
            + (nu1 |W1*|^2 + nu3 |W3*|^2 + Upsilon |Psi* - Psi0|^2)/2

with lambda_min(P G1) of the symmetric part. Hence V2(t) <= V2(0) exp(-kappa t) +
D/kappa, and V2 falls below every bound above D/kappa. With exact networks, without
leakage and for eps to 0, s and z tend to zero. With rho = 0 the law is backstepping.

What the proof does not cover:

* Remainders beyond the bounds. The excess of d1 adds |g| (|d1| - rho1) to dV2/dt, the
  excess of d3 adds |z| (|d3| - rho3).
* Punctures. A force that jumps by J makes s jump by Lambda J and z by
  -J + Psi^-1 (h(s + Lambda J) - h(s)), and V2 jumps with them. Its root is a norm, so

      |sqrt(2 V2)| jumps by at most  |P^(1/2) Lambda J| + |J|
          + |Psi^-1| (|G1 Lambda J| + min(2 rho1, rho1 |P Lambda J|/eps1)).

  Psi*, W1* and W3* belong to one layer of material and jump as well. Between jumps V2
  decays as above. If jumps are at least T apart and each one raises sqrt(2 V2) by at
  most j, then sqrt(2 V2) is ultimately at most
  sqrt(2 D/kappa) + j/(1 - exp(-kappa T/2)). For a chattering tool no such T exists.
* A moving arm. Its Psi* changes, which adds <Psi~, dPsi*/dt>/beta2 to dV2/dt.
* The loop through the operator and the channels. d1 contains the rates of v_d and F_h,
  so that |d1| <= rho1 is a condition on the received signals, not only on the networks.
* Stiffness. Near s = 0 the robust term is an additional gain rho1/eps1 beside G1. A
  small eps1 makes the law stiff, for the solver and for a real drive.

Sources: P. A. Ioannou and J. Sun, "Robust Adaptive Control" (1996), ch. 8 (leakage);
M. M. Polycarpou and P. A. Ioannou, "A robust adaptive nonlinear control design",
Automatica 32 (1996) (smoothed bounding terms in backstepping).
"""

from typing import Any, NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.model.laws.backstepping import (
    BacksteppingGains,
    damped_force_error,
    damped_rate,
    known,
    pack_state,
)


class RobustBounds(NamedTuple):
    """The bounds of the remainders, and the widths over which directions are smoothed.

    Attributes:
        rho1: Bound of |d1| in m/s^2, >= 0.
        eps1: Smoothing of the direction of P s, > 0, in the unit of P s (m/s if P = 1).
        rho3: Bound of |d3| in N/s, >= 0.
        eps3: Smoothing of the direction of z, in N, > 0.
    """

    rho1: float
    eps1: float
    rho3: float
    eps3: float


def smooth_norm(u: Array, eps: float) -> float:
    """Returns |u|_eps = sqrt(|u|^2 + eps^2)."""
    return np.sqrt((u * u).sum() + eps**2)


def robust_damping(
    gains: BacksteppingGains, bounds: RobustBounds, s: Array
) -> tuple[Array, Array]:
    """Returns h(s) in m/s^2 (n) and H(s) in 1/s (n, n) for the auxiliary error s."""
    P = gains.P
    G1 = gains.G1
    u = P @ s
    norm = smooth_norm(u, bounds.eps1)
    share = bounds.rho1 / norm
    direction = u / norm
    slope = G1 + share * (P - direction[:, np.newaxis] * (P @ direction))
    return G1 @ s + share * u, slope


def robust_force_rate(
    bounds: RobustBounds, Psi: Array, slope: Array, z: Array
) -> Array:
    """Returns the robust terms that are subtracted from dF_c/dt, in N/s (n)."""
    shaped = np.linalg.inv(Psi) @ slope
    w = shaped.T @ z
    share1 = bounds.rho1 / smooth_norm(w, bounds.eps1)
    share3 = bounds.rho3 / smooth_norm(z, bounds.eps3)
    return shaped @ w * share1 + z * share3


def robust_rate(bounds: RobustBounds, gains: BacksteppingGains, *taken: Any) -> Array:
    """Returns the rate of the law's state as a vector.

    The further arguments are those of backstepping.known() after `gains`.
    """
    now = known(gains, *taken)
    damping, slope = robust_damping(gains, bounds, now.s)
    rate = damped_rate(gains, *now, damping, slope)
    z = damped_force_error(now.state, now.Phi, now.F_e, damping)
    robust = robust_force_rate(bounds, now.state.Psi, slope, z)
    return pack_state(rate._replace(F_c=rate.F_c - robust))


def robust_errors(bounds: RobustBounds, gains: BacksteppingGains, *taken: Any) -> Array:
    """Returns [s in m/s; z in N] (2n); the arguments are those of robust_rate()."""
    state, Phi, _, s, F_e = known(gains, *taken)
    damping, _ = robust_damping(gains, bounds, s)
    return np.concatenate((s, damped_force_error(state, Phi, F_e, damping)))

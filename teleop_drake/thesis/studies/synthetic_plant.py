"""The law with a plant that its networks describe exactly."""

import math
from dataclasses import dataclass

import numpy as np

from teleop_drake.laws.backstepping import (
    BacksteppingGains,
    BacksteppingState,
    backstepping_rate,
    control_force_error,
)
from teleop_drake.laws.gaussian_network import GaussianNetwork


@dataclass(frozen=True, kw_only=True)
class SyntheticRun:
    """The closed loop of the law and a plant that its networks describe exactly.

    Attributes:
        time: (T,) in s.
        V2: (T,) the Lyapunov function (4.27), (5.26).
        predicted: (T,) V2(0) less the integral of s^T P G1 s + z^T G2 z.
        bound: (T,) V2(0) less that of lambda_min(G) |mu|^2, (4.47) with delta = 0.
    """

    time: np.ndarray
    V2: np.ndarray
    predicted: np.ndarray
    bound: np.ndarray


def SimulateSyntheticPlant(
    *, has_printed_sign: bool = False, duration: float = 6.0, step: float = 0.01
) -> SyntheticRun:
    """Runs the law with a synthetic plant of two axes, nu = Upsilon = 0.

        ds/dt = Psi* (F_c - F_e) + W1* Phi,   dF_e/dt = W3* Phi

    Classical Runge-Kutta; the networks' input moves along a given curve.

    Args:
        has_printed_sign: Whether the third network learns with the sign that (4.43),
            (4.52), (5.42) and (5.51) print.
        duration: In s.
        step: In s.
    """
    rng = np.random.default_rng(5)
    identity = np.eye(2)
    network = GaussianNetwork(lower=[-1, -1], upper=[1, 1], count=[3, 3], width=1.0)
    N = network.num_functions
    gains = BacksteppingGains(
        Lambda=identity,
        G1=4.0 * identity,
        G2=30.0 * identity,
        P=identity,
        beta1=2.0,
        beta2=2.0,
        beta3=2.0,
        nu1=0.0,
        nu3=0.0,
        Upsilon=0.0,
        Psi0=3.0 * identity,
        Psi_min=0.1,
    )
    ideal = BacksteppingState(
        np.zeros(2),
        rng.normal(size=(2, N)),
        np.array([[4.3, -2.2], [-2.2, 3.2]]),
        5.0 * rng.normal(size=(2, N)),
    )
    eigenvalue = SmallestEigenvalue(gains)

    def Basis(t: float) -> tuple[np.ndarray, np.ndarray]:
        u = np.array([math.sin(0.7 * t), math.cos(1.1 * t)])
        u_dot = np.array([0.7 * math.cos(0.7 * t), -1.1 * math.sin(1.1 * t)])
        return network.evaluate_with_rate(u, u_dot)

    shapes = [(2,), (2, N), (2, 2), (2, N), (2,), (2,)]
    ends = np.cumsum([math.prod(shape) for shape in shapes])

    def Split(y: np.ndarray) -> list[np.ndarray]:
        parts = np.split(y[:-2], ends[:-1])
        return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]

    def Rate(t: float, y: np.ndarray) -> np.ndarray:
        *estimate, s, F_e = Split(y)
        state = BacksteppingState(*estimate)
        Phi, Phi_dot = Basis(t)
        # With v_dd = F_hd = 0 this velocity makes the law see s.
        rate = backstepping_rate(
            gains,
            state,
            Phi=Phi,
            Phi_dot=Phi_dot,
            v=s - F_e,
            v_dd=np.zeros(2),
            F_e=F_e,
            F_hd=np.zeros(2),
        )
        if has_printed_sign:
            rate = rate._replace(W3=-rate.W3)
        z = control_force_error(gains, state, Phi=Phi, s=s, F_e=F_e)
        return np.concatenate(
            [
                *(part.ravel() for part in rate),
                ideal.Psi @ (state.F_c - F_e) + ideal.W1 @ Phi,
                ideal.W3 @ Phi,
                [4.0 * s @ s + 30.0 * z @ z, eigenvalue * (s @ s + z @ z)],
            ]
        )

    def Energy(t: float, y: np.ndarray) -> float:
        *estimate, s, F_e = Split(y)
        state = BacksteppingState(*estimate)
        z = control_force_error(gains, state, Phi=Basis(t)[0], s=s, F_e=F_e)
        wrong = sum(
            float(np.sum((a - b) ** 2)) / 2.0
            for a, b in zip(ideal[1:], state[1:], strict=True)
        )
        return float(s @ s + z @ z + wrong) / 2

    y = np.concatenate(
        [
            np.zeros(2 + 2 * N),
            gains.Psi0.ravel(),
            np.zeros(2 * N),
            [0.5, -0.3, 0.2, 0.1, 0.0, 0.0],
        ]
    )
    time = np.arange(0.0, duration + step / 2, step)
    V2, lost = [Energy(0.0, y)], [y[-2:]]
    for t in time[:-1]:
        k1 = Rate(t, y)
        k2 = Rate(t + step / 2, y + step / 2 * k1)
        k3 = Rate(t + step / 2, y + step / 2 * k2)
        k4 = Rate(t + step, y + step * k3)
        y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        V2.append(Energy(t + step, y))
        lost.append(y[-2:])
    energy, losses = np.array(V2), np.array(lost)
    return SyntheticRun(
        time=time,
        V2=energy,
        predicted=energy[0] - losses[:, 0],
        bound=energy[0] - losses[:, 1],
    )


def SmallestEigenvalue(gains: BacksteppingGains) -> float:
    """Returns lambda_min of G = diag(P G1, G2), (4.46), (5.45)."""
    PG1 = gains.P @ gains.G1
    return min(
        float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[0])
        for matrix in (PG1, gains.G2)
    )

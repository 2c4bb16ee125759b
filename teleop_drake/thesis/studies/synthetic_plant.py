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


class _SyntheticPlant:
    """The law with the plant; y is [the law's state, s, F_e, what V2 has lost (2)]."""

    def __init__(self, has_printed_sign: bool):
        rng = np.random.default_rng(5)
        identity = np.eye(2)
        self._network = GaussianNetwork(
            lower=[-1, -1], upper=[1, 1], count=[3, 3], width=1.0
        )
        N = self._network.num_functions
        self._gains = BacksteppingGains(
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
        self._ideal = BacksteppingState(
            np.zeros(2),
            rng.normal(size=(2, N)),
            np.array([[4.3, -2.2], [-2.2, 3.2]]),
            5.0 * rng.normal(size=(2, N)),
        )
        self._eigenvalue = SmallestEigenvalue(self._gains)
        self._has_printed_sign = has_printed_sign
        self._shapes = [(2,), (2, N), (2, 2), (2, N), (2,), (2,)]
        self._ends = np.cumsum([math.prod(shape) for shape in self._shapes])

    def Start(self) -> np.ndarray:
        """Returns y at time 0."""
        N = self._network.num_functions
        return np.concatenate(
            [
                np.zeros(2 + 2 * N),
                self._gains.Psi0.ravel(),
                np.zeros(2 * N),
                [0.5, -0.3, 0.2, 0.1, 0.0, 0.0],
            ]
        )

    def Rate(self, t: float, y: np.ndarray) -> np.ndarray:
        """Returns dy/dt; its last two are the losses of V2 in SyntheticRun."""
        *estimate, s, F_e = self._Split(y)
        state = BacksteppingState(*estimate)
        Phi, Phi_dot = self._Basis(t)
        # With v_dd = F_hd = 0 this velocity makes the law see s.
        rate = backstepping_rate(
            self._gains,
            state,
            Phi=Phi,
            Phi_dot=Phi_dot,
            v=s - F_e,
            v_dd=np.zeros(2),
            F_e=F_e,
            F_hd=np.zeros(2),
        )
        if self._has_printed_sign:
            rate = rate._replace(W3=-rate.W3)
        z = control_force_error(self._gains, state, Phi=Phi, s=s, F_e=F_e)
        return np.concatenate(
            [
                *(part.ravel() for part in rate),
                self._ideal.Psi @ (state.F_c - F_e) + self._ideal.W1 @ Phi,
                self._ideal.W3 @ Phi,
                [4.0 * s @ s + 30.0 * z @ z, self._eigenvalue * (s @ s + z @ z)],
            ]
        )

    def Energy(self, t: float, y: np.ndarray) -> float:
        """Returns V2."""
        *estimate, s, F_e = self._Split(y)
        state = BacksteppingState(*estimate)
        z = control_force_error(self._gains, state, Phi=self._Basis(t)[0], s=s, F_e=F_e)
        wrong = sum(
            float(np.sum((a - b) ** 2)) / 2.0
            for a, b in zip(self._ideal[1:], state[1:], strict=True)
        )
        return float(s @ s + z @ z + wrong) / 2

    def _Basis(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        u = np.array([math.sin(0.7 * t), math.cos(1.1 * t)])
        u_dot = np.array([0.7 * math.cos(0.7 * t), -1.1 * math.sin(1.1 * t)])
        return self._network.evaluate_with_rate(u, u_dot)

    def _Split(self, y: np.ndarray) -> list[np.ndarray]:
        parts = np.split(y[:-2], self._ends[:-1])
        return [
            part.reshape(shape) for part, shape in zip(parts, self._shapes, strict=True)
        ]


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
    plant = _SyntheticPlant(has_printed_sign)
    y = plant.Start()
    time = np.arange(0.0, duration + step / 2, step)
    V2, lost = [plant.Energy(0.0, y)], [y[-2:]]
    for t in time[:-1]:
        k1 = plant.Rate(t, y)
        k2 = plant.Rate(t + step / 2, y + step / 2 * k1)
        k3 = plant.Rate(t + step / 2, y + step / 2 * k2)
        k4 = plant.Rate(t + step, y + step * k3)
        y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        V2.append(plant.Energy(t + step, y))
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

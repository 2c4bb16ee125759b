"""The controller of the thesis: adaptive backstepping with neural networks."""

import math
from collections.abc import Mapping
from dataclasses import field, fields
from typing import Any, ClassVar

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Record
from teleop_drake.loops.framework.validation import (
    REQUIRED,
    CheckChoice,
    CheckGain,
    CheckVector,
    Config,
    FixedFields,
    GainMatrix,
    GainRange,
    Gains,
    IsGiven,
    Number,
    Range,
    Refuse,
    ScenarioError,
    Show,
    Within,
)
from teleop_drake.loops.jit.compiled import Law
from teleop_drake.loops.kernel import Kernel
from teleop_drake.loops.kernel.linear_part import FROZEN_WEIGHTS, LinearPart
from teleop_drake.model.blocks.architectures.base import (
    ControlLawConfig,
    Facts,
    LawBlock,
)
from teleop_drake.model.kinds import NumberNames
from teleop_drake.model.laws.backstepping import (
    BacksteppingGains,
    adaptive_errors,
    adaptive_rate,
    initial_state,
    pack_state,
)
from teleop_drake.model.laws.gaussian_network import GaussianNetwork
from teleop_drake.model.laws.robust_backstepping import RobustBounds

# Relative distance from its limit at which Psi counts as being there. The solver's own
# error, which keeps Psi away from the limit, is far smaller.
_AT_LIMIT = 1e-5


class AdaptiveBackstepping(LawBlock):
    """Tracks the operator's delayed velocity and force with two adaptive networks.

        s       = (v - v_dd) + Lambda (F_e - F_hd)                          (4.2, 5.2)
        alpha   = F_e - Psi^-1 (W1 Phi + G1 s)                            (4.23, 5.22)
        z       = F_c - alpha                                             (4.18, 5.17)
        dF_c/dt = alpha' - Psi^T P s - G2 z                               (4.32, 5.31)
        alpha'  = W3 Phi + Psi^-1 dPsi/dt Psi^-1 (W1 Phi + G1 s)
                  - Psi^-1 (d(W1 Phi)/dt + G1 s')                         (4.31, 5.30)
        s'      = Psi (F_c - F_e) + W1 Phi                                (4.36, 5.35)
        g       = P s + G1^T Psi^-T z
        dW1/dt  = beta1 (g Phi^T - nu1 W1)                                (4.52, 5.51)
        dPsi/dt = beta2 proj[g (F_c - F_e)^T + Upsilon (Psi0 - Psi)]      (4.52, 5.51)
        dW3/dt  = -beta3 (z Phi^T + nu3 W3)                               (4.52, 5.51)

    with proj[] of (4.53, 5.53), which keeps Psi invertible. The proof, and the reason
    why the sign of dW3/dt is not the printed one, are in
    `laws.backstepping`. F_hd = F_h(t - T_f) and v_dd = v_d(t - T_f) are
    received over the forward channel. The input of both networks is the tool's position
    r, or [r; v]; see `laws.backstepping.known` for the dPhi/dt that the law then uses.

    | port | name                | size  | unit  | is                       |
    |------|---------------------|-------|-------|--------------------------|
    | in   | haptic_force        | n     | N     | F_hd                     |
    | in   | velocity_command    | n     | m/s   | v_dd                     |
    | in   | tool_position       | n     | m     | r, input of the networks |
    | in   | tool_velocity       | n     | m/s   | v                        |
    | in   | environment_force   | n     | N     | F_e                      |
    | out  | control_force       | n     | N     | F_c                      |
    | out  | psi                 | n n   | 1/kg  | Psi, row by row          |
    | out  | weights_1           | n N   | m/s^2 | W1, row by row           |
    | out  | weights_3           | n N   | N/s   | W3, row by row           |
    | out  | auxiliary_error     | n     | m/s   | s                        |
    | out  | control_force_error | n     | N     | z                        |

    | parameter | name      | unit    |
    |-----------|-----------|---------|
    | 0         | Lambda    | m/(N s) |
    | 1         | G1        | 1/s     |
    | 2         | G2        | 1/s     |
    | 3         | P         | -       |
    | 4         | beta1     | -       |
    | 5         | beta2     | -       |
    | 6         | beta3     | -       |
    | 7         | nu1       | -       |
    | 8         | nu3       | -       |
    | 9         | Upsilon   | -       |
    | 10        | Psi0      | 1/kg    |
    | 11        | Psi_min   | 1/kg    |

    State (continuous): [F_c (n), W1 (n N), Psi (n n), W3 (n N)], matrices row by row;
    `teleop_drake.model.laws.backstepping.unpack_state` takes it apart.

    Initial value: F_c = 0, W1 = W3 = 0, Psi = Psi0.

    Direct feedthrough: none to control_force, psi, weights_1 and weights_3; from all
    inputs to auxiliary_error and control_force_error.

    It neither limits the control force nor has a model of the robot; n is that of the
    gains. If an input jumps (at a puncture, or with a command), s and z jump, but F_c
    does not.

    Args:
        gains: The constants of the law.
        network: The basis functions of both networks, with n inputs in m, or 2n in m
            and m/s.
        bounds: The bounds of the terms that RobustBackstepping adds; None: no terms.
    """

    is_compiled = True
    # The block's name, and the functions that compute dx/dt and [s; z]. Their first
    # arguments are the bounds, if there are any, the gains and the network.
    law: ClassVar[tuple[str, Law, Law]] = (
        "adaptive_backstepping",
        adaptive_rate,
        adaptive_errors,
    )

    numeric_parameters: ClassVar = {
        "Lambda": Range("m/(N s)", is_matrix=True),
        "G1": Range("1/s", is_matrix=True),
        "G2": GainRange("1/s"),
        "P": GainRange(),
        "beta1": Range(minimum=0),
        "beta2": Range(minimum=0),
        "beta3": Range(minimum=0),
        "nu1": Range(minimum=0),
        "nu3": Range(minimum=0),
        "Upsilon": Range(minimum=0, maximum=1),
        "Psi0": Range("1/kg", is_matrix=True),
        "Psi_min": Range("1/kg", above=0),
    }

    def __init__(
        self,
        gains: BacksteppingGains,
        network: GaussianNetwork,
        *,
        bounds: RobustBounds | None = None,
    ):
        name, rate, errors = self.law
        n = gains.num_axes
        N = network.num_functions
        if network.num_inputs not in (n, 2 * n):
            Refuse(
                "network.num_inputs",
                network.num_inputs,
                f"{n} or {2 * n}, one or two for each task axis",
            )
        self._n = n
        self._psi_min = gains.Psi_min
        # The parameters, in the order in which the law's functions take them.
        constants: Record = {} if bounds is None else {"bounds": bounds}
        constants |= {"gains": gains.as_numbers(), "network": network.as_numbers()}
        taken = (
            *constants, "state", "tool_position", "tool_velocity", "velocity_command",
            "environment_force", "haptic_force",
        )  # fmt: skip
        # Places where W1, Psi and W3 begin in the state.
        W1 = n
        Psi = n + n * N
        W3 = n + n * N + n * n
        LawBlock.__init__(
            self,
            name,
            Kernel(
                parameters=constants,
                rate=(rate, *taken),
                outputs={
                    "control_force": ("state", 0, n),
                    "psi": ("state", Psi, W3),
                    "weights_1": ("state", W1, Psi),
                    "weights_3": ("state", W3, W3 + n * N),
                    "errors": (errors, *taken),
                    "auxiliary_error": ("errors", 0, n),
                    "control_force_error": ("errors", n, 2 * n),
                },
                sizes={"errors": 2 * n},
            ),
            n,
            psi=n * n,
            weights_1=n * N,
            weights_3=n * N,
            state=pack_state(initial_state(gains, N)),
        )

    def CheckParameters(self, values: Mapping[str, Any]) -> None:
        """Refuses gains that BacksteppingGains() refuses; see KernelBlock."""
        BacksteppingGains(**values["gains"]._asdict())

    def RunNotes(self, time: Array, signals: Mapping[str, Array]) -> list[str]:
        """Returns a note for the recording if Psi came to its limit in a run."""
        if "psi" not in signals:
            return []
        n = self._n
        limit = (1 + _AT_LIMIT) * self._psi_min
        psi = signals["psi"].reshape(-1, n, n)
        # Because 1/sigma_min <= |Psi^-1|, most samples are ruled out without a singular
        # value decomposition.
        is_at_limit = ~(np.linalg.norm(np.linalg.inv(psi), axis=(1, 2)) * limit < 1)
        smallest = np.linalg.norm(psi[is_at_limit], -2, axis=(1, 2))
        is_at_limit[is_at_limit] = smallest <= limit
        if not is_at_limit.any():
            return []
        return [
            f"Psi comes to its limit, minimum_psi = {self._psi_min:g} 1/kg, at "
            f"{time[is_at_limit.argmax()]:.4g} s, where the adaptive law is not "
            "smooth: the run may end differently at another accuracy."
        ]

    def ForLinearModel(self, estimates: Array | None) -> LinearPart:
        """Returns that F_c, the first part of the state, is the state of the model."""
        return LinearPart(
            num_states=self._n, state=estimates, assumption=FROZEN_WEIGHTS
        )


NETWORK_INPUTS = ("position", "position_velocity")
"""The possible inputs of the networks."""

MAX_BASIS_FUNCTIONS = 10_000
"""Largest lattice that a network may have, so that a typing error cannot exhaust the
memory."""


@Config
class NetworkConfig(FixedFields):
    """Lattice of the Gaussian networks (thesis eq. 3.1)."""

    # Input of the networks: position, p_WT; or position_velocity, [p_WT; v_WT].
    # Assumed: the thesis does not say.
    inputs: str = "position"

    # Corners of the lattice of means, m, n entries each, lower < upper.
    lower: np.ndarray = REQUIRED
    upper: np.ndarray = REQUIRED
    # Means along each axis, n entries, >= 1.
    count: list[int] = REQUIRED
    # Largest speed of the lattice, m/s, > 0, for position_velocity only. Each axis of
    # velocity reaches from minus this speed to this speed. Assumed: twice the commanded
    # speed is a good choice.
    velocity_range: float | None = Number(None, "m/s", above=0)
    # Means along each axis of velocity, >= 1.
    velocity_count: int = 3
    # Width of the Gaussians in units of the lattice spacing, > 0.
    width: float = Number(1.0, "lattice spacings", above=0)

    @property
    def is_given(self) -> bool:
        """Whether any of the fields without a default is given."""
        return any(item is not None for item in (self.lower, self.upper, self.count))

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field."""
        n = num_axes
        with Within(path):
            CheckVector("lower", self.lower, n, "m")
            CheckVector("upper", self.upper, n, "m")
            if not np.all(self.lower < self.upper):
                Refuse(
                    "upper",
                    self.upper,
                    f"> {path}.lower = {Show(self.lower)} m on every axis",
                )
            count = self.count
            if not IsGiven(count) or len(count) != n or min(count) < 1:
                Refuse("count", count, f"a list of {n} whole numbers >= 1")
            self.CheckNumbers()
            CheckChoice("inputs", self.inputs, NETWORK_INPUTS)
            if self.velocity_count < 1:
                Refuse("velocity_count", self.velocity_count, ">= 1")
            if self.has_velocity and self.velocity_range is None:
                Refuse("velocity_range", None, "a speed in m/s > 0")
            speeds = self.velocity_count**n if self.has_velocity else 1
            if math.prod(count) * speeds > MAX_BASIS_FUNCTIONS:
                Refuse("count", count, f"at most {MAX_BASIS_FUNCTIONS} in all")

    @property
    def has_velocity(self) -> bool:
        """Whether the velocity is an input."""
        return self.inputs == NETWORK_INPUTS[1]

    def MakeNetwork(self) -> GaussianNetwork:
        """Makes the basis functions."""
        lower = self.lower
        upper = self.upper
        count = self.count
        if self.has_velocity:
            assert self.velocity_range is not None
            speeds = np.full(len(count), self.velocity_range)
            lower = np.append(lower, -speeds)
            upper = np.append(upper, speeds)
            count = [*count, *[self.velocity_count] * len(count)]
        return GaussianNetwork(lower=lower, upper=upper, count=count, width=self.width)


_GAINS = ("Lambda", "G1", "G2", "P")


@Config
class BacksteppingParameters(FixedFields):
    """The parameters of chapters 4 and 5.

    In a scenario they are fields of `controller` itself. A gain is a number (times the
    identity) or an n x n matrix.
    """

    # Weight of the force error in s, m/(N s); symmetric positive definite (eq. 4.2,
    # 5.2).
    Lambda: Gains = 1.0
    # Gain on s, 1/s; symmetric positive definite, and so is the symmetric part of
    # P G1 (eq. 4.23, 5.22).
    G1: Gains = REQUIRED
    # Gain on z, 1/s; symmetric positive definite (eq. 4.32, 5.31).
    G2: Gains = REQUIRED
    # Weight of s in the Lyapunov function; symmetric positive definite (eq. 5.10).
    P: Gains = 1.0
    # beta of every update law for which none is given below, >= 0 (eq. 4.52, 5.51).
    adaptation_rate: float = Number(0.1, minimum=0)
    # beta of W1, Psi and W3, >= 0; null: adaptation_rate. Their units differ: if forces
    # are f times as large, the terms that they multiply are f^2, f^4 and 1 times as
    # large, in proportion to the estimates.
    beta1: float | None = Number(None, minimum=0)
    beta2: float | None = Number(None, minimum=0)
    beta3: float | None = Number(None, minimum=0)
    # nu of every update law, >= 0 (eq. 4.52, 5.51).
    leakage: float = Number(0.1, minimum=0)
    # Upsilon, pull of Psi to its initial value, 0 to 1 (eq. 4.52, 5.51).
    supervision: float = Number(1.0, minimum=0, maximum=1)
    # Psi at time 0, 1/kg: number, n x n matrix, or auto = (I + Lambda D_e) M_r^-1 at
    # the start pose (eq. 5.52); smallest singular value > minimum_psi.
    initial_psi: Gains | str = "auto"
    # Bound of the projection that keeps Psi invertible, 1/kg, > 0 (eq. 4.53, 5.53).
    minimum_psi: float = Number(0.1, "1/kg", above=0)
    # Lattice of both networks.
    network: NetworkConfig = field(default_factory=NetworkConfig)

    def CheckParameters(self, path: str, num_axes: int, *, is_needed: bool) -> None:
        """Checks each field.

        Args:
            path: The field of the parameters in a scenario, for messages.
            num_axes: n, number of task axes.
            is_needed: Whether fields without a default must be given. If another kind
                of controller is selected, they may be missing but must not be wrong, so
                that a change of `kind` is enough to select this one.
        """
        gains = {}
        for key in _GAINS:
            value = getattr(self, key)
            if value is not None or is_needed:
                gains[key] = CheckGain(f"{path}.{key}", value, num_axes)
        if "G1" in gains:
            # With an overflow the product is not finite and is refused as well.
            with np.errstate(all="ignore"):
                product = gains["P"] @ gains["G1"]
                product = product + product.T
            if not np.isfinite(product).all() or np.linalg.eigvalsh(product)[0] <= 0:
                Refuse(
                    f"{path}.P",
                    self.P,
                    "such that the symmetric part of P G1 is positive definite",
                )
        self.CheckNumbers(path)
        if is_needed or self.network.is_given:
            self.network.Check(f"{path}.network", num_axes)

    def InitialPsi(self, facts: Facts, path: str = "controller") -> Array:
        """Returns Psi at time 0 in 1/kg (n, n).

        For `auto` it is (I + Lambda D_e) M_r^-1 at the start pose. The thesis estimates
        M_r^-1 for zero joint angles (eq. 5.52), where the planar arm is singular. A Psi
        is refused unless its determinant is positive and its singular values are larger
        than minimum_psi.
        """
        n = facts.num_axes
        given = self.initial_psi
        field = f"{path}.initial_psi"
        if isinstance(given, str):
            D_e = facts.Told("environment_damping", field)
            weight = np.eye(n) + GainMatrix(self.Lambda, n) @ D_e
            psi = weight @ np.linalg.inv(facts.Told("inertia", field))
        else:
            psi = GainMatrix(given, n)
        is_negative = isinstance(given, float) and given <= 0
        is_matrix = psi.shape == (n, n) and np.isfinite(psi).all()
        if is_negative or not is_matrix or not np.linalg.slogdet(psi)[0] > 0:
            allowed = f"auto, a positive number or a {n} x {n} matrix"
            Refuse(field, given, f"{allowed} with positive determinant")
        smallest = np.linalg.svd(psi, compute_uv=False)[-1]
        if not smallest > self.minimum_psi:
            raise ScenarioError(
                f"{field} = {Show(given)}, with the smallest singular value "
                f"{smallest:.4g} 1/kg: must be larger than {path}.minimum_psi = "
                f"{self.minimum_psi:g}; write minimum_psi: {_Half(smallest)}"
            )
        return psi


def _Half(number: float) -> str:
    """Returns a number with one digit that is about half of a number, and less."""
    return f"{float(f'{0.49 * number:.0e}'):g}"


@Config
class AdaptiveBacksteppingConfig(ControlLawConfig, BacksteppingParameters):
    """Chapters 4 and 5 as one n-dimensional law; see laws.backstepping."""

    kind = "adaptive_backstepping"
    derives_from_channels = False
    block: ClassVar[type[AdaptiveBackstepping]] = AdaptiveBackstepping

    @classmethod
    def Of(cls, parameters: BacksteppingParameters) -> "AdaptiveBacksteppingConfig":
        """Returns the config with these parameters."""
        return cls(
            **{item.name: getattr(parameters, item.name) for item in fields(cls)}
        )

    def Check(self, path: str, num_axes: int) -> None:
        """Checks each field."""
        self.CheckParameters(path, num_axes, is_needed=True)

    def Resolve(self, facts: Facts, path: str) -> BacksteppingGains:
        """Returns the gains of the law, with Psi at time 0."""
        n = facts.num_axes
        beta = self.adaptation_rate
        return BacksteppingGains(
            **{name: GainMatrix(getattr(self, name), n) for name in _GAINS},
            beta1=beta if self.beta1 is None else self.beta1,
            beta2=beta if self.beta2 is None else self.beta2,
            beta3=beta if self.beta3 is None else self.beta3,
            nu1=self.leakage,
            nu3=self.leakage,
            Upsilon=self.supervision,
            Psi0=self.InitialPsi(facts, path),
            Psi_min=self.minimum_psi,
        )

    def Numbers(self) -> NumberNames | None:
        """Returns the names of fields in the Contexts of blocks; see KindConfig."""
        names = (*_GAINS, "beta1", "beta2", "beta3", "nu1", "nu3", "Upsilon")
        from_fields = dict.fromkeys(("adaptation_rate", "leakage", "supervision"), ())
        return {**from_fields, **{name: (f"controller.{name}",) for name in names}}

    def MakeControlLaw(self, facts: Facts, path: str) -> AdaptiveBackstepping:
        """Makes the law."""
        return self.block(
            gains=self.Resolve(facts, path), network=self.network.MakeNetwork()
        )

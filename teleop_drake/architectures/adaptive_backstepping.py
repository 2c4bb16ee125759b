"""The thesis's controller: adaptive backstepping with neural networks."""

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from teleop_drake.architectures.base import ControlLawConfig
from teleop_drake.architectures.facts import Facts
from teleop_drake.architectures.lattice import NetworkConfig
from teleop_drake.laws.backstepping import BacksteppingGains
from teleop_drake.systems.adaptive_backstepping import AdaptiveBackstepping
from teleop_drake.validation import (
    REQUIRED,
    CheckGain,
    CheckNumber,
    GainMatrix,
    Refuse,
    ScenarioError,
    Show,
)

_GAINS = ("Lambda", "G1", "G2", "P")


@dataclass(kw_only=True, eq=False)
class BacksteppingParameters:
    """The parameters of chapters 4 and 5.

    In a scenario they stand in `controller` itself. A gain is a number (times the
    identity) or an n x n matrix.
    """

    # Weight of the force error in s, m/(N s); symmetric positive definite (eq. 5.2).
    Lambda: np.ndarray | float = 1.0
    # Gain on s, 1/s; symmetric positive definite, and so is the symmetric part of
    # P G1 (eq. 5.22).
    G1: np.ndarray | float = REQUIRED
    # Gain on z, 1/s; symmetric positive definite (eq. 5.31).
    G2: np.ndarray | float = REQUIRED
    # Weight of s in the Lyapunov function; symmetric positive definite (eq. 5.10).
    P: np.ndarray | float = 1.0
    # beta of every update law, >= 0 (eq. 5.51).
    adaptation_rate: float = 0.1
    # nu of every update law, >= 0 (eq. 5.51).
    leakage: float = 0.1
    # Upsilon, pull of Psi to its initial value, 0 to 1 (eq. 5.51).
    supervision: float = 1.0
    # Psi at time 0, 1/kg: number, n x n matrix, or auto = (I + Lambda D_e) M_r^-1 at
    # the start pose (eq. 5.52); smallest singular value > minimum_psi.
    initial_psi: np.ndarray | float | str = "auto"
    # Bound of the projection that keeps Psi invertible, 1/kg, > 0 (eq. 5.53).
    minimum_psi: float = 0.1
    # Lattice of both networks.
    network: NetworkConfig = field(default_factory=NetworkConfig)

    def CheckParameters(self, path: str, num_axes: int, *, is_needed: bool) -> None:
        """Checks every field for itself.

        Args:
            path: Their place in a scenario, for messages.
            num_axes: Number n of task axes.
            is_needed: Whether fields without a default must be there. What another
                kind of controller does not use may be missing, but not wrong, so
                that `kind` alone changes one into the other.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
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
            if not (
                np.all(np.isfinite(product)) and np.all(np.linalg.eigvalsh(product) > 0)
            ):
                allowed = "such that the symmetric part of P G1 is positive definite"
                Refuse(f"{path}.P", self.P, allowed)
        CheckNumber(f"{path}.adaptation_rate", self.adaptation_rate, minimum=0)
        CheckNumber(f"{path}.leakage", self.leakage, minimum=0)
        CheckNumber(f"{path}.supervision", self.supervision, minimum=0, maximum=1)
        CheckNumber(f"{path}.minimum_psi", self.minimum_psi, "1/kg", above=0)
        if is_needed or self.network.is_given:
            self.network.Check(f"{path}.network", num_axes)

    def InitialPsi(self, facts: Facts, path: str = "controller") -> NDArray[np.float64]:
        """Returns Psi at time 0 in 1/kg (n, n).

        For `auto` that is (I + Lambda D_e) M_r^-1 at the start pose. The thesis
        estimates M_r^-1 for zero joint angles (eq. 5.52), where the planar arm is
        singular.

        Args:
            facts: What `auto` derives from.
            path: The place of the parameters in a scenario, for messages.

        Raises:
            ScenarioError: If `auto` cannot be derived.
        """
        n = facts.num_axes
        if not isinstance(self.initial_psi, str):
            return GainMatrix(self.initial_psi, n)
        field = f"{path}.initial_psi"
        D_e = facts.EnvironmentDamping(field)
        weight = np.eye(n) + GainMatrix(self.Lambda, n) @ D_e
        psi: NDArray[np.float64] = weight @ np.linalg.inv(facts.Inertia(field))
        return psi

    def CheckInitialPsi(self, facts: Facts, path: str = "controller") -> None:
        """Checks that Psi can be inverted at time 0 and stays so.

        Args:
            facts: What `auto` derives from.
            path: The place of the parameters in a scenario, for messages.

        Raises:
            ScenarioError: If it cannot.
        """
        psi, n = self.InitialPsi(facts, path), facts.num_axes
        if (
            (isinstance(self.initial_psi, float) and self.initial_psi <= 0)
            or psi.shape != (n, n)
            or not np.all(np.isfinite(psi))
            or not np.min(np.linalg.svd(psi, compute_uv=False)) > self.minimum_psi
            or not np.linalg.slogdet(psi)[0] > 0
        ):
            value = Show(self.initial_psi)
            if value == "'auto'":
                value += f", here {Show(psi)}"
            raise ScenarioError(
                f"{path}.initial_psi = {value}: must be auto, a positive number or a "
                f"{n} x {n} matrix with positive determinant, its singular values > "
                f"minimum_psi = {self.minimum_psi:g}"
            )


@dataclass(kw_only=True, eq=False)
class AdaptiveBacksteppingConfig(ControlLawConfig, BacksteppingParameters):
    """Chapters 4 and 5 as one n-dimensional law; see laws.backstepping."""

    kind = "adaptive_backstepping"

    @classmethod
    def Of(cls, parameters: BacksteppingParameters) -> "AdaptiveBacksteppingConfig":
        """Returns the config with these parameters.

        Args:
            parameters: An object that has them among others.
        """
        return cls(
            **{
                item.name: getattr(parameters, item.name)
                for item in fields(BacksteppingParameters)
            }
        )

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field for itself.

        Args:
            path: The config's place in a scenario, for messages.
            num_axes: Number n of task axes.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        self.CheckParameters(path, num_axes, is_needed=True)

    def Resolve(self, facts: Facts, path: str) -> BacksteppingGains:
        """Returns the gains with Psi at time 0.

        Args:
            facts: What `initial_psi: auto` derives from.
            path: The config's place in a scenario, for messages.

        Raises:
            ScenarioError: If Psi cannot be derived or inverted.
        """
        self.CheckInitialPsi(facts, path)
        n, beta, nu = facts.num_axes, self.adaptation_rate, self.leakage
        return BacksteppingGains(
            Lambda=GainMatrix(self.Lambda, n),
            G1=GainMatrix(self.G1, n),
            G2=GainMatrix(self.G2, n),
            P=GainMatrix(self.P, n),
            beta1=beta,
            beta2=beta,
            beta3=beta,
            nu1=nu,
            nu3=nu,
            Upsilon=self.supervision,
            Psi0=self.InitialPsi(facts, path),
            Psi_min=self.minimum_psi,
        )

    def MakeControlLaw(self, facts: Facts, path: str) -> AdaptiveBackstepping:
        """Makes the law.

        Args:
            facts: What `initial_psi: auto` derives from.
            path: The config's place in a scenario, for messages.

        Raises:
            ScenarioError: If Psi cannot be derived or inverted.
        """
        return AdaptiveBackstepping(
            gains=self.Resolve(facts, path), network=self.network.MakeNetwork()
        )

"""P+d: position-position control with a spring and damping injection."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from teleop_drake.architectures.base import Architecture, ArchitectureConfig
from teleop_drake.architectures.facts import Facts
from teleop_drake.architectures.proportional_master import ProportionalMaster
from teleop_drake.architectures.proportional_slave import ProportionalSlave
from teleop_drake.validation import CheckGain, CheckNumber, GainMatrix, Refuse

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ProportionalDamping:
    """Every number; see ProportionalDampingConfig for what they are."""

    master_mass: Array
    master_damping: Array
    slave_damping: Array
    stiffness: Array


@dataclass(kw_only=True, eq=False)
class ProportionalDampingConfig(ArchitectureConfig):
    """P+d; see architectures.proportional_master.ProportionalMaster."""

    kind = "proportional_damping"

    # Mass of the handle, kg, > 0. Assumed: that of the slider (thesis eq. 2.12).
    master_mass: np.ndarray | float = 0.5
    # B_m, damping of the handle, N s/m, >= 0. Null: the resistance of the haptic device
    # at low frequency, so that the operator feels no more of it than of his own.
    master_damping: np.ndarray | float | None = None
    # B_s, damping of the tool, N s/m, >= 0. Null: as B_m.
    slave_damping: np.ndarray | float | None = None
    # By how much the dampings exceed what stability needs, > 1, for the null below:
    # 4 B_m B_s = margin (T_f + T_r)^2 K^2. Assumed.
    margin: float = 2.0
    # K, N/m, >= 0. Null: from the margin and the nominal delays, with the smallest
    # dampings, but at most what makes the handle as fast as the fastest pole p of the
    # haptic device, K = M |p|^2.
    stiffness: np.ndarray | float | None = None

    @property
    def has_gains_of_delay(self) -> bool:
        """Whether the stiffness derives from the nominal delays."""
        return self.stiffness is None

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field for itself.

        Args:
            path: The config's place in a scenario, for messages.
            num_axes: Number n of task axes.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        if self.master_mass is None:
            Refuse(f"{path}.master_mass", None, "a number or a matrix (kg)")
        # Its message names null for all gains, as most of them may be.
        CheckGain(f"{path}.master_mass", self.master_mass, num_axes, may_be_null=True)
        for key in ("master_damping", "slave_damping", "stiffness"):
            CheckGain(
                f"{path}.{key}",
                getattr(self, key),
                num_axes,
                may_be_zero=True,
                may_be_null=True,
            )
        CheckNumber(f"{path}.margin", self.margin, "", above=1)

    def Resolve(self, facts: Facts, path: str) -> ProportionalDamping:
        """Returns the parameters with every default derived.

        Args:
            facts: What the defaults derive from.
            path: The config's place in a scenario, for messages.

        Raises:
            ScenarioError: If a default cannot be derived.
        """
        n, B_m = facts.num_axes, self.master_damping
        if B_m is None:
            B_m = facts.OperatorResistance(f"{path}.master_damping")
        B_m = GainMatrix(B_m, n)
        B_s = B_m if self.slave_damping is None else GainMatrix(self.slave_damping, n)
        mass = GainMatrix(self.master_mass, n)
        stiffness = self.stiffness
        if stiffness is None:
            least = np.linalg.eigvalsh(B_m)[0] * np.linalg.eigvalsh(B_s)[0]
            stiffness = float(np.linalg.eigvalsh(mass)[0]) * facts.DevicePole() ** 2
            T = facts.round_trip
            if T > 0:
                stiffness = min(stiffness, math.sqrt(4 * least / self.margin) / T)
            if not stiffness > 0:
                Refuse(
                    f"{path}.stiffness",
                    None,
                    "a number, because the dampings or the poles of haptic_device "
                    "are 0",
                )
        return ProportionalDamping(
            master_mass=mass,
            master_damping=B_m,
            slave_damping=B_s,
            stiffness=GainMatrix(stiffness, n),
        )

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides.

        Args:
            facts: What the defaults derive from.
            path: The config's place in a scenario, for messages.

        Raises:
            ScenarioError: If a default cannot be derived.
        """
        numbers = self.Resolve(facts, path)
        start: list[float] = facts.start.tolist()
        return Architecture(
            master_side=ProportionalMaster(
                mass=numbers.master_mass,
                stiffness=numbers.stiffness,
                damping=numbers.master_damping,
                start=start,
            ),
            slave_side=ProportionalSlave(
                stiffness=numbers.stiffness, damping=numbers.slave_damping
            ),
            initial_forward_packet=start,
            initial_return_packet=start,
        )

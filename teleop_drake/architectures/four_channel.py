"""Lawrence's architecture: position and force travel both ways."""

from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_drake.architectures.base import Architecture, ArchitectureConfig
from teleop_drake.architectures.facts import Facts
from teleop_drake.architectures.four_channel_master import FourChannelMaster
from teleop_drake.architectures.four_channel_slave import FourChannelSlave
from teleop_drake.validation import CheckGain, CheckNumber, GainMatrix, Refuse

Array = NDArray[np.float64]


class Variant(NamedTuple):
    """What goes forward and comes back in a variant of the architecture."""

    C1: float
    C2: float
    C3: float
    C4: float
    is_master_tied: bool
    is_slave_tied: bool


FOUR_CHANNEL_VARIANTS = {
    # C1, C2, C3, C4; local stiffness at the master, at the slave.
    "four_channel": Variant(1.0, 1.0, 1.0, 1.0, True, True),
    "position_position": Variant(1.0, 0.0, 0.0, 1.0, True, True),
    "position_force": Variant(1.0, 1.0, 0.0, 0.0, False, True),
    "force_force": Variant(0.0, 1.0, 1.0, 0.0, False, False),
}
"""Variants of the four-channel architecture, by what goes forward and comes back."""


@dataclass(kw_only=True, eq=False)
class LocalController:
    """C = damping + stiffness / s of a four-channel station."""

    # N s/m, >= 0. Null: 2 M w with the mass M of the handle and the bandwidth w, which
    # is critical; 0 at a station to which no motion comes. Equal at both stations, so
    # that a lasting force arrives as it was sent.
    damping: np.ndarray | float | None = None
    # N/m, >= 0. Null: M w^2; 0 at a station to which no motion comes.
    stiffness: np.ndarray | float | None = None


@dataclass(frozen=True, kw_only=True)
class ResolvedLocalController:
    """The same with every number: damping in N s/m, stiffness in N/m, (n, n) each."""

    damping: Array
    stiffness: Array


@dataclass(frozen=True, kw_only=True)
class FourChannel:
    """Every number; see FourChannelConfig for what they are."""

    master_mass: Array
    master_damping: Array
    slave_mass: Array
    slave_damping: Array
    bandwidth: float
    C_m: ResolvedLocalController
    C_s: ResolvedLocalController
    C1: float
    C2: float
    C3: float
    C4: float
    C5: float
    C6: float
    acceleration_bandwidth: float | None


@dataclass(kw_only=True, eq=False)
class FourChannelConfig(ArchitectureConfig):
    """Lawrence's architecture; see architectures.four_channel_master."""

    kind = "four_channel"
    _GAINS: ClassVar[tuple[str, ...]] = (
        "master_damping",
        "slave_mass",
        "slave_damping",
    )

    # One of FOUR_CHANNEL_VARIANTS. It decides what null means in C1 to C4.
    variant: str = "four_channel"
    # Mass of the handle, kg, > 0. Assumed: that of the slider (thesis eq. 2.12).
    master_mass: np.ndarray | float = 0.5
    # Damping of the handle, N s/m, >= 0. Assumed: that of the slider.
    master_damping: np.ndarray | float = 0.1
    # Mass in the model of the robot, kg, >= 0. Null: the apparent mass at the start.
    slave_mass: np.ndarray | float | None = None
    # Damping in the model of the robot, N s/m, >= 0, which C1 compensates. Null: the
    # robot's own in four_channel, none in the other variants.
    slave_damping: np.ndarray | float | None = None
    # w of the local controllers, rad/s, > 0. Null: 1 / (T_f + T_r), at which the round
    # trip turns the phase by 1 rad, but at most the fastest pole of the haptic device.
    bandwidth: float | None = None
    # C_m and C_s.
    C_m: LocalController = field(default_factory=LocalController)
    C_s: LocalController = field(default_factory=LocalController)
    # Motion forward and back, in units of the ideal Z_s + C_s and -(Z_m + C_m).
    C1: float | None = None
    C4: float | None = None
    # Force back and forward.
    C2: float | None = None
    C3: float | None = None
    # Local force at the slave and at the master. Null: C3 - 1 and C2 - 1 where that
    # force is exchanged, which transparency needs, else 0.
    C5: float | None = None
    C6: float | None = None
    # Corner of the filters that measure accelerations for C1 and C4, rad/s, > 0. Null:
    # without accelerations, as Lawrence has it in practice.
    acceleration_bandwidth: float | None = None

    @property
    def has_gains_of_delay(self) -> bool:
        """Whether the bandwidth derives from the nominal delays."""
        return self.bandwidth is None

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field for itself.

        Args:
            path: The config's place in a scenario, for messages.
            num_axes: Number n of task axes.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        if self.variant not in FOUR_CHANNEL_VARIANTS:
            variants = ", ".join(FOUR_CHANNEL_VARIANTS)
            Refuse(f"{path}.variant", self.variant, f"one of {variants}")
        for key in ("master_mass", "master_damping"):
            if getattr(self, key) is None:
                Refuse(f"{path}.{key}", None, "a number or a matrix")
        CheckGain(f"{path}.master_mass", self.master_mass, num_axes, may_be_null=True)
        gains = {key: getattr(self, key) for key in self._GAINS}
        for key in ("C_m", "C_s"):
            gains[f"{key}.damping"] = getattr(self, key).damping
            gains[f"{key}.stiffness"] = getattr(self, key).stiffness
        for key, gain in gains.items():
            CheckGain(
                f"{path}.{key}", gain, num_axes, may_be_zero=True, may_be_null=True
            )
        for key in ("bandwidth", "acceleration_bandwidth"):
            if getattr(self, key) is not None:
                CheckNumber(f"{path}.{key}", getattr(self, key), "rad/s", above=0)
        for key in ("C1", "C2", "C3", "C4", "C5", "C6"):
            if getattr(self, key) is not None:
                CheckNumber(f"{path}.{key}", getattr(self, key), "")

    def Resolve(self, facts: Facts, path: str) -> FourChannel:
        """Returns the parameters with every default derived.

        Args:
            facts: What the defaults derive from.
            path: The config's place in a scenario, for messages.

        Raises:
            ScenarioError: If a default cannot be derived.
        """
        n, variant = facts.num_axes, FOUR_CHANNEL_VARIANTS[self.variant]

        def Given(value: float | None, default: float) -> float:
            return default if value is None else value

        def Exchanged(force: float) -> float:
            return force - 1 if force else 0.0

        w = self.bandwidth
        if w is None:
            w, T = facts.DevicePole(), facts.round_trip
            w = min(w, 1 / T) if T > 0 else w
        M_m = GainMatrix(self.master_mass, n)
        M_s, B_s = self.slave_mass, self.slave_damping
        if M_s is None:
            M_s = facts.Inertia(f"{path}.slave_mass")
        if B_s is None:
            B_s = 0.0
            if self.variant == "four_channel":
                B_s = facts.RobotDamping(f"{path}.slave_damping")

        def Local(given: LocalController, is_tied: bool) -> ResolvedLocalController:
            K, B = given.stiffness, given.damping
            if K is None:
                K = M_m * w**2 if is_tied else 0.0
            if B is None:
                B = 2 * M_m * w if is_tied else 0.0
            return ResolvedLocalController(
                damping=GainMatrix(B, n), stiffness=GainMatrix(K, n)
            )

        C2, C3 = Given(self.C2, variant.C2), Given(self.C3, variant.C3)
        return FourChannel(
            master_mass=M_m,
            master_damping=GainMatrix(self.master_damping, n),
            slave_mass=GainMatrix(M_s, n),
            slave_damping=GainMatrix(B_s, n),
            bandwidth=w,
            C_m=Local(self.C_m, variant.is_master_tied),
            C_s=Local(self.C_s, variant.is_slave_tied),
            C1=Given(self.C1, variant.C1),
            C2=C2,
            C3=C3,
            C4=Given(self.C4, variant.C4),
            C5=Given(self.C5, Exchanged(C3)),
            C6=Given(self.C6, Exchanged(C2)),
            acceleration_bandwidth=self.acceleration_bandwidth,
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
        # Position, velocity and force, and the acceleration where it is measured.
        num_others = 3 if numbers.acceleration_bandwidth else 2
        packet = [*start, *[0.0] * (num_others * facts.num_axes)]
        return Architecture(
            master_side=FourChannelMaster(
                mass=numbers.master_mass,
                damping=numbers.master_damping,
                local_damping=numbers.C_m.damping,
                local_stiffness=numbers.C_m.stiffness,
                C2=numbers.C2,
                C4=numbers.C4,
                C6=numbers.C6,
                start=start,
                acceleration_bandwidth=numbers.acceleration_bandwidth,
            ),
            slave_side=FourChannelSlave(
                mass=numbers.slave_mass,
                damping=numbers.slave_damping,
                local_damping=numbers.C_s.damping,
                local_stiffness=numbers.C_s.stiffness,
                C1=numbers.C1,
                C3=numbers.C3,
                C5=numbers.C5,
                start=start,
                acceleration_bandwidth=numbers.acceleration_bandwidth,
            ),
            initial_forward_packet=packet,
            initial_return_packet=packet,
        )

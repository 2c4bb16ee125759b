"""Lawrence's architecture: position and force travel both ways.

Both sides and the config are one kind, so they stand together, in more than 600 lines.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import BasicVector

from teleop_drake.architectures.base import Architecture, ArchitectureConfig
from teleop_drake.architectures.facts import Facts
from teleop_drake.kernel import Kernel, KernelBlock
from teleop_drake.laws.four_channel import (
    filtered_acceleration,
    master_packet,
    master_rate,
    slave_force,
    slave_packet,
)
from teleop_drake.validation import (
    CheckGain,
    CheckNumber,
    FixedFields,
    GainField,
    GainMatrix,
    Number,
    Refuse,
)


class FourChannelMaster(KernelBlock):
    """A handle with mass that sends and gets motion and force.

        Z_m V_m = F_h (1 + C6) - C_m V_m - C2 F_e - C4 V_s
        Z_m = M s + B,   C_m = B_c + K_c / s,   C4 = -c4 (Z_m + C_m)

    F_e and V_s are the slave's, as they arrive. The acceleration in C4 is that which
    the slave sends, or none. Positions count from `start`. The
    operator feels the environment itself, Z_to = Z_e, if there is no delay, c4 = 1,
    C2 = 1 + C6 and the slave has c1 = 1 and C3 = 1 + C5.

    Sources: D. A. Lawrence, "Stability and transparency in bilateral teleoperation",
    IEEE Trans. Robotics and Automation 9 (1993); with C5 and C6, K. Hashtrudi-Zaad and
    S. E. Salcudean, "Transparency in time-delayed systems and the effect of local force
    feedback for transparent teleoperation", ibid. 18 (2002).

    | port | name             | size  | unit               | is                       |
    |------|------------------|-------|--------------------|--------------------------|
    | in   | haptic_force     | n     | N                  | F_h                      |
    | in   | velocity_command | n     | m/s                | ignored                  |
    | in   | return_packet    | 3n, 4n | [m; m/s; N; m/s^2] | [p_WT; v; F_e; a] of the |
    |      |                  |       |                    | slave                    |
    | out  | felt_position    | n     | m                  | p_WT as received         |
    | out  | felt_velocity    | n     | m/s                | v_m                      |
    | out  | forward_packet   | 3n, 4n | [m; m/s; N; m/s^2] | [x_m; v_m; F_h; a_m]     |

    The accelerations are there if there is an `acceleration_bandwidth` w:
    a_m = w (v_m - v_f), dv_f/dt = a_m.

    State (continuous): [x_m (n), v_m (n), and v_f (n) if there are accelerations].

    Initial value: x_m = start, all else 0.

    Direct feedthrough: haptic_force to forward_packet, return_packet to felt_position.

    Nothing in it accounts for the delay, under which its ideal gains are not passive.

    Args:
        mass: M in kg (n, n), symmetric positive definite.
        damping: B in N s/m (n, n), symmetric, not negative.
        local_damping: B_c in N s/m (n, n), symmetric, not negative.
        local_stiffness: K_c in N/m (n, n), symmetric, not negative.
        C2: Share of the slave's force.
        C4: c4, share of the slave's motion.
        C6: Local share of the own force.
        start: x_m at time 0 in m (n).
        acceleration_bandwidth: w in rad/s; None: no accelerations.

    Raises:
        ValueError: If a size or value is not allowed.
    """

    def __init__(
        self,
        *,
        mass: ArrayLike,
        damping: ArrayLike,
        local_damping: ArrayLike,
        local_stiffness: ArrayLike,
        C2: float,
        C4: float,
        C6: float,
        start: ArrayLike,
        acceleration_bandwidth: float | None = None,
    ):
        KernelBlock.__init__(self)
        self.set_name("four_channel_master")
        self._start = np.array(start, dtype=float)
        if self._start.ndim != 1 or not np.all(np.isfinite(self._start)):
            Refuse("start", start, "finite numbers (m)")
        n = self._n = self._start.size
        self._M = CheckGain("mass", mass, n)
        self._K = CheckGain("local_stiffness", local_stiffness, n, may_be_zero=True)
        # The device's own and the controller's act on the same velocity.
        self._B = CheckGain("damping", damping, n, may_be_zero=True) + CheckGain(
            "local_damping", local_damping, n, may_be_zero=True
        )
        self._factors = np.array([C2, C4, C6], dtype=float)
        _CheckFactors(acceleration_bandwidth, C2=C2, C4=C4, C6=C6)
        self._bandwidth = acceleration_bandwidth or 0.0
        width = 4 * n if acceleration_bandwidth else 3 * n
        self.DeclareVectorInputPort("haptic_force", n)
        self.DeclareVectorInputPort("velocity_command", n)
        self.DeclareVectorInputPort("return_packet", width)
        num_zeros = width - 2 * n
        initial = np.concatenate([self._start, np.zeros(num_zeros)])
        self.DeclareContinuousState(BasicVector(initial))
        self.DeclareOutputs(felt_position=n, felt_velocity=n, forward_packet=width)

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        n = self._n
        return Kernel(
            parameters={
                "start": self._start,
                "mass": self._M,
                "damping": self._B,
                "stiffness": self._K,
                "factors": self._factors,
                "bandwidth": self._bandwidth,
            },
            rate=(
                master_rate, "state", "haptic_force", "return_packet", "start", "mass",
                "damping", "stiffness", "factors", "bandwidth",
            ),
            outputs={
                "felt_position": ("return_packet", 0, n),
                "felt_velocity": ("state", n, 2 * n),
                "forward_packet": (
                    master_packet, "state", "haptic_force", "bandwidth"
                ),
            },
            unused=("velocity_command",),
        )  # fmt: skip


def _CheckFactors(acceleration_bandwidth: float | None, **factors: float) -> None:
    """Refuses parameters that neither end can have."""
    for name, value in factors.items():
        CheckNumber(name, value)
    if acceleration_bandwidth is not None:
        CheckNumber("acceleration_bandwidth", acceleration_bandwidth, "rad/s", above=0)


class FourChannelSlave(KernelBlock):
    """Follows the motion and the force of the master.

        F_c = C1 V_m + C3 F_h - C_s V_s - C5 F_e
        C_s = B_c + K_c / s,   C1 = c1 (Z + C_s),   Z = M s + B

    V_m and F_h are the master's, as they arrive, and Z is a model of the robot. The
    acceleration in C1 is that which the master sends, or none. Positions count from
    `start`. With an exact model and without delay, V_s = V_m and F_e = F_h if
    c1 = 1, C3 = 1 + C5 and the master has c4 = 1 and C2 = 1 + C6. FourChannelMaster
    names the sources.

    | port | name              | size  | unit               | is                      |
    |------|-------------------|-------|--------------------|-------------------------|
    | in   | forward_packet    | 3n, 4n | [m; m/s; N; m/s^2] | [x_m; v_m; F_h; a_m]    |
    | in   | tool_position     | n     | m                  | p_WT                    |
    | in   | tool_velocity     | n     | m/s                | v                       |
    | in   | environment_force | n     | N                  | F_e                     |
    | out  | control_force     | n     | N                  | F_c                     |
    | out  | return_packet     | 3n, 4n | [m; m/s; N; m/s^2] | [p_WT; v; F_e; a]       |

    The accelerations are there if there is an `acceleration_bandwidth` w:
    a = w (v - v_f), dv_f/dt = a.

    State (continuous): v_f (n) if there are accelerations, else none.

    Initial value: 0.

    Direct feedthrough: all inputs to control_force; all but forward_packet to
    return_packet.

    It does not know the robot beyond Z, and nothing in it accounts for the delay.

    Args:
        mass: M of the model in kg (n, n), symmetric, not negative.
        damping: B of the model in N s/m (n, n), symmetric, not negative.
        local_damping: B_c in N s/m (n, n), symmetric, not negative.
        local_stiffness: K_c in N/m (n, n), symmetric, not negative.
        C1: c1, share of the master's motion.
        C3: Share of the master's force.
        C5: Local share of the own force.
        start: p_WT at time 0 in m (n).
        acceleration_bandwidth: w in rad/s; None: no accelerations.

    Raises:
        ValueError: If a size or value is not allowed.
    """

    def __init__(
        self,
        *,
        mass: ArrayLike,
        damping: ArrayLike,
        local_damping: ArrayLike,
        local_stiffness: ArrayLike,
        C1: float,
        C3: float,
        C5: float,
        start: ArrayLike,
        acceleration_bandwidth: float | None = None,
    ):
        KernelBlock.__init__(self)
        self.set_name("four_channel_slave")
        self._start = np.array(start, dtype=float)
        if self._start.ndim != 1 or not np.all(np.isfinite(self._start)):
            Refuse("start", start, "finite numbers (m)")
        n = self._start.size
        self._M = CheckGain("mass", mass, n, may_be_zero=True)
        self._B = CheckGain("damping", damping, n, may_be_zero=True)
        self._B_c = CheckGain("local_damping", local_damping, n, may_be_zero=True)
        self._K_c = CheckGain("local_stiffness", local_stiffness, n, may_be_zero=True)
        self._factors = np.array([C1, C3, C5], dtype=float)
        _CheckFactors(acceleration_bandwidth, C1=C1, C3=C3, C5=C5)
        self._bandwidth = acceleration_bandwidth or 0.0
        width = 4 * n if acceleration_bandwidth else 3 * n
        self.DeclareVectorInputPort("forward_packet", width)
        for name in ("tool_position", "tool_velocity", "environment_force"):
            self.DeclareVectorInputPort(name, n)
        if acceleration_bandwidth:
            self.DeclareContinuousState(n)
        self.DeclareOutputs(control_force=n, return_packet=width)

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        rate = None
        if self.num_continuous_states() > 0:
            rate = (filtered_acceleration, "tool_velocity", "state", "bandwidth")
        return Kernel(
            parameters={
                "start": self._start,
                "mass": self._M,
                "damping": self._B,
                "local_damping": self._B_c,
                "local_stiffness": self._K_c,
                "factors": self._factors,
                "bandwidth": self._bandwidth,
            },
            rate=rate,
            outputs={
                "control_force": (
                    slave_force, "forward_packet", "tool_position", "tool_velocity",
                    "environment_force", "start", "mass", "damping", "local_damping",
                    "local_stiffness", "factors",
                ),
                "return_packet": (
                    slave_packet, "state", "tool_position", "tool_velocity",
                    "environment_force", "bandwidth",
                ),
            },
        )  # fmt: skip


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
class LocalController(FixedFields):
    """C = damping + stiffness / s of a four-channel station."""

    # N s/m, >= 0. Null: 2 M w with the mass M of the handle and the bandwidth w, which
    # is critical; 0 at a station to which no motion comes. Equal at both stations, so
    # that a lasting force arrives as it was sent.
    damping: np.ndarray | float | None = GainField(None, may_be_zero=True)
    # N/m, >= 0. Null: M w^2; 0 at a station to which no motion comes.
    stiffness: np.ndarray | float | None = GainField(None, may_be_zero=True)


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
    """Lawrence's architecture; see architectures.four_channel."""

    kind = "four_channel"
    forward_parts = ("x_m", "v_m", "F_h", "a_m")
    return_parts = ("p_WT", "v_WT", "F_e", "a_WT")
    # One of FOUR_CHANNEL_VARIANTS. It decides what null means in C1 to C4.
    variant: str = "four_channel"
    # Mass of the handle, kg, > 0. Assumed: that of the slider (thesis eq. 2.12).
    master_mass: np.ndarray | float = GainField(0.5)
    # Damping of the handle, N s/m, >= 0. Assumed: that of the slider.
    master_damping: np.ndarray | float = GainField(0.1, may_be_zero=True)
    # Mass in the model of the robot, kg, >= 0. Null: the apparent mass at the start.
    slave_mass: np.ndarray | float | None = GainField(None, may_be_zero=True)
    # Damping in the model of the robot, N s/m, >= 0, which C1 compensates. Null: the
    # robot's own in four_channel, none in the other variants.
    slave_damping: np.ndarray | float | None = GainField(None, may_be_zero=True)
    # w of the local controllers, rad/s, > 0. Null: 1 / (T_f + T_r), at which the round
    # trip turns the phase by 1 rad, but at most the fastest pole of the haptic device.
    bandwidth: float | None = Number(None, "rad/s", above=0)
    # C_m and C_s.
    C_m: LocalController = field(default_factory=LocalController)
    C_s: LocalController = field(default_factory=LocalController)
    # Motion forward and back, in units of the ideal Z_s + C_s and -(Z_m + C_m).
    C1: float | None = Number(None)
    C4: float | None = Number(None)
    # Force back and forward.
    C2: float | None = Number(None)
    C3: float | None = Number(None)
    # Local force at the slave and at the master. Null: C3 - 1 and C2 - 1 where that
    # force is exchanged, which transparency needs, else 0.
    C5: float | None = Number(None)
    C6: float | None = Number(None)
    # Corner of the filters that measure accelerations for C1 and C4, rad/s, > 0. Null:
    # without accelerations, as Lawrence has it in practice.
    acceleration_bandwidth: float | None = Number(None, "rad/s", above=0)

    @property
    def has_gains_of_delay(self) -> bool:
        """Whether the bandwidth derives from the nominal delays."""
        return self.bandwidth is None

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field for itself.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        if self.variant not in FOUR_CHANNEL_VARIANTS:
            variants = ", ".join(FOUR_CHANNEL_VARIANTS)
            Refuse(f"{path}.variant", self.variant, f"one of {variants}")
        super().Check(path, num_axes)
        self.C_m.CheckGains(f"{path}.C_m", num_axes)
        self.C_s.CheckGains(f"{path}.C_s", num_axes)

    def Resolve(self, facts: Facts, path: str) -> FourChannel:
        """Returns the parameters with every default derived.

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

"""Lawrence's four-channel architecture: motion and force are sent both ways."""

from dataclasses import field, replace
from typing import Any, ClassVar

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.validation import (
    CheckChoice,
    CheckNumber,
    Config,
    FixedFields,
    GainField,
    GainRange,
    Gains,
    Number,
    Range,
)
from teleop_drake.loops.kernel import Kernel, Term
from teleop_drake.model.blocks.architectures.base import (
    Architecture,
    CheckStart,
    Facts,
    MasterSide,
    SlaveSide,
)
from teleop_drake.model.blocks.architectures.local_damper import LocalDamperConfig
from teleop_drake.model.kinds import NumberNames
from teleop_drake.model.laws.four_channel import (
    Station,
    following_rate,
    master_rate,
    slave_force,
)

_STATION_NUMBERS = {
    "local_stiffness": GainRange("N/m", may_be_zero=True),
    "local_damping": GainRange("N s/m", may_be_zero=True),
    "damping": GainRange("N s/m", may_be_zero=True),
    "motion": Range(),
    "force": Range(),
    "local_force": Range(),
}


class FourChannelMaster(MasterSide):
    """A handle with mass that exchanges motion and force with the slave.

        (M s + B) V_m = F_h (1 + C6) - C_m V_m - C2 F_e - C4 V_s
        C_m = B_c + K_c / s,   C4 = -c4 (B + C_m)

    Against the command (see local_damper), the handle's damping B is driven by B V_d.
    F_e and V_s are those of the slave, as received. Positions are relative to `start`.
    At low frequency, where the masses are negligible, the operator feels the impedance
    of the environment, Z_to = Z_e, if there is no delay, c4 = 1, C2 = 1 + C6 and the
    slave has c1 = 1 and C3 = 1 + C5. The parameters are M, K_c, B_c, B, c4, C2 and C6,
    in the order of the table.

    Sources: D. A. Lawrence, "Stability and transparency in bilateral teleoperation",
    IEEE Trans. Robotics and Automation 9 (1993); with C5 and C6, K. Hashtrudi-Zaad and
    S. E. Salcudean, "Transparency in time-delayed systems and the effect of local force
    feedback for transparent teleoperation", ibid. 18 (2002).

    | port | name             | size  | unit               | is                       |
    |------|------------------|-------|--------------------|--------------------------|
    | in   | haptic_force     | n     | N                  | F_h                      |
    | in   | velocity_command | n     | m/s                | v_d or ignored           |
    | in   | return_packet    | 3n    | [m; m/s; N]        | [p_WT; v; F_e] of slave  |
    | out  | felt_position    | n     | m                  | p_WT as received         |
    | out  | felt_velocity    | n     | m/s                | v_m                      |
    | out  | forward_packet   | 3n    | [m; m/s; N]        | [x_m; v_m; F_h]          |

    | parameter | name            | unit  |
    |-----------|-----------------|-------|
    | 0         | mass            | kg    |
    | 1         | local_stiffness | N/m   |
    | 2         | local_damping   | N s/m |
    | 3         | damping         | N s/m |
    | 4         | motion          | -     |
    | 5         | force           | -     |
    | 6         | local_force     | -     |

    State (continuous): [x_m (n), v_m (n)].

    Initial value: x_m = start, v_m = 0.

    Direct feedthrough: haptic_force to forward_packet, return_packet to felt_position.

    The law does not account for the delay, with which its ideal gains are not passive.

    Args:
        config: The config without nulls, as returned by Resolve().
        start: x_m at time 0 in m (n).
    """

    numeric_parameters: ClassVar = {"mass": GainRange("kg"), **_STATION_NUMBERS}

    def __init__(self, config: "FourChannelConfig", *, start: ArrayLike):
        station = config.MakeStation("master", start)
        n = station.start.size
        arguments = ("station", "mass", "state", "haptic_force", "return_packet")
        rate: Term = (master_rate, *arguments)
        if config.follows_command:
            rate = (following_rate, *arguments, "velocity_command")
        MasterSide.__init__(
            self,
            "four_channel_master",
            Kernel(
                parameters={"station": station, "mass": config.Gain("master_mass", n)},
                rate=rate,
                outputs={
                    "felt_position": ("return_packet", 0, n),
                    "felt_velocity": ("state", n, 2 * n),
                    "forward_packet": ["state", "haptic_force"],
                },
            ),
            n,
            forward_packet=3 * n,
            return_packet=3 * n,
            state=[*station.start, *[0.0] * n],
        )  # fmt: skip


class FourChannelSlave(SlaveSide):
    """Follows the motion and the force of the master.

        F_c = C1 V_m + C3 F_h - C_s V_s - C5 F_e
        C_s = B_c + K_c / s,   C1 = c1 (B + C_s)

    V_m and F_h are those of the master, as received. B is the damping in the model of
    the robot. Positions are relative to `start`. At low frequency and without delay,
    V_s = V_m and F_e = F_h if c1 = 1, C3 = 1 + C5 and the master has c4 = 1 and
    C2 = 1 + C6. The parameters are K_c, B_c, B, c1, C3 and C5, in the order of the
    table. See FourChannelMaster for the sources.

    | port | name              | size  | unit               | is                      |
    |------|-------------------|-------|--------------------|-------------------------|
    | in   | forward_packet    | 3n    | [m; m/s; N]        | [x_m; v_m; F_h]         |
    | in   | tool_position     | n     | m                  | p_WT                    |
    | in   | tool_velocity     | n     | m/s                | v                       |
    | in   | environment_force | n     | N                  | F_e                     |
    | out  | control_force     | n     | N                  | F_c                     |
    | out  | return_packet     | 3n    | [m; m/s; N]        | [p_WT; v; F_e]          |

    | parameter | name            | unit  |
    |-----------|-----------------|-------|
    | 0         | local_stiffness | N/m   |
    | 1         | local_damping   | N s/m |
    | 2         | damping         | N s/m |
    | 3         | motion          | -     |
    | 4         | force           | -     |
    | 5         | local_force     | -     |

    State: none.

    Direct feedthrough: all inputs to control_force; all but forward_packet to
    return_packet.

    B is its only model of the robot. The law does not account for the delay.

    Args:
        config: The config without nulls, as returned by Resolve().
        start: p_WT at time 0 in m (n).
    """

    numeric_parameters: ClassVar = _STATION_NUMBERS

    def __init__(self, config: "FourChannelConfig", *, start: ArrayLike):
        station = config.MakeStation("slave", start)
        n = station.start.size
        tool = ("tool_position", "tool_velocity", "environment_force")
        SlaveSide.__init__(
            self,
            "four_channel_slave",
            Kernel(
                parameters={"station": station},
                outputs={
                    "control_force": (slave_force, "station", "forward_packet", *tool),
                    "return_packet": [*tool],
                },
            ),
            n,
            forward_packet=3 * n,
            return_packet=3 * n,
        )


FOUR_CHANNEL_VARIANTS = {
    # C1, C2, C3, C4.
    "four_channel": (1.0, 1.0, 1.0, 1.0),
    "position_position": (1.0, 0.0, 0.0, 1.0),
    "position_force": (1.0, 1.0, 0.0, 0.0),
    "force_force": (0.0, 1.0, 1.0, 0.0),
}
"""Variants of the architecture, named by the signals sent forward and back."""


# The fields of each end: its local controller, and the shares of the other end's
# motion, of the other end's force and of the local force.
_ENDS = {"master": ("C_m", "C4", "C2", "C6"), "slave": ("C_s", "C1", "C3", "C5")}


@Config
class LocalController(FixedFields):
    """C = damping + stiffness / s of a four-channel station."""

    # N s/m, >= 0. Null: 2 M w with the mass M of the handle and the bandwidth w, which
    # is critical damping; 0 at a station that receives no motion in the variant. It is
    # equal at both stations, so that a constant force is transmitted unchanged.
    damping: Gains | None = GainField(None, may_be_zero=True)
    # N/m, >= 0. Null: M w^2; 0 at a station that receives no motion in the variant.
    stiffness: Gains | None = GainField(None, may_be_zero=True)

    def Derived(self, mass: Any, bandwidth: float, num_axes: int) -> "LocalController":
        """Returns the controller without nulls; see the fields.

        Args:
            mass: M in kg, a number or (n, n).
            bandwidth: w in rad/s; 0: the station receives no motion.
            num_axes: n, number of task axes.
        """
        derived = replace(self)
        if self.damping is None:
            derived.damping = 2 * mass * bandwidth
        if self.stiffness is None:
            derived.stiffness = mass * bandwidth**2
        derived.MakeMatrices(num_axes)
        return derived


@Config
class FourChannelConfig(LocalDamperConfig):
    """Lawrence's architecture; see architectures.four_channel."""

    kind = "four_channel"
    forward_parts = ("x_m", "v_m", "F_h")
    return_parts = ("p_WT", "v_WT", "F_e")
    # One of FOUR_CHANNEL_VARIANTS, which has the values of C1 to C4 if these are null.
    variant: str = "four_channel"
    # Mass of the handle, kg, > 0. Assumed: that of the slider (thesis eq. 2.12).
    master_mass: Gains = GainField(0.5)
    # Damping of the handle, N s/m, >= 0, against the ground or the command. Assumed:
    # that of the slider.
    master_damping: Gains = GainField(0.1, may_be_zero=True)
    # Damping in the model of the robot, N s/m, >= 0, which C1 compensates. Null: the
    # robot's own damping in the variant four_channel, 0 in the others.
    slave_damping: Gains | None = GainField(None, may_be_zero=True)
    # w of the local controllers, rad/s, > 0. Null: 1 / (T_f + T_r), at which the phase
    # lag of the round trip is 1 rad, but at most the fastest pole of the haptic device.
    bandwidth: float | None = Number(None, "rad/s", above=0)
    # Local controllers of the master and of the slave.
    C_m: LocalController = field(default_factory=LocalController)
    C_s: LocalController = field(default_factory=LocalController)
    # Gains on the motion sent forward and back, in units of B_s + C_s and -(B_m + C_m).
    # Null: those of the variant.
    C1: float | None = Number(None)
    C4: float | None = Number(None)
    # Gains on the force sent back and forward. Null: those of the variant.
    C2: float | None = Number(None)
    C3: float | None = Number(None)
    # Gains on the local force at the slave and at the master. Null: C3 - 1 and C2 - 1
    # if that force is exchanged, as transparency requires; otherwise 0.
    C5: float | None = Number(None)
    C6: float | None = Number(None)

    @property
    def has_gains_of_delay(self) -> bool:
        """Whether the bandwidth derives from the nominal delays."""
        return self.bandwidth is None

    def Check(self, path: str, num_axes: int) -> None:
        """Checks each field, also those of the local controllers."""
        CheckChoice(f"{path}.variant", self.variant, FOUR_CHANNEL_VARIANTS)
        super().Check(path, num_axes)
        self.C_m.CheckGains(f"{path}.C_m", num_axes)
        self.C_s.CheckGains(f"{path}.C_s", num_axes)

    def Numbers(self) -> NumberNames:
        """Returns the names of fields in the Contexts of blocks; see KindConfig."""
        return {
            "bandwidth": (),
            "master_mass": ("master.mass",),
            "master_damping": ("master.damping",),
            "slave_damping": ("controller.damping",),
            "C_m.damping": ("master.local_damping",),
            "C_m.stiffness": ("master.local_stiffness",),
            "C_s.damping": ("controller.local_damping",),
            "C_s.stiffness": ("controller.local_stiffness",),
        }

    def DeriveDefaults(self, facts: Facts) -> None:
        """Derives the fields that are null; see ArchitectureConfig.DeriveDefaults."""
        # The variant determines the signals that are exchanged, and with them the gains
        # on the local forces.
        C1, C2, C3, C4 = FOUR_CHANNEL_VARIANTS[self.variant]
        if self.C1 is None:
            self.C1 = C1
        if self.C2 is None:
            self.C2 = C2
        if self.C3 is None:
            self.C3 = C3
        if self.C4 is None:
            self.C4 = C4
        if self.C5 is None:
            self.C5 = self.C3 - 1 if self.C3 else 0.0
        if self.C6 is None:
            self.C6 = self.C2 - 1 if self.C2 else 0.0
        if self.slave_damping is None:
            self.slave_damping = 0.0
            if self.variant == "four_channel":
                self.slave_damping = facts.Told("robot_damping", "slave_damping")
        # At the bandwidth, the phase lag of the round trip is at most 1 rad.
        if self.bandwidth is None:
            self.bandwidth = facts.DevicePole()
            T = facts.round_trip
            if T > 0:
                self.bandwidth = min(self.bandwidth, 1 / T)
        # The local controllers are critically damped at that bandwidth.
        n = facts.num_axes
        self.C_m = self.C_m.Derived(self.master_mass, self.bandwidth if C4 else 0.0, n)
        self.C_s = self.C_s.Derived(self.master_mass, self.bandwidth if C1 else 0.0, n)

    def MakeStation(self, end: str, start: ArrayLike) -> Station:
        """Returns the parameters of one end, `master` or `slave`; refuses bad ones."""
        start = CheckStart(start)
        n = start.size
        local, *factors = (getattr(self, name) for name in _ENDS[end])
        for name, factor in zip(_ENDS[end][1:], factors, strict=True):
            CheckNumber(name, factor)
        of_local = (local.Gain(name, n) for name in ("damping", "stiffness"))
        damping = self.Gain(f"{end}_damping", n)
        return Station._make((damping, *of_local, start, *factors))

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides."""
        config = self.Resolve(facts, path)
        start: list[float] = facts.start.tolist()
        packet = [*start, *[0.0] * (2 * facts.num_axes)]  # At rest, without force.
        return Architecture(
            master_side=FourChannelMaster(config, start=start),
            slave_side=FourChannelSlave(config, start=start),
            initial_forward_packet=packet,
            initial_return_packet=packet,
            forward_fields=("position", "velocity", "force"),
            return_fields=("position", "velocity", "force"),
        )

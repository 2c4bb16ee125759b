"""P+d: position-position control with a spring and damping injection."""

import math
from typing import ClassVar

import numpy as np

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.validation import (
    Config,
    GainField,
    GainMatrix,
    GainRange,
    Gains,
    Number,
    Refuse,
)
from teleop_drake.loops.kernel import Kernel
from teleop_drake.model.blocks.architectures.base import (
    Architecture,
    CheckStart,
    Facts,
    MasterSide,
    SlaveSide,
)
from teleop_drake.model.blocks.architectures.local_damper import (
    BrakedVelocity,
    DrivenForce,
    LocalDamperConfig,
)
from teleop_drake.model.kinds import NumberNames
from teleop_drake.model.laws.proportional import (
    coupling_force,
    master_rate,
    slave_force,
)


class ProportionalMaster(MasterSide):
    """A damped handle with mass, coupled to the delayed tool position by a spring.

        M dv_m/dt = F_h - K (x_m - x_s) - B v_m,   dx_m/dt = v_m

    with x_s = p_WT(t - T_r). With the slave F_c = K (x_m(t - T_f) - p_WT) - B_s v
    (ProportionalSlave) the pair is stable for 4 B B_s > (T_f + T_r)^2 K^2. Against the
    command (see local_damper) v_m - v_d takes the place of v_m in the damper, and the
    packet also carries v_d.

    Sources: D. Lee and M. W. Spong, "Passive bilateral teleoperation with constant time
    delay", IEEE Trans. Robotics 22 (2006); E. Nuno, L. Basanez and R. Ortega,
    "Passivity-based control for bilateral teleoperation: a tutorial", Automatica 47
    (2011), where this is P+d.

    | port | name             | size | unit | is                    |
    |------|------------------|------|------|-----------------------|
    | in   | haptic_force     | n    | N    | F_h                   |
    | in   | velocity_command | n    | m/s  | v_d or ignored        |
    | in   | return_packet    | n    | m    | x_s                   |
    | out  | felt_position    | n    | m    | x_s                   |
    | out  | felt_velocity    | n    | m/s  | v_m                   |
    | out  | forward_packet   | n, 2n | m   | x_m or [x_m; v_d]     |
    | out  | coupling_force   | n    | N    | K (x_m - x_s)         |

    | parameter | name      | unit  |
    |-----------|-----------|-------|
    | 0         | mass      | kg    |
    | 1         | stiffness | N/m   |
    | 2         | damping   | N s/m |

    State (continuous): [x_m (n), v_m (n)].

    Initial value: x_m = start, v_m = 0.

    Direct feedthrough: return_packet to felt_position and coupling_force; against the
    command, velocity_command to forward_packet.

    It compensates neither the mass nor the damping: the operator feels both.

    Args:
        config: The config without nulls, as returned by Resolve().
        start: x_m at time 0 in m (n).
    """

    numeric_parameters: ClassVar = {
        "mass": GainRange("kg"),
        "stiffness": GainRange("N/m", may_be_zero=True),
        "damping": GainRange("N s/m", may_be_zero=True),
    }

    def __init__(self, config: "ProportionalDampingConfig", *, start: ArrayLike):
        start = CheckStart(start)
        n = start.size
        follows = config.follows_command
        MasterSide.__init__(
            self,
            "proportional_master",
            Kernel(
                parameters={
                    "mass": config.Gain("master_mass", n),
                    "stiffness": config.Gain("stiffness", n),
                    "damping": config.Gain("master_damping", n),
                },
                rate=(
                    master_rate, "state", "force", "return_packet", "mass",
                    "stiffness", "damping",
                ),
                outputs={
                    "force": DrivenForce(
                        config.against, "haptic_force", "velocity_command", "damping"
                    ),
                    "felt_position": "return_packet",
                    "felt_velocity": ("state", n, 2 * n),
                    "forward_packet": (
                        [("state", 0, n), "velocity_command"]
                        if follows
                        else ("state", 0, n)
                    ),
                    "coupling_force": (
                        coupling_force, ("state", 0, n), "return_packet", "stiffness"
                    ),
                },
                sizes={"force": n},
            ),
            n,
            forward_packet=2 * n if follows else n,
            return_packet=n,
            state=[*start, *[0.0] * n],
        )  # fmt: skip


class ProportionalSlave(SlaveSide):
    """Couples the tool to the delayed master position by a spring, and damps it.

        F_c = K (x_m - p_WT) - B v

    with x_m as received, x_m(t - T_f). Against the command (see local_damper), the
    damper brakes v - v_d with v_d as received. See ProportionalMaster for the master,
    the sources and the condition of stability.

    | port | name              | size | unit | is      |
    |------|-------------------|------|------|---------|
    | in   | forward_packet    | n, 2n | m   | x_m or [x_m; v_d] |
    | in   | tool_position     | n    | m    | p_WT    |
    | in   | tool_velocity     | n    | m/s  | v       |
    | in   | environment_force | n    | N    | ignored |
    | out  | control_force     | n    | N    | F_c     |
    | out  | return_packet     | n    | m    | p_WT    |

    | parameter | name      | unit  |
    |-----------|-----------|-------|
    | 0         | stiffness | N/m   |
    | 1         | damping   | N s/m |

    State: none.

    Direct feedthrough: all inputs but environment_force to control_force; tool_position
    to return_packet.

    It has no integral action: a constant force leaves a position error.

    Args:
        config: The config without nulls, as returned by Resolve().
    """

    numeric_parameters: ClassVar = {
        "stiffness": GainRange("N/m", may_be_zero=True),
        "damping": GainRange("N s/m", may_be_zero=True),
    }

    def __init__(self, config: "ProportionalDampingConfig", *, num_axes: int):
        n = num_axes
        follows = config.follows_command
        SlaveSide.__init__(
            self,
            "proportional_slave",
            Kernel(
                parameters={
                    "stiffness": config.Gain("stiffness", n),
                    "damping": config.Gain("slave_damping", n),
                },
                outputs={
                    "braked_velocity": BrakedVelocity(
                        config.against, "tool_velocity", ("forward_packet", n, 2 * n)
                    ),
                    "control_force": (
                        slave_force, ("forward_packet", 0, n), "tool_position",
                        "braked_velocity", "stiffness", "damping",
                    ),
                    "return_packet": "tool_position",
                },
                sizes={"braked_velocity": n},
            ),
            n,
            forward_packet=2 * n if follows else n,
            return_packet=n,
        )  # fmt: skip


@Config
class ProportionalDampingConfig(LocalDamperConfig):
    """P+d; see architectures.proportional_damping.ProportionalMaster."""

    kind = "proportional_damping"
    forward_parts = ("x_m",)
    return_parts = ("p_WT",)

    # Mass of the handle, kg, > 0. Assumed: that of the slider (thesis eq. 2.12).
    master_mass: Gains = GainField(0.5)
    # B_m, damping of the handle, N s/m, >= 0. Null: the resistance of the haptic device
    # at low frequency, so that the handle adds as much damping as the device has.
    master_damping: Gains | None = GainField(None, may_be_zero=True)
    # B_s, damping of the tool, N s/m, >= 0. Null: B_m.
    slave_damping: Gains | None = GainField(None, may_be_zero=True)
    # Factor by which 4 B_m B_s exceeds the limit of stability, > 1. It determines the
    # stiffness if that is null: 4 B_m B_s = margin (T_f + T_r)^2 K^2. Assumed.
    margin: float = Number(2.0, above=1)
    # K, N/m, >= 0. Null: from the margin and the nominal delays, with the smallest
    # eigenvalues of the dampings, but at most K = M |p|^2, which makes the handle as
    # fast as the fastest pole p of the haptic device.
    stiffness: Gains | None = GainField(None, may_be_zero=True)

    @property
    def has_gains_of_delay(self) -> bool:
        """Whether the stiffness derives from the nominal delays."""
        return self.stiffness is None

    def Numbers(self) -> NumberNames:
        """Returns the names of fields in the Contexts of blocks; see KindConfig."""
        return {
            "margin": (),
            "master_mass": ("master.mass",),
            "master_damping": ("master.damping",),
            "slave_damping": ("controller.damping",),
            "stiffness": ("master.stiffness", "controller.stiffness"),
        }

    def DeriveDefaults(self, facts: Facts) -> None:
        """Derives the fields that are null; see ArchitectureConfig.DeriveDefaults."""
        if self.master_damping is None:
            self.master_damping = facts.OperatorResistance("master_damping")
        if self.slave_damping is None:
            self.slave_damping = self.master_damping
        if self.stiffness is not None:
            return
        n = facts.num_axes
        mass, B_m, B_s = (
            float(np.linalg.eigvalsh(GainMatrix(gain, n))[0])
            for gain in (self.master_mass, self.master_damping, self.slave_damping)
        )
        stiffness = mass * facts.DevicePole() ** 2
        T = facts.round_trip
        if T > 0:
            stiffness = min(stiffness, math.sqrt(4 * B_m * B_s / self.margin) / T)
        if not stiffness > 0:
            Refuse(
                "stiffness",
                None,
                "a number, because the dampings or the poles of haptic_device are 0",
            )
        self.stiffness = stiffness

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides."""
        config = self.Resolve(facts, path)
        start: list[float] = facts.start.tolist()
        follows = config.follows_command
        return Architecture(
            master_side=ProportionalMaster(config, start=start),
            slave_side=ProportionalSlave(config, num_axes=len(start)),
            initial_forward_packet=[*start, *[0.0] * len(start)] if follows else start,
            initial_return_packet=start,
            forward_fields=("position", "velocity") if follows else ("position",),
            return_fields=("position",),
        )

"""Wave variables: the channels carry waves, and stay passive under constant delays."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.validation import (
    CheckNumber,
    Config,
    GainField,
    GainRange,
    Gains,
    Number,
    Range,
    Refuse,
)
from teleop_drake.loops.kernel import Kernel, times
from teleop_drake.model.blocks.architectures.base import (
    Architecture,
    CheckStart,
    Facts,
    MasterSide,
    SlaveSide,
)
from teleop_drake.model.blocks.architectures.local_damper import (
    DrivenForce,
    LocalDamperConfig,
)
from teleop_drake.model.kinds import NumberNames
from teleop_drake.model.laws.wave_variables import (
    line_power,
    master_velocity,
    passive_scaling,
    reflected_wave,
    slave_force,
    wave_root,
)


class WaveMaster(MasterSide):
    """Computes the felt velocity and the forward wave from force and returning wave.

        v_m = (b + D)^-1 (F + (2 b)^(1/2) w),   F = F_h or F_h + D v_d
        u   = (2 b)^(1/2) v_m - w

    with the wave impedance b, a damper D in parallel with the line, against the ground
    or the command (see local_damper), and the wave as received times the scaling, w.
    The force on the line is F - D v_m. With D = b, u does not depend on w: no wave is
    reflected at this end. The law is `teleop_drake.model.laws.wave_variables`.

    | port | name             | size | unit          | is                         |
    |------|------------------|------|---------------|----------------------------|
    | in   | haptic_force     | n    | N             | F_h                        |
    | in   | velocity_command | n    | m/s           | v_d, ignored on the ground |
    | in   | return_packet    | 2n   | [W^(1/2); m]  | [w; p_WT] of WaveSlave     |
    | out  | felt_position    | n    | m             | p_WT as received           |
    | out  | felt_velocity    | n    | m/s           | v_m                        |
    | out  | forward_packet   | 2n   | [W^(1/2); m]  | [u; x_m]                   |
    | out  | master_position  | n    | m             | x_m, integral of v_m       |
    | out  | master_power     | n    | W             | (F - D v_m) v_m per axis   |

    | parameter | name      | unit  |
    |-----------|-----------|-------|
    | 0         | impedance | N s/m |
    | 1         | damping   | N s/m |
    | 2         | scaling   | -     |

    State (continuous): x_m (n). With six axes its last three entries are the integral
    of an angular velocity. They are no rotation vector, and are not used.

    Initial value: start.

    Direct feedthrough: haptic_force to felt_velocity, forward_packet and master_power;
    return_packet to felt_position, felt_velocity, master_power and, unless D = b,
    forward_packet. Against the command, velocity_command as haptic_force.

    It uses neither the delay nor an energy: only the line as a whole is passive. The
    position that the operator feels is the tool's as received, not x_m.

    Args:
        config: The config with all defaults derived, as returned by Resolve().
        start: x_m at time 0 in m (n).
    """

    numeric_parameters: ClassVar = {
        "impedance": GainRange("N s/m"),
        "damping": GainRange("N s/m", may_be_zero=True),
        "scaling": Range(above=0, maximum=1),
    }

    def __init__(self, config: "WaveVariablesConfig", *, start: ArrayLike):
        start = CheckStart(start)
        n = start.size
        b = config.Gain("impedance", n)
        D = config.Gain("master_damping", n)
        CheckNumber("return_scaling", config.return_scaling, above=0, maximum=1)
        is_matched = IsMatched(D, b)
        # If no wave is reflected, the outgoing wave must not depend on the arriving one
        # even formally: without delay, that would be an algebraic loop.
        seen = "nothing" if is_matched else "received"
        self._is_matched = is_matched
        MasterSide.__init__(
            self,
            "wave_master",
            Kernel(
                parameters={
                    "scaling": config.return_scaling,
                    "impedance": b,
                    "damping": D,
                    "nothing": np.zeros(n),
                },
                derived={"root": (wave_root, "impedance")},
                rate="velocity",
                outputs={
                    "received": (times, ("return_packet", 0, n), "scaling"),
                    "force": DrivenForce(
                        config.against, "haptic_force", "velocity_command", "damping"
                    ),
                    "velocity": (
                        master_velocity, "force", "received", "root", "damping"
                    ),
                    "felt_position": ("return_packet", n, 2 * n),
                    "felt_velocity": "velocity",
                    "own_velocity": (
                        master_velocity, "force", seen, "root", "damping"
                    ),
                    "reflected": (reflected_wave, "own_velocity", seen, "root"),
                    "forward_packet": ["reflected", "state"],
                    "master_position": "state",
                    "master_power": (line_power, "force", "velocity", "damping"),
                },
                sizes=dict.fromkeys(
                    ("received", "force", "velocity", "own_velocity", "reflected"), n
                ),
            ),
            n,
            forward_packet=2 * n,
            return_packet=2 * n,
            state=start.tolist(),
        )  # fmt: skip

    def CheckParameters(self, values: Mapping[str, Any]) -> None:
        """Refuses a damper that reflects waves if none was reflected at first.

        The outgoing wave does not depend on the arriving one then; see KernelBlock.
        """
        if self._is_matched and not IsMatched(values["damping"], values["impedance"]):
            allowed = "equal to impedance, as it was when the block was made"
            Refuse("damping", values["damping"], allowed)


def IsMatched(damping: Array, impedance: Array) -> bool:
    """Returns whether a damper at the end of a line of waves reflects none of them."""
    return np.allclose(damping, impedance, rtol=1e-12, atol=0)


class WaveSlave(SlaveSide):
    """Computes the force and the returning wave from arriving wave and velocity.

        F_c = (2 b)^(1/2) u - b v
        w   = (2 b)^(1/2) v - u

    with the wave impedance b and the wave as received times the scaling, u. The tool's
    position is the integral of a velocity that the waves transmit: if waves are lost,
    it drifts away from x_m. The law is `teleop_drake.model.laws.wave_variables`.

    | port | name              | size | unit         | is                        |
    |------|-------------------|------|--------------|---------------------------|
    | in   | forward_packet    | 2n   | [W^(1/2); m] | [u; x_m] of WaveMaster    |
    | in   | tool_position     | n    | m            | p_WT                      |
    | in   | tool_velocity     | n    | m/s          | v                         |
    | in   | environment_force | n    | N            | ignored                   |
    | out  | control_force     | n    | N            | F_c                       |
    | out  | return_packet     | 2n   | [W^(1/2); m] | [w; p_WT]                 |
    | out  | slave_power       | n    | W            | F_c v per axis            |

    | parameter | name      | unit  |
    |-----------|-----------|-------|
    | 0         | impedance | N s/m |
    | 1         | scaling   | -     |

    State: none.

    Direct feedthrough: tool_velocity and forward_packet to all outputs; tool_position
    to return_packet.

    Args:
        config: The config with all defaults derived, as returned by Resolve().
    """

    numeric_parameters: ClassVar = {
        "impedance": GainRange("N s/m"),
        "scaling": Range(above=0, maximum=1),
    }

    def __init__(self, config: "WaveVariablesConfig", *, num_axes: int):
        n = num_axes
        CheckNumber("forward_scaling", config.forward_scaling, above=0, maximum=1)
        SlaveSide.__init__(
            self,
            "wave_slave",
            Kernel(
                parameters={
                    "scaling": config.forward_scaling,
                    "impedance": config.Gain("impedance", n),
                },
                derived={"root": (wave_root, "impedance")},
                outputs={
                    "received": (times, ("forward_packet", 0, n), "scaling"),
                    "control_force": (slave_force, "tool_velocity", "received", "root"),
                    "reflected": (reflected_wave, "tool_velocity", "received", "root"),
                    "return_packet": ["reflected", "tool_position"],
                    "slave_power": (times, "control_force", "tool_velocity"),
                },
                sizes=dict.fromkeys(("received", "reflected"), n),
            ),
            n,
            forward_packet=2 * n,
            return_packet=2 * n,
        )


@Config
class WaveVariablesConfig(LocalDamperConfig):
    """The wave line; see architectures.wave_variables.WaveMaster."""

    kind = "wave_variables"
    forward_parts = ("u", "x_m")
    return_parts = ("w", "p_WT")

    # b, wave impedance, N s/m, > 0. Null: matched to the operator, whose force is
    # H = K/s + b + O(s) at low frequency: b is the resistance of the haptic device.
    impedance: Gains | None = GainField(None)
    # Damper at the master's end of the line, N s/m, >= 0. Null: b, which absorbs the
    # returning wave whatever the operator does; 0 is the bare line.
    master_damping: Gains | None = GainField(None, may_be_zero=True)
    # Factor on the arriving forward wave, > 0 to 1. Null: sqrt(1 - largest dT/dt) if
    # the delay of the channel grows, which keeps the channel passive; otherwise 1.
    forward_scaling: float | None = Number(None, above=0, maximum=1)
    # Factor on the arriving returning wave, > 0 to 1. Null: as for the forward wave.
    return_scaling: float | None = Number(None, above=0, maximum=1)

    def Numbers(self) -> NumberNames:
        """Returns the names of fields in the Contexts of blocks; see KindConfig."""
        # A damper that is matched to the impedance makes another block.
        return {
            "forward_scaling": ("controller.scaling",),
            "return_scaling": ("master.scaling",),
        }

    def DeriveDefaults(self, facts: Facts) -> None:
        """Derives the fields that are null; see ArchitectureConfig.DeriveDefaults."""
        if self.impedance is None:
            self.impedance = facts.OperatorResistance("impedance")
        if self.master_damping is None:
            self.master_damping = self.impedance
        if self.forward_scaling is None:
            slope = facts.forward_channel.LargestSlope(facts.duration)
            self.forward_scaling = passive_scaling(slope)
        if self.return_scaling is None:
            slope = facts.return_channel.LargestSlope(facts.duration)
            self.return_scaling = passive_scaling(slope)

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides; refuses waves that form an algebraic loop."""
        line = self.Resolve(facts, path)
        facts.CheckStrictlyProper(self.kind)
        is_open = IsMatched(line.master_damping, line.impedance)
        if facts.has_no_delay and not is_open:
            Refuse(
                f"{path}.master_damping",
                line.master_damping,
                "null without delay: the wave would go round in no time",
            )
        start: list[float] = facts.start.tolist()
        # At first there are no waves, and both positions are the start.
        packet = [*[0.0] * len(start), *start]
        return Architecture(
            master_side=WaveMaster(line, start=start),
            slave_side=WaveSlave(line, num_axes=len(start)),
            initial_forward_packet=packet,
            initial_return_packet=packet,
            forward_fields=("wave", "position"),
            return_fields=("wave", "position"),
        )

"""Wave variables: the channels carry waves, which delay cannot make active."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import BasicVector

from teleop_drake.architectures.base import Architecture, ArchitectureConfig
from teleop_drake.architectures.facts import Facts
from teleop_drake.channels import ChannelConfig
from teleop_drake.kernel import Kernel, KernelBlock, Name, Term, times
from teleop_drake.kernel.linear_part import LinearPart
from teleop_drake.laws.wave_variables import (
    drift_correcting_wave,
    filtered_wave_rate,
    line_power,
    master_velocity,
    passive_scaling,
    reflected_wave,
    slave_force,
    wave_root,
)
from teleop_drake.validation import (
    CheckGain,
    CheckNumber,
    GainField,
    GainMatrix,
    Number,
    Refuse,
)


class WaveMaster(KernelBlock):
    """Turns the operator's force and the returning wave into velocity and a wave.

        v_m = (b + D)^-1 (F_h + (2 b)^(1/2) w)
        u   = (2 b)^(1/2) v_m - w

    with the wave impedance b, a damper D beside the line, and w = f w_received, which
    is behind a low-pass where there is a bandwidth: dw/dt = bandwidth (f w_received -
    w). The line gets F_h - D v_m. With D = b, u does not depend on w: nothing is
    reflected at this end. The law is `teleop_drake.laws.wave_variables`.

    | port | name             | size | unit          | is                         |
    |------|------------------|------|---------------|----------------------------|
    | in   | haptic_force     | n    | N             | F_h                        |
    | in   | velocity_command | n    | m/s           | ignored                    |
    | in   | return_packet    | 2n   | [W^(1/2); m]  | [w; p_WT] of WaveSlave     |
    | out  | felt_position    | n    | m             | p_WT as received           |
    | out  | felt_velocity    | n    | m/s           | v_m                        |
    | out  | forward_packet   | 2n   | [W^(1/2); m]  | [u; x_m]                   |
    | out  | master_position  | n    | m             | x_m, integral of v_m       |
    | out  | master_power     | n    | W             | (F_h - D v_m) v_m per axis |

    State (continuous): [x_m (n), and w (n) if there is a bandwidth].

    Initial value: x_m = start, w = 0.

    Direct feedthrough: haptic_force to felt_velocity, forward_packet and master_power;
    return_packet to felt_position and, unless there is a bandwidth, to felt_velocity,
    master_power and (unless D = b) forward_packet.

    It knows no delay and no energy: what is passive is the line as a whole. The
    position that the operator feels is where the tool was, not x_m.

    Args:
        impedance: b in N s/m (n, n), symmetric positive definite.
        damping: D in N s/m (n, n), symmetric, not negative.
        start: x_m at time 0 in m (n).
        scaling: f, factor on the received wave; see passive_scaling().
        bandwidth: Corner of the low-pass in rad/s; None: no low-pass.

    Raises:
        ValueError: If a size or value is not allowed.
    """

    def __init__(
        self,
        *,
        impedance: ArrayLike,
        damping: ArrayLike,
        start: ArrayLike,
        scaling: float = 1.0,
        bandwidth: float | None = None,
    ):
        KernelBlock.__init__(self)
        self.set_name("wave_master")
        b = np.array(impedance, dtype=float)
        start = np.array(start, dtype=float)
        self._S = wave_root(b)
        n = self._n = self._S.shape[0]
        self._D = CheckGain("damping", damping, n, may_be_zero=True)
        if start.shape != (n,):
            Refuse("start", start, f"{n} finite numbers (m)")
        _CheckWavePath(scaling, bandwidth)
        self._f, self._bandwidth = scaling, bandwidth
        self._is_matched = np.allclose(self._D, b, rtol=1e-12, atol=0)
        self.DeclareVectorInputPort("haptic_force", n)
        self.DeclareVectorInputPort("velocity_command", n)
        self.DeclareVectorInputPort("return_packet", 2 * n)
        initial = np.append(start, [0.0] * (n if bandwidth else 0))
        self.DeclareContinuousState(BasicVector(initial))
        self.DeclareOutputs(
            felt_position=n,
            felt_velocity=n,
            forward_packet=2 * n,
            master_position=n,
            master_power=n,
        )

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        n = int(self._n)
        wave: Name = ("state", n, 2 * n) if self._bandwidth else "received"
        outputs: dict[str, Term] = {
            "received": (times, ("return_packet", 0, n), "scaling"),
            "velocity": (master_velocity, "haptic_force", wave, "root", "damping"),
            "felt_position": ("return_packet", n, 2 * n),
            "felt_velocity": "velocity",
            "master_position": ("state", 0, n),
            "master_power": (line_power, "haptic_force", "velocity", "damping"),
        }
        # Where nothing is reflected the arriving wave must not be looked at: without a
        # delay it depends on this very output.
        seen: Name = "nothing" if self._is_matched else wave
        outputs |= {
            "own_velocity": (master_velocity, "haptic_force", seen, "root", "damping"),
            "reflected": (reflected_wave, "own_velocity", seen, "root"),
            "forward_packet": ["reflected", ("state", 0, n)],
        }
        rate: list[Name] = ["velocity"]
        if self._bandwidth:
            outputs["filtered"] = (filtered_wave_rate, wave, "received", "bandwidth")
            rate.append("filtered")
        return Kernel(
            parameters={
                "scaling": self._f,
                "bandwidth": self._bandwidth or 0.0,
                "root": self._S,
                "damping": self._D,
                "nothing": np.zeros(n),
            },
            rate=rate,
            outputs=outputs,
            sizes=dict.fromkeys(
                ("received", "velocity", "own_velocity", "reflected", "filtered"), n
            ),
            unused=("velocity_command",),
        )


def _CheckWavePath(scaling: float, bandwidth: float | None) -> None:
    """Refuses what no arriving wave can go through."""
    CheckNumber("scaling", scaling, above=0, maximum=1)
    if bandwidth is not None:
        CheckNumber("bandwidth", bandwidth, "rad/s", above=0)


class WaveSlave(KernelBlock):
    """Turns the arriving wave and the tool's velocity into a force and a wave.

        F_c = (2 b)^(1/2) u - b v
        w   = (2 b)^(1/2) v - u

    with the wave impedance b and u = f u_received, which is behind a low-pass where
    there is a bandwidth: du/dt = bandwidth (f u_received - u). To this u may come
    (b/2)^(1/2) rate (x_m - p_WT), which moves the tool towards where the master was,
    as far as |u| does not grow on any axis: the correction can only take energy out of
    the line. The law is `teleop_drake.laws.wave_variables`.

    | port | name              | size | unit         | is                        |
    |------|-------------------|------|--------------|---------------------------|
    | in   | forward_packet    | 2n   | [W^(1/2); m] | [u; x_m] of WaveMaster    |
    | in   | tool_position     | n    | m            | p_WT                      |
    | in   | tool_velocity     | n    | m/s          | v                         |
    | in   | environment_force | n    | N            | ignored                   |
    | out  | control_force     | n    | N            | F_c                       |
    | out  | return_packet     | 2n   | [W^(1/2); m] | [w; p_WT]                 |
    | out  | slave_power       | n    | W            | F_c v per axis            |

    State (continuous): u (n) if there is a bandwidth, else none.

    Initial value: u = 0.

    Direct feedthrough: tool_velocity and, unless there is a bandwidth, forward_packet
    to all outputs; tool_position to return_packet and, if there is a correction, to
    all; with a correction also forward_packet to all.

    The correction follows Niemeyer and Slotine, who feed the position back through the
    wave without adding to its energy ("Towards force-reflecting teleoperation over the
    internet", ICRA 1998; "Telemanipulation with time delays", Int. J. Robotics
    Research 23, 2004). It cannot act while no wave arrives.

    Args:
        impedance: b in N s/m (n, n), symmetric positive definite.
        scaling: f, factor on the received wave; see passive_scaling().
        bandwidth: Corner of the low-pass in rad/s; None: no low-pass.
        drift_correction: Rate in 1/s, >= 0; 0: none.

    Raises:
        ValueError: If a size or value is not allowed.
    """

    def __init__(
        self,
        *,
        impedance: ArrayLike,
        scaling: float = 1.0,
        bandwidth: float | None = None,
        drift_correction: float = 0.0,
    ):
        KernelBlock.__init__(self)
        self.set_name("wave_slave")
        self._S = wave_root(impedance)
        n = self._n = self._S.shape[0]
        _CheckWavePath(scaling, bandwidth)
        self._f, self._bandwidth = scaling, bandwidth
        if not 0 <= drift_correction < np.inf:
            Refuse("drift_correction", drift_correction, "a number >= 0 (1/s)")
        self._rate = drift_correction
        self.DeclareVectorInputPort("forward_packet", 2 * n)
        for name in ("tool_position", "tool_velocity", "environment_force"):
            self.DeclareVectorInputPort(name, n)
        if bandwidth:
            self.DeclareContinuousState(n)
        self.DeclareOutputs(control_force=n, return_packet=2 * n, slave_power=n)

    def ForLinearModel(self, estimates: np.ndarray | None) -> LinearPart:
        """Returns that there is nothing special; refuses a correction of the drift.

        Raises:
            ScenarioError: If there is a correction.
        """
        if self._rate:
            allowed = "0 for a linear model, because it acts in one direction only"
            Refuse("drift_correction", self._rate, allowed)
        return LinearPart()

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        n = int(self._n)
        outputs: dict[str, Term] = {
            "received": (times, ("forward_packet", 0, n), "scaling")
        }
        wave = "state" if self._bandwidth else "received"
        if self._rate > 0:
            outputs["corrected"] = (
                drift_correcting_wave, wave, ("forward_packet", n, 2 * n),
                "tool_position", "root", "drift_correction",
            )  # fmt: skip
            wave = "corrected"
        outputs |= {
            "control_force": (slave_force, "tool_velocity", wave, "root"),
            "reflected": (reflected_wave, "tool_velocity", wave, "root"),
            "return_packet": ["reflected", "tool_position"],
            "slave_power": (times, "control_force", "tool_velocity"),
        }
        rate: Term | None = None
        if self._bandwidth:
            rate = (filtered_wave_rate, "state", "received", "bandwidth")
        return Kernel(
            parameters={
                "scaling": self._f,
                "bandwidth": self._bandwidth or 0.0,
                "root": self._S,
                "drift_correction": self._rate,
            },
            rate=rate,
            outputs=outputs,
            sizes=dict.fromkeys(
                ("received", "corrected", "reflected"),
                n,
            ),
            unused=("environment_force",),
        )


Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class WaveVariables:
    """The wave line with every number; see WaveVariablesConfig for what they are."""

    impedance: Array
    master_damping: Array
    forward_bandwidth: float | None
    return_bandwidth: float | None
    forward_scaling: float
    return_scaling: float
    drift_correction: float


@dataclass(kw_only=True, eq=False)
class WaveVariablesConfig(ArchitectureConfig):
    """The wave line; see architectures.wave_variables.WaveMaster."""

    kind = "wave_variables"
    forward_parts = ("u", "x_m")
    return_parts = ("w", "p_WT")

    # b, wave impedance, N s/m, > 0. Null: matched to the operator, whose force is
    # H = K/s + b + O(s) at low frequency: b is the resistance of the haptic device.
    impedance: np.ndarray | float | None = GainField(None)
    # Damper at the master's end of the line, N s/m, >= 0. Null: b, which absorbs the
    # returning wave whatever the operator does; 0 is the bare line.
    master_damping: np.ndarray | float | None = GainField(None, may_be_zero=True)
    # Corner of the low-pass through which the arriving forward wave goes, rad/s, > 0;
    # null: none.
    forward_bandwidth: float | None = Number(None, "rad/s", above=0)
    # The same for the returning wave.
    return_bandwidth: float | None = Number(None, "rad/s", above=0)
    # Factor on the arriving forward wave, 0 to 1. Null: sqrt(1 - largest dT/dt) of a
    # variable channel that grows, which keeps it passive; 1 for all others.
    forward_scaling: float | None = Number(None, above=0, maximum=1)
    # The same for the returning wave.
    return_scaling: float | None = Number(None, above=0, maximum=1)
    # Rate at which the tool is pulled to the master's position, 1/s, >= 0, as far as
    # that takes energy out of the line. 0: not at all.
    drift_correction: float = Number(0.0, "1/s", minimum=0)

    def Resolve(self, facts: Facts, path: str) -> WaveVariables:
        """Returns the parameters with every default derived.

        Raises:
            ScenarioError: If a default cannot be derived.
        """
        n, impedance = facts.num_axes, self.impedance
        if impedance is None:
            impedance = facts.OperatorResistance(f"{path}.impedance")
        damping = impedance if self.master_damping is None else self.master_damping

        def Scaling(given: float | None, channel: ChannelConfig) -> float:
            if given is not None:
                return given
            return passive_scaling(channel.LargestSlope(facts.duration))

        return WaveVariables(
            impedance=GainMatrix(impedance, n),
            master_damping=GainMatrix(damping, n),
            forward_bandwidth=self.forward_bandwidth,
            return_bandwidth=self.return_bandwidth,
            forward_scaling=Scaling(self.forward_scaling, facts.forward_channel),
            return_scaling=Scaling(self.return_scaling, facts.return_channel),
            drift_correction=self.drift_correction,
        )

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides.

        Raises:
            ScenarioError: If a default cannot be derived, or the wave would go round
                in no time.
        """
        line = self.Resolve(facts, path)
        facts.CheckStrictlyProper(self.kind)
        is_open = np.allclose(line.master_damping, line.impedance, rtol=1e-12, atol=0)
        is_open |= bool(line.forward_bandwidth or line.return_bandwidth)
        if facts.has_no_delay and not is_open:
            Refuse(
                f"{path}.master_damping",
                line.master_damping,
                "null without delay, or there must be a bandwidth: the wave would go "
                "round in no time",
            )
        start: list[float] = facts.start.tolist()
        # No waves under way, and both at the start.
        packet = [*[0.0] * len(start), *start]
        return Architecture(
            master_side=WaveMaster(
                impedance=line.impedance,
                damping=line.master_damping,
                start=start,
                scaling=line.return_scaling,
                bandwidth=line.return_bandwidth,
            ),
            slave_side=WaveSlave(
                impedance=line.impedance,
                scaling=line.forward_scaling,
                bandwidth=line.forward_bandwidth,
                drift_correction=line.drift_correction,
            ),
            initial_forward_packet=packet,
            initial_return_packet=packet,
        )

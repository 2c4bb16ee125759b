"""The master's end of a wave line."""

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    LeafSystem,
)

from teleop_drake.architectures.checks import CheckWavePath
from teleop_drake.kernel import Kernel, Name, Term, times
from teleop_drake.laws.wave_variables import (
    filtered_wave_rate,
    line_power,
    master_velocity,
    reflected_wave,
    wave_root,
)
from teleop_drake.validation import CheckGain, Refuse


class WaveMaster(LeafSystem):
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
        LeafSystem.__init__(self)
        self.set_name("wave_master")
        b = np.array(impedance, dtype=float)
        start = np.array(start, dtype=float)
        self._S = wave_root(b)
        n = self._n = self._S.shape[0]
        self._D = CheckGain("damping", damping, n, may_be_zero=True)
        if start.shape != (n,):
            Refuse("start", start, f"{n} finite numbers (m)")
        CheckWavePath(scaling, bandwidth)
        self._f, self._bandwidth = scaling, bandwidth
        self._is_matched = np.allclose(self._D, b, rtol=1e-12, atol=0)
        self._F_h = self.DeclareVectorInputPort("haptic_force", n)
        self.DeclareVectorInputPort("velocity_command", n)
        self._packet = self.DeclareVectorInputPort("return_packet", 2 * n)
        initial = np.append(start, [0.0] * (n if bandwidth else 0))
        self.DeclareContinuousState(BasicVector(initial))
        received = self.xc_ticket() if bandwidth else self._packet.ticket()
        both = {self._F_h.ticket(), received}
        reflected = set() if self._is_matched else {received}
        self.DeclareVectorOutputPort(
            "felt_position",
            n,
            self._CalcFeltPosition,
            prerequisites_of_calc={self._packet.ticket()},
        )
        self.DeclareVectorOutputPort(
            "felt_velocity", n, self._CalcFeltVelocity, prerequisites_of_calc=both
        )
        self.DeclareVectorOutputPort(
            "forward_packet",
            2 * n,
            self._CalcForwardPacket,
            prerequisites_of_calc={self._F_h.ticket(), self.xc_ticket(), *reflected},
        )
        self.DeclareVectorOutputPort(
            "master_position",
            n,
            self._CalcMasterPosition,
            prerequisites_of_calc={self.xc_ticket()},
        )
        self.DeclareVectorOutputPort(
            "master_power", n, self._CalcMasterPower, prerequisites_of_calc=both
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
        # Where nothing is reflected the arriving wave must not be looked at.
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

    def _Wave(self, context: Context) -> np.ndarray:
        wave: np.ndarray
        if self._bandwidth:
            wave = context.get_continuous_state_vector().CopyToVector()[self._n :]
        else:
            wave = self._f * self._packet.Eval(context)[: self._n]
        return wave

    def _Velocity(self, context: Context) -> np.ndarray:
        return master_velocity(
            self._F_h.Eval(context),
            self._Wave(context),
            root=self._S,
            damping=self._D,
        )

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Calculates d/dt [x_m, w]."""
        rate = self._Velocity(context)
        if self._bandwidth:
            received = self._f * self._packet.Eval(context)[: self._n]
            change = filtered_wave_rate(self._Wave(context), received, self._bandwidth)
            rate = np.concatenate([rate, change])
        derivatives.get_mutable_vector().SetFromVector(rate)

    def _CalcFeltPosition(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._packet.Eval(context)[self._n :])

    def _CalcFeltVelocity(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._Velocity(context))

    def _CalcForwardPacket(self, context: Context, output: BasicVector) -> None:
        # Where nothing is reflected the arriving wave must not be looked at: without a
        # delay it depends on this very output.
        w = np.zeros(self._n) if self._is_matched else self._Wave(context)
        v = master_velocity(self._F_h.Eval(context), w, root=self._S, damping=self._D)
        u = reflected_wave(v, w, root=self._S)
        x_m = context.get_continuous_state_vector().CopyToVector()[: self._n]
        output.SetFromVector(np.concatenate([u, x_m]))

    def _CalcMasterPosition(self, context: Context, output: BasicVector) -> None:
        x = context.get_continuous_state_vector().CopyToVector()
        output.SetFromVector(x[: self._n])

    def _CalcMasterPower(self, context: Context, output: BasicVector) -> None:
        F_h, v = self._F_h.Eval(context), self._Velocity(context)
        output.SetFromVector(line_power(F_h, v, self._D))

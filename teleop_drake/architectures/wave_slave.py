"""The slave's end of a wave line."""

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    LeafSystem,
)

from teleop_drake.architectures.checks import CheckWavePath
from teleop_drake.kernel import Kernel, Term, times
from teleop_drake.laws.wave_variables import (
    drift_correcting_wave,
    filtered_wave_rate,
    reflected_wave,
    slave_force,
    wave_root,
)
from teleop_drake.validation import Refuse


class WaveSlave(LeafSystem):
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
        LeafSystem.__init__(self)
        self.set_name("wave_slave")
        self._S = wave_root(impedance)
        n = self._n = self._S.shape[0]
        CheckWavePath(scaling, bandwidth)
        self._f, self._bandwidth = scaling, bandwidth
        if not 0 <= drift_correction < np.inf:
            Refuse("drift_correction", drift_correction, "a number >= 0 (1/s)")
        self._rate = drift_correction
        self._packet = self.DeclareVectorInputPort("forward_packet", 2 * n)
        self._p = self.DeclareVectorInputPort("tool_position", n)
        self._v = self.DeclareVectorInputPort("tool_velocity", n)
        self.DeclareVectorInputPort("environment_force", n)
        if bandwidth:
            self.DeclareContinuousState(n)
        wave = {self.xc_ticket() if bandwidth else self._packet.ticket()}
        if drift_correction:
            wave |= {self._packet.ticket(), self._p.ticket()}
        wave.add(self._v.ticket())
        self.DeclareVectorOutputPort(
            "control_force", n, self._CalcControlForce, prerequisites_of_calc=wave
        )
        self.DeclareVectorOutputPort(
            "return_packet",
            2 * n,
            self._CalcReturnPacket,
            prerequisites_of_calc={*wave, self._p.ticket()},
        )
        self.DeclareVectorOutputPort(
            "slave_power", n, self._CalcSlavePower, prerequisites_of_calc=wave
        )

    @property
    def drift_correction(self) -> float:
        """Rate in 1/s at which the tool is pulled to the master's position."""
        return self._rate

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

    def _Wave(self, context: Context) -> np.ndarray:
        if self._bandwidth:
            u: np.ndarray = context.get_continuous_state_vector().CopyToVector()
        else:
            u = self._f * self._packet.Eval(context)[: self._n]
        if self._rate == 0:
            return u
        x_m, p = self._packet.Eval(context)[self._n :], self._p.Eval(context)
        return drift_correcting_wave(u, x_m, p, self._S, self._rate)

    def _Force(self, context: Context) -> np.ndarray:
        return slave_force(self._v.Eval(context), self._Wave(context), root=self._S)

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Calculates du/dt."""
        if self._bandwidth:
            received = self._f * self._packet.Eval(context)[: self._n]
            u = context.get_continuous_state_vector().CopyToVector()
            derivatives.get_mutable_vector().SetFromVector(
                filtered_wave_rate(u, received, self._bandwidth)
            )

    def _CalcControlForce(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._Force(context))

    def _CalcReturnPacket(self, context: Context, output: BasicVector) -> None:
        w = reflected_wave(self._v.Eval(context), self._Wave(context), root=self._S)
        output.SetFromVector(np.concatenate([w, self._p.Eval(context)]))

    def _CalcSlavePower(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._Force(context) * self._v.Eval(context))

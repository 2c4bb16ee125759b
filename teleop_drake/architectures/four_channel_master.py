"""The master of Lawrence's four-channel architecture."""

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    LeafSystem,
)

from teleop_drake.architectures.checks import CheckFourChannel
from teleop_drake.kernel import Kernel
from teleop_drake.laws.four_channel import master_packet, master_rate
from teleop_drake.validation import CheckGain, Refuse


class FourChannelMaster(LeafSystem):
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
        LeafSystem.__init__(self)
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
        CheckFourChannel(acceleration_bandwidth, C2=C2, C4=C4, C6=C6)
        self._bandwidth = acceleration_bandwidth or 0.0
        width = 4 * n if acceleration_bandwidth else 3 * n
        self._F_h = self.DeclareVectorInputPort("haptic_force", n)
        self.DeclareVectorInputPort("velocity_command", n)
        self._packet = self.DeclareVectorInputPort("return_packet", width)
        num_zeros = width - 2 * n
        initial = np.concatenate([self._start, np.zeros(num_zeros)])
        self.DeclareContinuousState(BasicVector(initial))
        self.DeclareVectorOutputPort(
            "felt_position",
            n,
            self._CopyPosition,
            prerequisites_of_calc={self._packet.ticket()},
        )
        self.DeclareVectorOutputPort(
            "felt_velocity",
            n,
            self._CopyVelocity,
            prerequisites_of_calc={self.xc_ticket()},
        )
        self.DeclareVectorOutputPort(
            "forward_packet",
            width,
            self._CalcForwardPacket,
            prerequisites_of_calc={self.xc_ticket(), self._F_h.ticket()},
        )

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

    def _GetState(self, context: Context) -> np.ndarray:
        """Returns [x_m; v_m] or [x_m; v_m; v_f]."""
        state: np.ndarray = context.get_continuous_state_vector().CopyToVector()
        return state

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Calculates d/dt [x_m; v_m] or d/dt [x_m; v_m; v_f]."""
        derivatives.get_mutable_vector().SetFromVector(
            master_rate(
                self._GetState(context),
                self._F_h.Eval(context),
                self._packet.Eval(context),
                self._start,
                self._M,
                self._B,
                self._K,
                self._factors,
                self._bandwidth,
            )
        )

    def _CopyPosition(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._packet.Eval(context)[: self._n])

    def _CopyVelocity(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._GetState(context)[self._n : 2 * self._n])

    def _CalcForwardPacket(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(
            master_packet(
                self._GetState(context), self._F_h.Eval(context), self._bandwidth
            )
        )

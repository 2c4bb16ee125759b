"""The slave of Lawrence's four-channel architecture."""

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
from teleop_drake.laws.four_channel import (
    filtered_acceleration,
    slave_force,
    slave_packet,
)
from teleop_drake.validation import CheckGain, Refuse


class FourChannelSlave(LeafSystem):
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
        LeafSystem.__init__(self)
        self.set_name("four_channel_slave")
        self._start = np.array(start, dtype=float)
        if self._start.ndim != 1 or not np.all(np.isfinite(self._start)):
            Refuse("start", start, "finite numbers (m)")
        n = self._n = self._start.size
        self._M = CheckGain("mass", mass, n, may_be_zero=True)
        self._B = CheckGain("damping", damping, n, may_be_zero=True)
        self._B_c = CheckGain("local_damping", local_damping, n, may_be_zero=True)
        self._K_c = CheckGain("local_stiffness", local_stiffness, n, may_be_zero=True)
        self._factors = np.array([C1, C3, C5], dtype=float)
        CheckFourChannel(acceleration_bandwidth, C1=C1, C3=C3, C5=C5)
        self._bandwidth = acceleration_bandwidth or 0.0
        width = 4 * n if acceleration_bandwidth else 3 * n
        self._packet = self.DeclareVectorInputPort("forward_packet", width)
        self._p = self.DeclareVectorInputPort("tool_position", n)
        self._v = self.DeclareVectorInputPort("tool_velocity", n)
        self._F_e = self.DeclareVectorInputPort("environment_force", n)
        own = {self._p.ticket(), self._v.ticket(), self._F_e.ticket()}
        sent = set(own)
        if acceleration_bandwidth:
            self.DeclareContinuousState(n)
            sent.add(self.xc_ticket())
        self.DeclareVectorOutputPort(
            "control_force",
            n,
            self._CalcControlForce,
            prerequisites_of_calc={self._packet.ticket(), *own},
        )
        self.DeclareVectorOutputPort(
            "return_packet", width, self._CalcReturnPacket, prerequisites_of_calc=sent
        )

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

    def _GetState(self, context: Context) -> np.ndarray:
        """Returns v_f, which is empty without accelerations."""
        state: np.ndarray = context.get_continuous_state_vector().CopyToVector()
        return state

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Calculates dv_f/dt."""
        v_f = self._GetState(context)
        if v_f.size > 0:
            v = self._v.Eval(context)
            derivatives.get_mutable_vector().SetFromVector(
                filtered_acceleration(v, v_f, self._bandwidth)
            )

    def _CalcControlForce(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(
            slave_force(
                self._packet.Eval(context),
                self._p.Eval(context),
                self._v.Eval(context),
                self._F_e.Eval(context),
                self._start,
                self._M,
                self._B,
                self._B_c,
                self._K_c,
                self._factors,
            )
        )

    def _CalcReturnPacket(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(
            slave_packet(
                self._GetState(context),
                self._p.Eval(context),
                self._v.Eval(context),
                self._F_e.Eval(context),
                self._bandwidth,
            )
        )

"""The slave of Lawrence's four-channel architecture."""

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    LeafSystem,
)

from teleop_drake.architectures.four_channel_master import check_four_channel
from teleop_drake.architectures.proportional_master import check_gain


class FourChannelSlave(LeafSystem):
    """Follows the motion and the force of the master.

        F_c = C1 V_m + C3 F_h - C_s V_s - C5 F_e
        C_s = B_c + K_c / s,   C1 = c1 (Z + C_s),   Z = M s + B

    V_m and F_h are the master's, as they arrive, and Z is a model of the robot. The
    acceleration in C1 is that which the master sends, or none. Positions count from
    `start`. With an exact model, c1 = 1 and C3 = 1 + C5, the master's likewise
    (FourChannelMaster, where the sources are), and no delay, V_s = V_m and F_e = F_h.

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
            raise ValueError(f"start: {start!r}; allowed: finite numbers (m)")
        n = self._n = self._start.size
        self._M = check_gain("mass", mass, n)
        self._B = check_gain("damping", damping, n)
        self._B_c = check_gain("local_damping", local_damping, n)
        self._K_c = check_gain("local_stiffness", local_stiffness, n)
        self._C1, self._C3, self._C5 = C1, C3, C5
        check_four_channel(acceleration_bandwidth, C1=C1, C3=C3, C5=C5)
        self._bandwidth = acceleration_bandwidth
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

    def _Acceleration(self, context: Context) -> np.ndarray:
        v_f = context.get_continuous_state_vector().CopyToVector()
        return np.asarray(self._bandwidth * (self._v.Eval(context) - v_f))

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Calculates dv_f/dt."""
        if self._bandwidth:
            derivatives.get_mutable_vector().SetFromVector(self._Acceleration(context))

    def _CalcControlForce(self, context: Context, output: BasicVector) -> None:
        x_m, v_m, F_h, *a_m = self._packet.Eval(context).reshape(-1, self._n)
        x = self._p.Eval(context) - self._start
        v = self._v.Eval(context)
        F = self._C3 * F_h - self._C5 * self._F_e.Eval(context)
        F += self._K_c @ (self._C1 * (x_m - self._start) - x)
        F += self._B_c @ (self._C1 * v_m - v) + self._C1 * self._B @ v_m
        if self._bandwidth:
            F += self._C1 * self._M @ a_m[0]
        output.SetFromVector(F)

    def _CalcReturnPacket(self, context: Context, output: BasicVector) -> None:
        parts = [port.Eval(context) for port in (self._p, self._v, self._F_e)]
        if self._bandwidth:
            parts.append(self._Acceleration(context))
        output.SetFromVector(np.concatenate(parts))

"""The master of a position-position teleoperator with damping injection."""

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    LeafSystem,
)

from teleop_drake.kernel import Kernel
from teleop_drake.laws.proportional import coupling_force, master_rate
from teleop_drake.validation import CheckGain, Refuse


class ProportionalMaster(LeafSystem):
    """A handle with mass, tied to where the tool was by a spring and braked.

        M dv_m/dt = F_h - K (x_m - x_s) - B v_m,   dx_m/dt = v_m

    with x_s = p_WT(t - T_r). With the slave F_c = K (x_m(t - T_f) - p_WT) - B_s v
    (ProportionalSlave) the pair is stable for 4 B B_s > (T_f + T_r)^2 K^2.

    Sources: D. Lee and M. W. Spong, "Passive bilateral teleoperation with constant time
    delay", IEEE Trans. Robotics 22 (2006); E. Nuno, L. Basanez and R. Ortega,
    "Passivity-based control for bilateral teleoperation: a tutorial", Automatica 47
    (2011), where this is P+d.

    | port | name             | size | unit | is                    |
    |------|------------------|------|------|-----------------------|
    | in   | haptic_force     | n    | N    | F_h                   |
    | in   | velocity_command | n    | m/s  | ignored               |
    | in   | return_packet    | n    | m    | x_s                   |
    | out  | felt_position    | n    | m    | x_s                   |
    | out  | felt_velocity    | n    | m/s  | v_m                   |
    | out  | forward_packet   | n    | m    | x_m                   |
    | out  | coupling_force   | n    | N    | K (x_m - x_s)         |

    State (continuous): [x_m (n), v_m (n)].

    Initial value: x_m = start, v_m = 0.

    Direct feedthrough: return_packet to felt_position and coupling_force.

    It compensates neither the mass nor the damping: the operator feels both.

    Args:
        mass: M in kg (n, n), symmetric positive definite.
        stiffness: K in N/m (n, n), symmetric, not negative.
        damping: B in N s/m (n, n), symmetric, not negative.
        start: x_m at time 0 in m (n).

    Raises:
        ValueError: If a size or value is not allowed.
    """

    def __init__(
        self,
        *,
        mass: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        start: ArrayLike,
    ):
        LeafSystem.__init__(self)
        self.set_name("proportional_master")
        start = np.array(start, dtype=float)
        if start.ndim != 1 or not np.all(np.isfinite(start)):
            Refuse("start", start, "finite numbers (m)")
        n = self._n = start.size
        self._M = CheckGain("mass", mass, n)
        self._K = CheckGain("stiffness", stiffness, n, may_be_zero=True)
        self._B = CheckGain("damping", damping, n, may_be_zero=True)
        self._F_h = self.DeclareVectorInputPort("haptic_force", n)
        self.DeclareVectorInputPort("velocity_command", n)
        self._x_s = self.DeclareVectorInputPort("return_packet", n)
        self.DeclareContinuousState(
            BasicVector(np.concatenate([start, np.zeros(n)])), n, n, 0
        )
        packet, state = self._x_s.ticket(), self.xc_ticket()
        for name, calc, prerequisites in (
            ("felt_position", self._CopyPacket, {packet}),
            ("felt_velocity", self._CopyVelocity, {state}),
            ("forward_packet", self._CopyPosition, {state}),
            ("coupling_force", self._CalcCouplingForce, {packet, state}),
        ):
            self.DeclareVectorOutputPort(
                name, n, calc, prerequisites_of_calc=prerequisites
            )

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        n = self._n
        return Kernel(
            parameters={"mass": self._M, "stiffness": self._K, "damping": self._B},
            rate=(
                master_rate, "state", "haptic_force", "return_packet", "mass",
                "stiffness", "damping",
            ),
            outputs={
                "felt_position": "return_packet",
                "felt_velocity": ("state", n, 2 * n),
                "forward_packet": ("state", 0, n),
                "coupling_force": (
                    coupling_force, ("state", 0, n), "return_packet", "stiffness"
                ),
            },
            unused=("velocity_command",),
        )  # fmt: skip

    def _GetState(self, context: Context) -> np.ndarray:
        """Returns [x_m; v_m]."""
        state: np.ndarray = context.get_continuous_state_vector().CopyToVector()
        return state

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Calculates d/dt [x_m; v_m]."""
        derivatives.get_mutable_vector().SetFromVector(
            master_rate(
                self._GetState(context),
                self._F_h.Eval(context),
                self._x_s.Eval(context),
                self._M,
                self._K,
                self._B,
            )
        )

    def _CopyPacket(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._x_s.Eval(context))

    def _CopyVelocity(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._GetState(context)[self._n :])

    def _CopyPosition(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._GetState(context)[: self._n])

    def _CalcCouplingForce(self, context: Context, output: BasicVector) -> None:
        x_m = self._GetState(context)[: self._n]
        output.SetFromVector(coupling_force(x_m, self._x_s.Eval(context), self._K))

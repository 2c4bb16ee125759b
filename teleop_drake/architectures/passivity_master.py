"""Passivity observer and controller at the master."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    LeafSystem,
)

from teleop_drake.architectures.checks import CheckPassivity
from teleop_drake.kernel import Kernel, Name, times
from teleop_drake.laws.passivity import (
    energy_budget,
    energy_rates,
    injected_velocity,
    master_mobility,
    scaled_energy_rates,
)


class PassivityMaster(LeafSystem):
    """Lets the operator feel the tool's velocity as long as that is passive.

        v_m = v_ret + beta F_h,   0 <= beta <= maximum_mobility
        dE_in/dt = max(F_h v_m, 0),   dE_out/dt = max(-F_h v_m, 0)
        W_m = E_in of the slave as received - E_out

    on each axis. beta is 0 as long as -F_h v_ret, the power that would leave for the
    operator's hand, can be paid for out of W_m for the next `horizon`; else it is what
    brings that power down to W_m / horizon. F_h goes out unchanged. The law is
    `teleop_drake.laws.passivity`.

    | port | name             | size | unit        | is                              |
    |------|------------------|------|-------------|---------------------------------|
    | in   | haptic_force     | n    | N           | F_h                             |
    | in   | velocity_command | n    | m/s         | ignored                         |
    | in   | return_packet    | 3n   | [m; m/s; J] | [p_WT; v; E_in] of PassivitySlave |
    | out  | felt_position    | n    | m           | p_WT as received                |
    | out  | felt_velocity    | n    | m/s         | v_m                             |
    | out  | forward_packet   | 2n   | [N; J]      | [F_h; E_in]                     |
    | out  | master_budget    | n    | J           | W_m                             |
    | out  | master_power     | n    | W           | F_h v_m, into the channel       |
    | out  | injected_mobility | n   | m/(N s)     | beta                            |

    State (continuous): [E_in (n), E_out (n)] in units of `energy_scale`, because the
    solver's tolerance is absolute.

    Initial value: 0.

    Direct feedthrough: haptic_force to felt_velocity, forward_packet and master_power;
    return_packet to all but forward_packet.

    The maximum keeps the loop through the operator from becoming infinitely fast. What
    leaves beyond the budget because of it is seen in master_budget < 0 and paid back.

    It needs no delay and no model, and a channel that loses, holds or reorders packets
    errs on the safe side, because E_in only grows; one that extrapolates does not.

    Args:
        num_axes: Number n of task axes, >= 1.
        horizon: In s, > 0.
        maximum_mobility: Largest beta in m/(N s), > 0.
        energy_scale: In J, > 0.

    Raises:
        ValueError: If a value is not allowed.
    """

    def __init__(
        self,
        *,
        num_axes: int,
        horizon: float,
        maximum_mobility: float,
        energy_scale: float,
    ):
        LeafSystem.__init__(self)
        self.set_name("passivity_master")
        CheckPassivity(
            num_axes,
            horizon=horizon,
            maximum_mobility=maximum_mobility,
            energy_scale=energy_scale,
        )
        n = self._n = num_axes
        self._horizon, self._maximum = horizon, maximum_mobility
        self._scale = energy_scale
        self._F_h = self.DeclareVectorInputPort("haptic_force", n)
        self.DeclareVectorInputPort("velocity_command", n)
        self._packet = self.DeclareVectorInputPort("return_packet", 3 * n)
        self.DeclareContinuousState(2 * n)
        force, packet = self._F_h.ticket(), self._packet.ticket()
        state = self.xc_ticket()
        for name, size, calc, prerequisites in (
            ("felt_position", n, self._CalcFeltPosition, {packet}),
            ("felt_velocity", n, self._CalcFeltVelocity, {force, packet, state}),
            ("forward_packet", 2 * n, self._CalcForwardPacket, {force, state}),
            ("master_budget", n, self._CalcBudget, {packet, state}),
            ("master_power", n, self._CalcPower, {force, packet, state}),
            ("injected_mobility", n, self._CalcMobility, {force, packet, state}),
        ):
            self.DeclareVectorOutputPort(
                name, size, calc, prerequisites_of_calc=prerequisites
            )

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        n = self._n
        v: Name = ("return_packet", n, 2 * n)
        return Kernel(
            parameters={
                "horizon": self._horizon,
                "maximum": self._maximum,
                "scale": self._scale,
                "no_energy": 0.0,
            },
            rate=(scaled_energy_rates, "master_power", "scale"),
            outputs={
                "felt_position": ("return_packet", 0, n),
                "felt_velocity": (
                    injected_velocity, v, "injected_mobility", "haptic_force"
                ),
                "stored": (times, ("state", 0, n), "scale"),
                "forward_packet": ["haptic_force", "stored"],
                "master_budget": (
                    energy_budget, "no_energy", ("return_packet", 2 * n, 3 * n),
                    ("state", n, 2 * n), "scale",
                ),
                "master_power": (times, "haptic_force", "felt_velocity"),
                "injected_mobility": (
                    master_mobility, "haptic_force", v, "master_budget", "horizon",
                    "maximum",
                ),
            },
            sizes={"stored": n},
            unused=("velocity_command",),
        )  # fmt: skip

    def _Energies(self, context: Context) -> np.ndarray:
        """Returns [E_in, E_out] in J."""
        state = context.get_continuous_state_vector().CopyToVector()
        energies: np.ndarray = self._scale * state
        return energies

    def _Budget(self, context: Context) -> np.ndarray:
        n = self._n
        E_received = self._packet.Eval(context)[2 * n :]
        E: np.ndarray = E_received - self._Energies(context)[n:]
        return E

    def _Mobility(self, context: Context) -> np.ndarray:
        F_h = self._F_h.Eval(context)
        v = self._packet.Eval(context)[self._n : 2 * self._n]
        return master_mobility(
            F_h, v, self._Budget(context), self._horizon, self._maximum
        )

    def _Velocity(self, context: Context) -> np.ndarray:
        v = self._packet.Eval(context)[self._n : 2 * self._n]
        v_m: np.ndarray = v + self._Mobility(context) * self._F_h.Eval(context)
        return v_m

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Calculates d/dt [E_in, E_out]."""
        power = self._F_h.Eval(context) * self._Velocity(context)
        derivatives.get_mutable_vector().SetFromVector(
            energy_rates(power / self._scale)
        )

    def _CalcFeltPosition(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._packet.Eval(context)[: self._n])

    def _CalcFeltVelocity(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._Velocity(context))

    def _CalcForwardPacket(self, context: Context, output: BasicVector) -> None:
        E_in = self._Energies(context)[: self._n]
        output.SetFromVector(np.concatenate([self._F_h.Eval(context), E_in]))

    def _CalcBudget(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._Budget(context))

    def _CalcPower(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._F_h.Eval(context) * self._Velocity(context))

    def _CalcMobility(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._Mobility(context))

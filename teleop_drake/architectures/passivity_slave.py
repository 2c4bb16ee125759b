"""Passivity observer and controller at the slave."""

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
    damped_force,
    energy_budget,
    energy_rates,
    scaled_energy_rates,
    slave_damping,
)


class PassivitySlave(LeafSystem):
    """Applies the haptic force that arrives as long as that is passive.

        F_c = F_hd - alpha v,   0 <= alpha <= maximum_damping
        dE_out/dt = max(F_c v, 0),   dE_in/dt = max(-F_c v, 0)
        W_s = E_0 + E_in of the master as received - E_out

    on each axis. alpha is 0 as long as F_hd v, the power that would leave for the
    tool, can be paid for out of W_s for the next `horizon`; else it is the damping that
    brings that power down to W_s / horizon. E_0 lets the tool begin to
    move: the operator's first power comes a round trip later, because he feels the
    tool at rest. The law is `teleop_drake.laws.passivity`.

    | port | name              | size | unit        | is                             |
    |------|-------------------|------|-------------|--------------------------------|
    | in   | forward_packet    | 2n   | [N; J]      | [F_hd; E_in] of PassivityMaster |
    | in   | tool_position     | n    | m           | p_WT                           |
    | in   | tool_velocity     | n    | m/s         | v                              |
    | in   | environment_force | n    | N           | ignored                        |
    | out  | control_force     | n    | N           | F_c                            |
    | out  | return_packet     | 3n   | [m; m/s; J] | [p_WT; v; E_in]                |
    | out  | slave_budget      | n    | J           | W_s                            |
    | out  | slave_power       | n    | W           | F_c v, out of the channel      |
    | out  | injected_damping  | n    | N s/m       | alpha                          |

    State (continuous): [E_in (n), E_out (n)] in units of E_0, because the solver's
    tolerance is absolute.

    Initial value: 0, so that W_s = E_0.

    Direct feedthrough: forward_packet and tool_velocity to all but return_packet;
    tool_position and tool_velocity to return_packet.

    The maximum keeps the tool from stopping infinitely fast. What leaves beyond the
    budget because of it is seen in slave_budget < 0 and paid back.

    What flows back from the tool is never limited here but at the master. A tool whose
    budget is spent gets no power until the operator has moved against a force.

    Args:
        num_axes: Number n of task axes, >= 1.
        horizon: In s, > 0.
        maximum_damping: Largest alpha in N s/m, > 0.
        initial_energy: E_0 of each axis in J, > 0.

    Raises:
        ValueError: If a value is not allowed.
    """

    def __init__(
        self,
        *,
        num_axes: int,
        horizon: float,
        maximum_damping: float,
        initial_energy: float,
    ):
        LeafSystem.__init__(self)
        self.set_name("passivity_slave")
        CheckPassivity(
            num_axes,
            horizon=horizon,
            maximum_damping=maximum_damping,
            initial_energy=initial_energy,
        )
        n = self._n = num_axes
        self._horizon, self._maximum = horizon, maximum_damping
        self._E_0 = initial_energy
        self._packet = self.DeclareVectorInputPort("forward_packet", 2 * n)
        self._p = self.DeclareVectorInputPort("tool_position", n)
        self._v = self.DeclareVectorInputPort("tool_velocity", n)
        self.DeclareVectorInputPort("environment_force", n)
        self.DeclareContinuousState(2 * n)
        packet, state = self._packet.ticket(), self.xc_ticket()
        p, v = self._p.ticket(), self._v.ticket()
        for name, size, calc, prerequisites in (
            ("control_force", n, self._CalcControlForce, {packet, v, state}),
            ("return_packet", 3 * n, self._CalcReturnPacket, {p, v, state}),
            ("slave_budget", n, self._CalcBudget, {packet, state}),
            ("slave_power", n, self._CalcPower, {packet, v, state}),
            ("injected_damping", n, self._CalcDamping, {packet, v, state}),
        ):
            self.DeclareVectorOutputPort(
                name, size, calc, prerequisites_of_calc=prerequisites
            )

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        n = self._n
        F: Name = ("forward_packet", 0, n)
        return Kernel(
            parameters={
                "horizon": self._horizon,
                "maximum": self._maximum,
                "initial_energy": self._E_0,
                "minus": -1.0,
            },
            rate=(scaled_energy_rates, "incoming_power", "initial_energy"),
            outputs={
                "control_force": (
                    damped_force, F, "injected_damping", "tool_velocity"
                ),
                "stored": (times, ("state", 0, n), "initial_energy"),
                "return_packet": ["tool_position", "tool_velocity", "stored"],
                "slave_budget": (
                    energy_budget, "initial_energy", ("forward_packet", n, 2 * n),
                    ("state", n, 2 * n), "initial_energy",
                ),
                "slave_power": (times, "control_force", "tool_velocity"),
                "incoming_power": (times, "slave_power", "minus"),
                "injected_damping": (
                    slave_damping, F, "tool_velocity", "slave_budget", "horizon",
                    "maximum",
                ),
            },
            sizes={"stored": n, "incoming_power": n},
            unused=("environment_force",),
        )  # fmt: skip

    def _Energies(self, context: Context) -> np.ndarray:
        """Returns [E_in, E_out] in J."""
        state = context.get_continuous_state_vector().CopyToVector()
        energies: np.ndarray = self._E_0 * state
        return energies

    def _Budget(self, context: Context) -> np.ndarray:
        n = self._n
        E_received = self._packet.Eval(context)[n:]
        E: np.ndarray = self._E_0 + E_received - self._Energies(context)[n:]
        return E

    def _Damping(self, context: Context) -> np.ndarray:
        F = self._packet.Eval(context)[: self._n]
        v = self._v.Eval(context)
        return slave_damping(F, v, self._Budget(context), self._horizon, self._maximum)

    def _Force(self, context: Context) -> np.ndarray:
        F = self._packet.Eval(context)[: self._n]
        F_c: np.ndarray = F - self._Damping(context) * self._v.Eval(context)
        return F_c

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Calculates d/dt [E_in, E_out]."""
        power = -self._Force(context) * self._v.Eval(context)
        derivatives.get_mutable_vector().SetFromVector(energy_rates(power / self._E_0))

    def _CalcControlForce(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._Force(context))

    def _CalcReturnPacket(self, context: Context, output: BasicVector) -> None:
        E_in = self._Energies(context)[: self._n]
        output.SetFromVector(
            np.concatenate([self._p.Eval(context), self._v.Eval(context), E_in])
        )

    def _CalcBudget(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._Budget(context))

    def _CalcPower(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._Force(context) * self._v.Eval(context))

    def _CalcDamping(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._Damping(context))

"""Energy that goes into the channels and does not come out."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    LeafSystem,
)

from teleop_drake.kernel import Kernel
from teleop_drake.laws.channel_energy import (
    difference,
    energy_rates,
    port_power_vector,
)
from teleop_drake.validation import CheckNumber


class ChannelEnergy(LeafSystem):
    """Balances the energy at both ends of the communication.

        power_in = F_m . v_m           d(energy_in)/dt  = power_in
        power_out = F_s . v_s          d(energy_out)/dt = power_out
        power = power_in - power_out   energy = energy_in - energy_out

    At the master a force F_m is sent while a velocity v_m is felt: F_m . v_m goes into
    the channels. At the slave a force F_s arrives while the tool moves with v_s:
    F_s . v_s comes out of them. Channels without delay have power 0. Channels are
    passive as long as the energy, counted from rest, is not negative: what they deliver
    by then was put in before. Energy below 0 they have made themselves.

    | port | name            | size | unit | in the thesis's loop          |
    |------|-----------------|------|------|-------------------------------|
    | in   | master_force    | n    | N    | F_h, sent                     |
    | in   | master_velocity | n    | m/s  | v(t - T_r), felt              |
    | in   | slave_force     | n    | N    | F_h(t - T_f), received        |
    | in   | slave_velocity  | n    | m/s  | v of the tool, sent           |
    | out  | energy          | 1    | J    | put in minus taken out so far |
    | out  | power           | 1    | W    | its rate                      |
    | out  | power_in        | 1    | W    | at the master                 |
    | out  | power_out       | 1    | W    | at the slave                  |
    | out  | energy_in       | 1    | J    | put in at the master so far   |
    | out  | energy_out      | 1    | J    | taken out at the slave so far |

    State (continuous, 2): [energy_in, energy_out] in J.

    Initial value: 0.

    Direct feedthrough: from the inputs at the master to power_in, from those at the
    slave to power_out, from all to power; none to the energies.

    It acts on nothing. Forces that jump without an event that ends the step cost
    accuracy, as in any integrated quantity.

    Source: R. J. Anderson and M. W. Spong, "Bilateral control of teleoperators with
    time delay", IEEE Trans. Autom. Control 34 (1989); observed over time by
    B. Hannaford and J.-H. Ryu, "Time-domain passivity control of haptic interfaces",
    IEEE Trans. Robot. Autom. 18 (2002).

    Args:
        num_axes: Number n of axes, >= 1.

    Raises:
        ValueError: If num_axes < 1.
    """

    def __init__(self, *, num_axes: int):
        LeafSystem.__init__(self)
        CheckNumber("num_axes", num_axes, minimum=1)
        self.set_name("channel_energy")
        self._master_force = self.DeclareVectorInputPort("master_force", num_axes)
        self._master_velocity = self.DeclareVectorInputPort("master_velocity", num_axes)
        self._slave_force = self.DeclareVectorInputPort("slave_force", num_axes)
        self._slave_velocity = self.DeclareVectorInputPort("slave_velocity", num_axes)
        self.DeclareContinuousState(2)
        state = {self.xc_ticket()}
        at_master = {self._master_force.ticket(), self._master_velocity.ticket()}
        at_slave = {self._slave_force.ticket(), self._slave_velocity.ticket()}
        for name, calc, prerequisites in (
            ("energy", self._CalcEnergy, state),
            ("power", self._CalcPower, at_master | at_slave),
            ("power_in", self._CalcPowerIn, at_master),
            ("power_out", self._CalcPowerOut, at_slave),
            ("energy_in", self._CalcEnergyIn, state),
            ("energy_out", self._CalcEnergyOut, state),
        ):
            self.DeclareVectorOutputPort(name, 1, calc, prerequisites)

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        at_master = ("master_force", "master_velocity")
        at_slave = ("slave_force", "slave_velocity")
        return Kernel(
            rate=(energy_rates, *at_master, *at_slave),
            outputs={
                "energy": (difference, "state"),
                "power": (difference, "rate"),
                "power_in": (port_power_vector, *at_master),
                "power_out": (port_power_vector, *at_slave),
                "energy_in": ("state", 0, 1),
                "energy_out": ("state", 1, 2),
            },
        )

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Evaluates the powers; called by Drake several times in every step."""
        derivatives.SetFromVector(self._Powers(context))

    def _Powers(self, context: Context) -> np.ndarray:
        """Returns [power_in, power_out] in W."""
        return energy_rates(
            self._master_force.Eval(context),
            self._master_velocity.Eval(context),
            self._slave_force.Eval(context),
            self._slave_velocity.Eval(context),
        )

    def _CalcPower(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(difference(self._Powers(context)))

    def _CalcPowerIn(self, context: Context, output: BasicVector) -> None:
        F, v = self._master_force.Eval(context), self._master_velocity.Eval(context)
        output.SetFromVector(port_power_vector(F, v))

    def _CalcPowerOut(self, context: Context, output: BasicVector) -> None:
        F, v = self._slave_force.Eval(context), self._slave_velocity.Eval(context)
        output.SetFromVector(port_power_vector(F, v))

    def _CalcEnergy(self, context: Context, output: BasicVector) -> None:
        energies = context.get_continuous_state_vector().CopyToVector()
        output.SetFromVector(difference(energies))

    def _CalcEnergyIn(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, context.get_continuous_state_vector().GetAtIndex(0))

    def _CalcEnergyOut(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, context.get_continuous_state_vector().GetAtIndex(1))

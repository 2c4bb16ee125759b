"""Energy that goes into the channels and does not come out."""

from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    LeafSystem,
)


class ChannelEnergy(LeafSystem):
    """Balances the energy at both ends of the communication.

        power     = F_m . v_m - F_s . v_s
        d(energy)/dt = power

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

    State (continuous, 1): the energy in J.

    Initial value: 0.

    Direct feedthrough: from all inputs to power; none to energy.

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
        if num_axes < 1:
            raise ValueError(f"num_axes must be >= 1, got {num_axes}")
        self.set_name("channel_energy")
        self._master_force = self.DeclareVectorInputPort("master_force", num_axes)
        self._master_velocity = self.DeclareVectorInputPort("master_velocity", num_axes)
        self._slave_force = self.DeclareVectorInputPort("slave_force", num_axes)
        self._slave_velocity = self.DeclareVectorInputPort("slave_velocity", num_axes)
        self.DeclareContinuousState(1)
        self.DeclareVectorOutputPort(
            "energy", 1, self._CalcEnergy, prerequisites_of_calc={self.xc_ticket()}
        )
        self.DeclareVectorOutputPort(
            "power",
            1,
            self._CalcPower,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def _EvalPower(self, context: Context) -> float:
        power_in = self._master_force.Eval(context) @ self._master_velocity.Eval(
            context
        )
        power_out = self._slave_force.Eval(context) @ self._slave_velocity.Eval(context)
        return float(power_in - power_out)

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Evaluates the power; called by Drake several times in every step."""
        derivatives.SetFromVector([self._EvalPower(context)])

    def _CalcEnergy(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_continuous_state_vector().CopyToVector())

    def _CalcPower(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._EvalPower(context))

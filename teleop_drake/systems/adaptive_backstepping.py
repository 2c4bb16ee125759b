"""Neural-adaptive backstepping, the control law of chapters 4 and 5."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    Diagram,
    DiagramBuilder,
    LeafSystem,
)
from pydrake.systems.primitives import Demultiplexer

from teleop_drake.laws.backstepping import (
    BacksteppingGains,
    BacksteppingState,
    auxiliary_error,
    backstepping_rate_vector,
    control_force_error,
    initial_state,
    pack_state,
    unpack_state,
)
from teleop_drake.laws.compiled import compiled
from teleop_drake.laws.gaussian_network import GaussianNetwork


class AdaptiveBackstepping(Diagram):
    """Tracks the surgeon's delayed velocity and force with two adaptive networks.

        s       = (v - v_dd) + Lambda (F_e - F_hd)                          (4.2, 5.2)
        alpha   = F_e - Psi^-1 (W1 Phi + G1 s),   z = F_c - alpha         (4.23, 5.22)
        dF_c/dt = alpha' - Psi^T P s - G2 z                               (4.32, 5.31)

    together with the update laws of W1, Psi and W3 (4.52, 5.51). The law itself is
    `teleop_drake.laws.backstepping`. F_hd = F_h(t - T_f) and v_dd = v_d(t - T_f) are
    what arrives over the forward channel. Both networks have the tool's position as
    their input.

    | port | name                | size | unit  | is                       |
    |------|---------------------|------|-------|--------------------------|
    | in   | haptic_force        | n    | N     | F_hd                     |
    | in   | velocity_command    | n    | m/s   | v_dd                     |
    | in   | tool_position       | n    | m     | r, input of the networks |
    | in   | tool_velocity       | n    | m/s   | v                        |
    | in   | environment_force   | n    | N     | F_e                      |
    | out  | control_force       | n    | N     | F_c                      |
    | out  | psi                 | n n  | 1/kg  | Psi, row by row          |
    | out  | weights_1           | n N  | m/s^2 | W1, row by row           |
    | out  | weights_3           | n N  | N/s   | W3, row by row           |
    | out  | auxiliary_error     | n    | m/s   | s                        |
    | out  | control_force_error | n    | N     | z                        |

    State (continuous): [F_c (n), W1 (n N), Psi (n n), W3 (n N)], matrices row by row;
    `teleop_drake.laws.backstepping.unpack_state` takes it apart.

    Initial value: F_c = 0, W1 = W3 = 0, Psi = Psi0.

    Direct feedthrough: none to control_force, psi, weights_1 and weights_3. All
    inputs but tool_position feed through to auxiliary_error, and all inputs to
    control_force_error.

    It neither limits the control force nor knows the robot: n comes from the gains.
    A jump of an input (a puncture, a command) makes s and z jump, not F_c.

    Args:
        gains: The constants of the law.
        network: The basis functions of both networks, with n inputs in m.

    Raises:
        ValueError: If the network does not have one input per axis.
    """

    def __init__(self, *, gains: BacksteppingGains, network: GaussianNetwork):
        Diagram.__init__(self)
        n, N = gains.num_axes, network.num_functions
        if network.num_inputs != n:
            raise ValueError(
                f"network must have one input per task axis ({n}), got a network of "
                f"{network.num_inputs} inputs"
            )
        builder = DiagramBuilder()
        law = builder.AddNamedSystem("law", _Law(gains, network))
        # The parts of the state come out without Python.
        split = builder.AddNamedSystem(
            "split_state", Demultiplexer([n, n * N, n * n, n * N])
        )
        builder.Connect(law.GetOutputPort("state"), split.get_input_port())
        for i in range(law.num_input_ports()):
            port = law.get_input_port(i)
            builder.ExportInput(port, port.get_name())
        for name, i in (
            ("control_force", 0),
            ("psi", 2),
            ("weights_1", 1),
            ("weights_3", 3),
        ):
            builder.ExportOutput(split.get_output_port(i), name)
        for name in ("auxiliary_error", "control_force_error"):
            builder.ExportOutput(law.GetOutputPort(name), name)
        builder.BuildInto(self)
        self.set_name("adaptive_backstepping")


class _Law(LeafSystem):
    """The law: the state and its time derivatives, s and z."""

    def __init__(self, gains: BacksteppingGains, network: GaussianNetwork):
        LeafSystem.__init__(self)
        n, N = gains.num_axes, network.num_functions
        self._gains = gains
        self._gains_tuple = gains.AsTuple()
        self._rate = compiled(backstepping_rate_vector)
        self._network = network

        self._haptic_force = self.DeclareVectorInputPort("haptic_force", n)
        self._velocity_command = self.DeclareVectorInputPort("velocity_command", n)
        self._tool_position = self.DeclareVectorInputPort("tool_position", n)
        self._tool_velocity = self.DeclareVectorInputPort("tool_velocity", n)
        self._environment_force = self.DeclareVectorInputPort("environment_force", n)
        state = self.DeclareContinuousState(
            BasicVector(pack_state(initial_state(gains, N)))
        )
        self.DeclareStateOutputPort("state", state)
        error_inputs = {
            self._haptic_force.ticket(),
            self._velocity_command.ticket(),
            self._tool_velocity.ticket(),
            self._environment_force.ticket(),
        }
        self.DeclareVectorOutputPort(
            "auxiliary_error", n, self._CalcAuxiliaryError, error_inputs
        )
        self.DeclareVectorOutputPort(
            "control_force_error",
            n,
            self._CalcControlForceError,
            error_inputs | {self.xc_ticket(), self._tool_position.ticket()},
        )

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Evaluates the law; called by Drake several times in every step."""
        v = self._tool_velocity.Eval(context)
        Phi, Phi_dot = self._network.evaluate_with_rate(
            self._tool_position.Eval(context), v
        )
        derivatives.SetFromVector(
            self._rate(
                self._gains_tuple,
                context.get_continuous_state_vector().CopyToVector(),
                Phi,
                Phi_dot,
                v,
                self._velocity_command.Eval(context),
                self._environment_force.Eval(context),
                self._haptic_force.Eval(context),
            )
        )

    def _GetState(self, context: Context) -> BacksteppingState:
        x = context.get_continuous_state_vector().CopyToVector()
        return unpack_state(x, self._gains.num_axes)

    def _EvalAuxiliaryError(self, context: Context) -> NDArray[np.float64]:
        return auxiliary_error(
            self._gains,
            v=self._tool_velocity.Eval(context),
            v_dd=self._velocity_command.Eval(context),
            F_e=self._environment_force.Eval(context),
            F_hd=self._haptic_force.Eval(context),
        )

    def _CalcAuxiliaryError(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._EvalAuxiliaryError(context))

    def _CalcControlForceError(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(
            control_force_error(
                self._gains,
                self._GetState(context),
                Phi=self._network.evaluate(self._tool_position.Eval(context)),
                s=self._EvalAuxiliaryError(context),
                F_e=self._environment_force.Eval(context),
            )
        )

"""Neural-adaptive backstepping, the control law of chapters 4 and 5."""

from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    Diagram,
    DiagramBuilder,
    LeafSystem,
)
from pydrake.systems.primitives import Demultiplexer, Multiplexer

from teleop_drake.laws.backstepping import (
    BacksteppingGains,
    backstepping_error_vector,
    backstepping_rate_vector,
    initial_state,
    pack_state,
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

    Direct feedthrough: none to control_force, psi, weights_1 and weights_3; from all
    inputs to auxiliary_error and control_force_error, which are computed together.

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
        # Primitives join and split the signals: they do without Python.
        join = builder.AddNamedSystem("join_signals", Multiplexer([n] * len(_SIGNALS)))
        law = builder.AddNamedSystem("law", _Law(gains, network))
        split = builder.AddNamedSystem(
            "split_state", Demultiplexer([n, n * N, n * n, n * N])
        )
        builder.Connect(join.get_output_port(), law.GetInputPort("signals"))
        errors = builder.AddNamedSystem("split_errors", Demultiplexer([n, n]))
        builder.Connect(law.GetOutputPort("state"), split.get_input_port())
        builder.Connect(law.GetOutputPort("errors"), errors.get_input_port())
        for name in ("haptic_force", "velocity_command"):
            builder.ExportInput(join.get_input_port(_SIGNALS.index(name)), name)
        builder.ExportInput(law.GetInputPort("tool_position"), "tool_position")
        for name in ("tool_velocity", "environment_force"):
            builder.ExportInput(join.get_input_port(_SIGNALS.index(name)), name)
        for name, i in (
            ("control_force", 0),
            ("psi", 2),
            ("weights_1", 1),
            ("weights_3", 3),
        ):
            builder.ExportOutput(split.get_output_port(i), name)
        for i, name in enumerate(("auxiliary_error", "control_force_error")):
            builder.ExportOutput(errors.get_output_port(i), name)
        builder.BuildInto(self)
        self.set_name("adaptive_backstepping")


# v, v_dd, F_e and F_hd, in the order of the law's arguments.
_SIGNALS = ("tool_velocity", "velocity_command", "environment_force", "haptic_force")


class _Law(LeafSystem):
    """The law: the state and its time derivatives, and the errors [s; z].

    Inputs: tool_position (n), and signals, those of _SIGNALS one after the other.
    """

    def __init__(self, gains: BacksteppingGains, network: GaussianNetwork):
        LeafSystem.__init__(self)
        n, N = gains.num_axes, network.num_functions
        self._shape = (len(_SIGNALS), n)
        self._gains = gains.AsArrays()
        self._network = network
        self._rate = compiled(backstepping_rate_vector)
        self._errors = compiled(backstepping_error_vector)

        self._tool_position = self.DeclareVectorInputPort("tool_position", n)
        self._signals = self.DeclareVectorInputPort("signals", n * len(_SIGNALS))
        state = self.DeclareContinuousState(
            BasicVector(pack_state(initial_state(gains, N)))
        )
        self.DeclareStateOutputPort("state", state)
        self.DeclareVectorOutputPort(
            "errors",
            2 * n,
            self._CalcErrors,
            {self._signals.ticket(), self.xc_ticket(), self._tool_position.ticket()},
        )

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Evaluates the law; called by Drake several times in every step."""
        signals = self._signals.Eval(context).reshape(self._shape)
        Phi, Phi_dot = self._network.evaluate_with_rate(
            self._tool_position.Eval(context), signals[0]
        )
        x = context.get_continuous_state_vector().CopyToVector()
        derivatives.SetFromVector(self._rate(*self._gains, x, Phi, Phi_dot, signals))

    def _CalcErrors(self, context: Context, output: BasicVector) -> None:
        signals = self._signals.Eval(context).reshape(self._shape)
        Phi = self._network.evaluate(self._tool_position.Eval(context))
        x = context.get_continuous_state_vector().CopyToVector()
        output.SetFromVector(self._errors(*self._gains, x, Phi, signals))

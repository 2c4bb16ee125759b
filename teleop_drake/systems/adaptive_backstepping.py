"""Neural-adaptive backstepping, the control law of chapters 4 and 5."""

from pydrake.systems.framework import (
    BasicVector,
    Context,
    Diagram,
    DiagramBuilder,
    LeafSystem,
)
from pydrake.systems.primitives import Demultiplexer, Integrator, Multiplexer

from teleop_drake.laws.backstepping import (
    BacksteppingGains,
    backstepping_error_vector,
    backstepping_rate_vector,
    initial_state,
    pack_members,
    state_size,
)
from teleop_drake.laws.gaussian_network import GaussianNetwork
from teleop_drake.numerics.compiled import compiled


class AdaptiveBackstepping(Diagram):
    """Tracks the surgeon's delayed velocity and force with two adaptive networks.

        s       = (v - v_dd) + Lambda (F_e - F_hd)                          (4.2, 5.2)
        alpha   = F_e - Psi^-1 (W1 Phi + G1 s),   z = F_c - alpha         (4.23, 5.22)
        dF_c/dt = alpha' - Psi^T P s - G2 z                               (4.32, 5.31)

    together with the update laws of W1, Psi and W3 (4.52, 5.51). The law itself is
    `teleop_drake.laws.backstepping`. F_hd = F_h(t - T_f) and v_dd = v_d(t - T_f) are
    what arrives over the forward channel. Both networks have the tool's position as
    their input.

    | port | name                | size  | unit  | is                       |
    |------|---------------------|-------|-------|--------------------------|
    | in   | haptic_force        | M n   | N     | F_hd                     |
    | in   | velocity_command    | M n   | m/s   | v_dd                     |
    | in   | tool_position       | M n   | m     | r, input of the networks |
    | in   | tool_velocity       | M n   | m/s   | v                        |
    | in   | environment_force   | M n   | N     | F_e                      |
    | out  | control_force       | M n   | N     | F_c                      |
    | out  | psi                 | M n n | 1/kg  | Psi, row by row          |
    | out  | weights_1           | M n N | m/s^2 | W1, row by row           |
    | out  | weights_3           | M n N | N/s   | W3, row by row           |
    | out  | auxiliary_error     | M n   | m/s   | s                        |
    | out  | control_force_error | M n   | N     | z                        |

    M is 1, or the number of an ensemble's members: as many controllers side by side.

    State (continuous): [F_c (M n), W1 (M n N), Psi (M n n), W3 (M n N)], matrices row
    by row; `teleop_drake.laws.backstepping.unpack_state` takes it apart.

    Initial value: F_c = 0, W1 = W3 = 0, Psi = Psi0.

    Direct feedthrough: none to control_force, psi, weights_1 and weights_3; from all
    inputs to auxiliary_error and control_force_error, which are computed together.

    It neither limits the control force nor knows the robot: n comes from the gains.
    A jump of an input (a puncture, a command) makes s and z jump, not F_c.

    Args:
        gains: The constants of the law.
        network: The basis functions of both networks, with n inputs in m.
        num_members: M, >= 1.

    Raises:
        ValueError: If the network does not have one input per axis.
    """

    def __init__(
        self,
        *,
        gains: BacksteppingGains,
        network: GaussianNetwork,
        num_members: int = 1,
    ):
        Diagram.__init__(self)
        n, N = gains.num_axes, network.num_functions
        if network.num_inputs != n:
            raise ValueError(
                f"network must have one input per task axis ({n}), got a network of "
                f"{network.num_inputs} inputs"
            )
        builder = DiagramBuilder()
        M = num_members
        x0 = pack_members([initial_state(gains, N)] * M)
        # Primitives join, integrate and split the signals: they do without Python.
        join = builder.AddNamedSystem(
            "join_signals", Multiplexer([M * n] * len(_SIGNALS) + [len(x0)])
        )
        law = builder.AddNamedSystem("law", _Law(gains, network, M))
        state = builder.AddNamedSystem("state", Integrator(x0))
        split = builder.AddNamedSystem(
            "split_state", Demultiplexer([M * n, M * n * N, M * n * n, M * n * N])
        )
        errors = builder.AddNamedSystem("split_errors", Demultiplexer([M * n, M * n]))
        builder.Connect(join.get_output_port(), law.get_input_port())
        builder.Connect(law.GetOutputPort("rate"), state.get_input_port())
        builder.Connect(law.GetOutputPort("errors"), errors.get_input_port())
        builder.Connect(state.get_output_port(), split.get_input_port())
        builder.Connect(state.get_output_port(), join.get_input_port(len(_SIGNALS)))
        for name in _INPUTS:
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


_INPUTS = (
    "haptic_force",
    "velocity_command",
    "tool_position",
    "tool_velocity",
    "environment_force",
)

# v, v_dd, F_e, F_hd and r, in the order in which the law takes them.
_SIGNALS = (
    "tool_velocity",
    "velocity_command",
    "environment_force",
    "haptic_force",
    "tool_position",
)


class _Law(LeafSystem):
    """The law: the time rate of its state, and the errors [s; z].

    | port | name    | size       | is                                               |
    |------|---------|------------|--------------------------------------------------|
    | in   | signals | 5M n + n_x | v, v_dd, F_e, F_hd, r and the state              |
    | out  | rate    | n_x        | time derivatives of the state, by (4.52), (5.51) |
    | out  | errors  | 2M n       | [s; z]                                           |

    State: none; the integrator behind it has it. All signals come by one port, because
    each visit to a port from Python costs as much as a tenth of the law.
    """

    def __init__(
        self, gains: BacksteppingGains, network: GaussianNetwork, num_members: int
    ):
        LeafSystem.__init__(self)
        size = num_members * gains.num_axes
        n_x = num_members * state_size(gains.num_axes, network.num_functions)
        self._size = size
        self._gains = gains.AsArrays()
        self._functions = network.evaluate_members
        self._rate = compiled(backstepping_rate_vector)
        self._errors = compiled(backstepping_error_vector)

        num_signals = len(_SIGNALS) * size + n_x
        self._signals = self.DeclareVectorInputPort("signals", num_signals)
        signals = {self._signals.ticket()}
        self.DeclareVectorOutputPort("rate", n_x, self._CalcRate, signals)
        self.DeclareVectorOutputPort("errors", 2 * size, self._CalcErrors, signals)

    def _CalcRate(self, context: Context, output: BasicVector) -> None:
        size, signals = self._size, self._signals.Eval(context)
        Phi, Phi_dot = self._functions(signals[4 * size : 5 * size], signals[:size])
        output.SetFromVector(self._rate(*self._gains, Phi, Phi_dot, signals))

    def _CalcErrors(self, context: Context, output: BasicVector) -> None:
        size, signals = self._size, self._signals.Eval(context)
        Phi, _ = self._functions(signals[4 * size : 5 * size], signals[:size])
        output.SetFromVector(self._errors(*self._gains, Phi, signals))

"""Neural-adaptive backstepping, the control law of chapters 4 and 5."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    LeafSystem,
)

from teleop_drake.kernel import Kernel
from teleop_drake.laws.backstepping import (
    BacksteppingGains,
    BacksteppingState,
    adaptive_errors,
    adaptive_rate,
    backstepping_error_vector,
    backstepping_rate_vector,
    initial_state,
    pack_state,
    unpack_state,
)
from teleop_drake.laws.gaussian_network import GaussianNetwork
from teleop_drake.numerics.compiled import compiled
from teleop_drake.validation import Refuse


class AdaptiveBackstepping(LeafSystem):
    """Tracks the operator's delayed velocity and force with two adaptive networks.

        s       = (v - v_dd) + Lambda (F_e - F_hd)                          (4.2, 5.2)
        alpha   = F_e - Psi^-1 (W1 Phi + G1 s),   z = F_c - alpha         (4.23, 5.22)
        dF_c/dt = alpha' - Psi^T P s - G2 z                               (4.32, 5.31)

    together with the update laws of W1, Psi and W3 (4.52, 5.51). The law itself is
    `teleop_drake.laws.backstepping`. F_hd = F_h(t - T_f) and v_dd = v_d(t - T_f) are
    what arrives over the forward channel. Both networks have the tool's position as
    their input.

    | port | name                | size  | unit  | is                       |
    |------|---------------------|-------|-------|--------------------------|
    | in   | haptic_force        | n     | N     | F_hd                     |
    | in   | velocity_command    | n     | m/s   | v_dd                     |
    | in   | tool_position       | n     | m     | r, input of the networks |
    | in   | tool_velocity       | n     | m/s   | v                        |
    | in   | environment_force   | n     | N     | F_e                      |
    | out  | control_force       | n     | N     | F_c                      |
    | out  | psi                 | n n   | 1/kg  | Psi, row by row          |
    | out  | weights_1           | n N   | m/s^2 | W1, row by row           |
    | out  | weights_3           | n N   | N/s   | W3, row by row           |
    | out  | auxiliary_error     | n     | m/s   | s                        |
    | out  | control_force_error | n     | N     | z                        |

    State (continuous): [F_c (n), W1 (n N), Psi (n n), W3 (n N)], matrices row by row;
    `teleop_drake.laws.backstepping.unpack_state` takes it apart.

    Initial value: F_c = 0, W1 = W3 = 0, Psi = Psi0.

    Direct feedthrough: none to control_force, psi, weights_1 and weights_3; from all
    inputs to auxiliary_error and control_force_error.

    It neither limits the control force nor knows the robot: n comes from the gains.
    A jump of an input (a puncture, a command) makes s and z jump, not F_c.

    Args:
        gains: The constants of the law.
        network: The basis functions of both networks, with n inputs in m.

    Raises:
        ValueError: If the network does not have one input per axis.
    """

    def __init__(self, *, gains: BacksteppingGains, network: GaussianNetwork):
        LeafSystem.__init__(self)
        n, N = gains.num_axes, network.num_functions
        if network.num_inputs != n:
            allowed = f"{n}, one for each task axis"
            Refuse("network.num_inputs", network.num_inputs, allowed)
        self.set_name("adaptive_backstepping")
        self._n = n
        self._gains = gains.as_arrays()
        self._network = network
        self._rate = compiled(backstepping_rate_vector)
        self._errors = compiled(backstepping_error_vector)

        self._F_hd = self.DeclareVectorInputPort("haptic_force", n)
        self._v_dd = self.DeclareVectorInputPort("velocity_command", n)
        self._r = self.DeclareVectorInputPort("tool_position", n)
        self._v = self.DeclareVectorInputPort("tool_velocity", n)
        self._F_e = self.DeclareVectorInputPort("environment_force", n)
        self.DeclareContinuousState(BasicVector(pack_state(initial_state(gains, N))))
        state = {self.xc_ticket()}
        for name, size, calc in (
            ("control_force", n, self._CalcControlForce),
            ("psi", n * n, self._CalcPsi),
            ("weights_1", n * N, self._CalcWeights1),
            ("weights_3", n * N, self._CalcWeights3),
        ):
            self.DeclareVectorOutputPort(name, size, calc, state)
        self.DeclareVectorOutputPort("auxiliary_error", n, self._CalcAuxiliaryError)
        self.DeclareVectorOutputPort(
            "control_force_error", n, self._CalcControlForceError
        )

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        n, N = self._n, self._network.num_functions
        matrices, numbers = self._gains
        taken = (
            "matrices", "numbers", "centres", "widths", "state", "tool_position",
            "tool_velocity", "velocity_command", "environment_force", "haptic_force",
        )  # fmt: skip
        W1, Psi, W3 = n, n + n * N, n + n * N + n * n
        return Kernel(
            parameters={
                "matrices": matrices,
                "numbers": numbers,
                "centres": self._network.centres,
                "widths": self._network.widths,
            },
            rate=(adaptive_rate, *taken),
            outputs={
                "control_force": ("state", 0, n),
                "weights_1": ("state", W1, Psi),
                "psi": ("state", Psi, W3),
                "weights_3": ("state", W3, W3 + n * N),
                "errors": (adaptive_errors, *taken),
                "auxiliary_error": ("errors", 0, n),
                "control_force_error": ("errors", n, 2 * n),
            },
            sizes={"errors": 2 * n},
        )

    def DoCalcTimeDerivatives(
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        """Evaluates the law; called by Drake several times in every step."""
        x = context.get_continuous_state_vector().CopyToVector()
        v = self._v.Eval(context)
        Phi, Phi_dot = self._network.evaluate_with_rate(self._r.Eval(context), v)
        derivatives.SetFromVector(
            self._rate(
                *self._gains,
                x,
                Phi,
                Phi_dot,
                v,
                self._v_dd.Eval(context),
                self._F_e.Eval(context),
                self._F_hd.Eval(context),
            )
        )

    def _EvalState(self, context: Context) -> BacksteppingState:
        x = context.get_continuous_state_vector().CopyToVector()
        return unpack_state(x, self._n)

    def _CalcControlForce(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._EvalState(context).F_c)

    def _CalcPsi(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._EvalState(context).Psi.ravel())

    def _CalcWeights1(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._EvalState(context).W1.ravel())

    def _CalcWeights3(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._EvalState(context).W3.ravel())

    def _CalcErrors(self, context: Context) -> np.ndarray:
        """Returns [s; z]."""
        errors: np.ndarray = self._errors(
            *self._gains,
            context.get_continuous_state_vector().CopyToVector(),
            self._network.evaluate(self._r.Eval(context)),
            self._v.Eval(context),
            self._v_dd.Eval(context),
            self._F_e.Eval(context),
            self._F_hd.Eval(context),
        )
        return errors

    def _CalcAuxiliaryError(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._CalcErrors(context)[: self._n])

    def _CalcControlForceError(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._CalcErrors(context)[self._n :])

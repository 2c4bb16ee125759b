"""Tracking of a trajectory with an adaptive network, the controller of chapter 3."""

from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable
from pydrake.systems.framework import ValueProducer

from teleop_drake.kernel.convertible import Convertible, DualOf, PlantPorts
from teleop_drake.kernel.events import Weakly
from teleop_drake.kernel.terms import Duals
from teleop_drake.laws.gaussian_network import GaussianNetwork
from teleop_drake.laws.tracking import (
    TrackingGains,
    disturbance_estimate,
    task_dynamics,
    tracking_error,
    tracking_force,
    weights_rate,
)
from teleop_drake.validation import Refuse

_DESIRED = ("desired_position", "desired_velocity", "desired_acceleration")
_FELT = ("tool_position", "tool_velocity")


class _Tracking(PlantPorts):
    """Ports and callbacks for any scalar type."""

    def Declare(
        self: Any, T: Any, gains: TrackingGains, network: GaussianNetwork, frame: Any
    ) -> None:
        """Declares the ports, each output with what it depends on."""
        self.gains = gains
        self.network = network
        self._tool_frame = frame
        n = gains.num_axes
        N = network.num_functions
        sizes = dict.fromkeys(_DESIRED + _FELT, n)
        sizes["joint_position"] = self.plant.num_positions()
        sizes["joint_velocity"] = self.plant.num_velocities()
        self._ports = {
            name: self.DeclareVectorInputPort(name, size)
            for name, size in sizes.items()
        }
        self.DeclareContinuousState(n * N)
        tickets = {name: port.ticket() for name, port in self._ports.items()}
        state = self.xc_ticket()
        position = tickets["tool_position"]
        errors = {tickets[name] for name in _DESIRED[:2] + _FELT}
        # Both the force and the weights need the dynamics. The index is kept, not the
        # entry, which would keep this block alive.
        self._dynamics = self.DeclareCacheEntry(
            "task_dynamics",
            ValueProducer(allocate=Value[object], calc=Weakly(self._CalcDynamics)),
            {tickets["joint_position"], tickets["joint_velocity"]},
        ).cache_index()
        declare = self.DeclareVectorOutputPort
        declare("control_force", n, self._CalcForce, {state, *tickets.values()})
        declare("disturbance_estimate", n, self._CalcEstimate, {state, position})
        declare("weights_1", n * N, self._CalcWeights, {state})
        declare("auxiliary_error", n, self._CalcError, errors)

    def _In(self: Any, context: Any, *names: str) -> list[Any]:
        """Returns the values at some inputs."""
        return [self._ports[name].Eval(context) for name in names]

    def _Weights(self: Any, context: Any) -> Any:
        """Returns W, row by row."""
        return context.get_continuous_state_vector().CopyToVector()

    def _Basis(self: Any, context: Any) -> Any:
        """Returns Phi."""
        return self.network.evaluate(*self._In(context, "tool_position"))

    def _Error(self: Any, context: Any) -> Any:
        """Returns s."""
        return tracking_error(self.gains, *self._In(context, *_FELT, *_DESIRED[:2]))

    def _Law(self: Any, context: Any) -> tuple[Any, ...]:
        """Returns what the force and the rate of the weights follow from."""
        return (
            self.gains,
            self.get_cache_entry(self._dynamics).Eval(context),
            self._Weights(context),
            self._Basis(context),
            self._Error(context),
        )

    def DoCalcTimeDerivatives(self: Any, context: Any, derivatives: Any) -> None:
        """Evaluates the law; called by Drake several times in every step."""
        derivatives.SetFromVector(weights_rate(*self._Law(context)))

    def _CalcDynamics(self: Any, context: Any, output: Any) -> None:
        """Calculates the dynamics of the robot in task space (3.6)."""
        plant = self.plant
        plant_context = self._plant_context
        q, qdot = self._In(context, "joint_position", "joint_velocity")
        plant.SetPositions(plant_context, q)
        plant.SetVelocities(plant_context, qdot)
        world = plant.world_frame()
        n = self.gains.num_axes
        tool = plant.get_frame(self._tool_frame)
        kV = JacobianWrtVariable.kV
        of_tool = (plant_context, kV, tool, np.zeros(3), world, world)
        Jv_v_WT = plant.CalcJacobianTranslationalVelocity(*of_tool)
        Jv_dot_v = plant.CalcBiasTranslationalAcceleration(*of_tool)

        def Known(matrix: Any) -> Any:
            return matrix if matrix.dtype == float else matrix.view(Duals)

        output.set_value(
            task_dynamics(
                M=Known(plant.CalcMassMatrix(plant_context)),
                bias=plant.CalcBiasTerm(plant_context)
                - plant.CalcGravityGeneralizedForces(plant_context),
                J=Known(Jv_v_WT[:n]),
                J_dot_qdot=Jv_dot_v.ravel()[:n],
            )
        )

    def _CalcForce(self: Any, context: Any, output: Any) -> None:
        motion = self._In(context, "tool_velocity", *_DESIRED[1:])
        output.SetFromVector(tracking_force(*self._Law(context), *motion))

    def _CalcEstimate(self: Any, context: Any, output: Any) -> None:
        output.SetFromVector(
            disturbance_estimate(self._Weights(context), self._Basis(context))
        )

    def _CalcWeights(self: Any, context: Any, output: Any) -> None:
        output.SetFromVector(self._Weights(context))

    def _CalcError(self: Any, context: Any, output: Any) -> None:
        output.SetFromVector(self._Error(context))


class NetworkTrackingController(_Tracking, Convertible):
    """Tracks a trajectory; what the model does not explain, a network learns.

        s     = (v - r_d') + Lambda (r - r_d)                                   (3.11)
        F_c   = W Phi + C_r v + G_r + M_r (r_d'' - Lambda (v - r_d') - G1 s)    (3.18)
        dW/dt = beta (-M_r^-T s Phi^T - nu W)                             (3.19, 3.27)

    The law itself is `teleop_drake.laws.tracking`, which also says why the sign of
    dW/dt is not the printed one. M_r, C_r and G_r are those of `plant` at the given
    joint state: this controller knows the robot. It does not know the disturbance.
    The network's input is the tool's position.

    | port | name                 | size | unit         | is                        |
    |------|----------------------|------|--------------|---------------------------|
    | in   | desired_position     | n    | m            | r_d                       |
    | in   | desired_velocity     | n    | m/s          | r_d'                      |
    | in   | desired_acceleration | n    | m/s^2        | r_d''                     |
    | in   | tool_position        | n    | m            | r, input of the network   |
    | in   | tool_velocity        | n    | m/s          | v                         |
    | in   | joint_position       | nq   | rad or m     | q                         |
    | in   | joint_velocity       | nv   | rad/s or m/s | q'                        |
    | out  | control_force        | n    | N            | F_c                       |
    | out  | disturbance_estimate | n    | N            | W Phi, estimates F_e      |
    | out  | weights_1            | n N  | N            | W, row by row             |
    | out  | auxiliary_error      | n    | m/s          | s                         |

    State (continuous): W (n N), row by row; 0 at first.

    Direct feedthrough: all inputs to control_force; tool_position alone to
    disturbance_estimate; positions and velocities, but not of the joints, to
    auxiliary_error; none to weights_1.

    It neither limits the force nor avoids singular poses, where M_r is infinite.

    Attributes:
        gains, network, plant: As given.

    Args:
        gains: The constants of the law.
        network: The basis functions, with n inputs in m.
        plant: A finalized plant with the robot's masses and gravity.
        tool_name: The body whose origin is the tool T.

    Raises:
        ValueError: If the network does not have one input per axis.
    """

    dual = DualOf(_Tracking)

    def __init__(
        self,
        *,
        gains: TrackingGains,
        network: GaussianNetwork,
        plant: MultibodyPlant,
        tool_name: str = "tool",
    ):
        Convertible.__init__(self)
        n = gains.num_axes
        if network.num_inputs != n:
            Refuse(
                "network.num_inputs", network.num_inputs, f"{n}, one for each task axis"
            )
        self.set_name("network_tracking_controller")
        frame = plant.GetFrameByName(tool_name).index()
        self.Use(float, plant, gains=gains, network=network, frame=frame)

    @property
    def tool_frame(self) -> Frame:
        """The tool's frame, whose origin is T."""
        return self.plant.get_frame(self._tool_frame)

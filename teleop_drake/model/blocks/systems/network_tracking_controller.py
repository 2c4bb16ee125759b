"""Tracking of a trajectory with an adaptive network, the controller of chapter 3."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.kernel import FixedBlock, Kernel
from teleop_drake.model.blocks.robot_tool import ReadTool
from teleop_drake.model.laws.gaussian_network import GaussianNetwork, basis_functions
from teleop_drake.model.laws.tracking import (
    TrackingGains,
    disturbance_estimate,
    task_dynamics,
    tracking_error,
    tracking_force,
    weights_rate,
)

_DESIRED = ("desired_position", "desired_velocity", "desired_acceleration")


class NetworkTrackingController(FixedBlock):
    """Tracks a trajectory; a network learns the forces that the model does not have.

        s     = (v - r_d') + Lambda (r - r_d)                                   (3.11)
        F_c   = W Phi + C_r v + G_r + M_r (r_d'' - Lambda (v - r_d') - G1 s)    (3.18)
        dW/dt = beta (-M_r^-T s Phi^T - nu W)                             (3.19, 3.27)

    The law itself is `laws.tracking`, which also explains why the sign of
    dW/dt differs from the printed one. The controller has a model of the robot, but not
    of the disturbance: M_r, C_r and G_r are those of `plant` at the given joint state.
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

    Direct feedthrough: all inputs to control_force; tool_position to
    disturbance_estimate; the positions and velocities that are desired and of the tool
    to auxiliary_error; none to weights_1.

    It neither limits the force nor avoids singular poses, where M_r is infinite.

    Args:
        gains: The constants of the law.
        network: The basis functions, with n inputs in m.
        plant: A finalized plant of revolute and prismatic joints, with the robot's
            masses and gravity.
        tool_name: Name of the frame whose origin is the tool T.

    Raises:
        ValueError: If the network does not have one input per axis.
    """

    is_compiled = True

    def __init__(
        self,
        *,
        gains: TrackingGains,
        network: GaussianNetwork,
        plant: MultibodyPlant,
        tool_name: str = "tool",
    ):
        n = gains.num_axes
        if network.num_inputs != n:
            Refuse(
                "network.num_inputs", network.num_inputs, f"{n}, one for each task axis"
            )
        motion = ("tool_position", "tool_velocity", *_DESIRED[:2])
        # The arguments that the force and the rate of the weights have in common.
        law = ("gains", "dynamics", "state", "basis", "auxiliary_error")
        num_weights = n * network.num_functions
        FixedBlock.__init__(
            self,
            "network_tracking_controller",
            Kernel(
                parameters={
                    "gains": gains.as_numbers(),
                    "centres": network.centres,
                    "widths": network.widths,
                    "tool": ReadTool(plant, tool_name, n),
                },
                rate=(weights_rate, *law),
                outputs={
                    "basis": (basis_functions, "tool_position", "centres", "widths"),
                    "dynamics": (
                        task_dynamics, "tool", "joint_position", "joint_velocity"
                    ),
                    "auxiliary_error": (tracking_error, "gains", *motion),
                    "control_force": (
                        tracking_force, *law, "tool_velocity", *_DESIRED[1:]
                    ),
                    "disturbance_estimate": (disturbance_estimate, "state", "basis"),
                    "weights_1": "state",
                },
                sizes={"basis": network.num_functions, "dynamics": n * n + n},
            ),
            inputs={
                **dict.fromkeys(_DESIRED, n),
                "tool_position": n,
                "tool_velocity": n,
                "joint_position": plant.num_positions(),
                "joint_velocity": plant.num_velocities(),
            },
            outputs={
                "control_force": n,
                "disturbance_estimate": n,
                "weights_1": num_weights,
                "auxiliary_error": n,
            },
            state=np.zeros(num_weights),
        )  # fmt: skip

"""The interface of a robot arm at its tool: motion in task space, forces on it."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.kernel import FixedBlock, Kernel
from teleop_drake.model.blocks.robot_tool import ReadTool
from teleop_drake.model.laws.task_space import (
    Tool,
    joint_torques,
    tool_acceleration,
    tool_kinematics,
)


class ToolInterface(FixedBlock):
    """Connects a MultibodyPlant to task space at its tool (2.6 to 2.13).

    The task axes are the first n axes of the world, and the tool T is the origin of
    one of the plant's frames. With the first n rows J of Drake's translational Jacobian
    Jv_v_WT,

        v_WT = J qdot,    tau = J^T F_c  (2.11),    tau_e = -J^T F_e  (2.6).

    tau_e is the joint torque due to the environment's reaction -F_e at T. With n = 6,
    position, velocity and forces are those of laws.task_space: r = [p_WT; theta], a
    twist, and wrenches; the units of their last three numbers are rad, rad/s and N m.

    | port | name                     | size      | unit                      |
    |------|--------------------------|-----------|---------------------------|
    | in   | plant_state              | nq + nv   | rad or m, and their rates |
    | in   | generalized_acceleration | nv        | rad/s^2 or m/s^2          |
    | in   | control_force            | n         | N                         |
    | in   | environment_force        | n         | N                         |
    | out  | tool_kinematics          | 2n + n nv | m, m/s                    |
    | out  | tool_acceleration        | n         | m/s^2                     |
    | out  | joint_torques            | 2 nv      | N m or N                  |

    Direct feedthrough: from plant_state to all outputs, from the acceleration to
    tool_acceleration, and from both forces to joint_torques. `environment_force` is
    that of the robot ON the environment.

    `tool_kinematics` is [p_WT; v_WT; J row by row]. `joint_torques` is [tau; tau_e]:
    the first half goes to the plant's actuation, the second to its applied generalized
    force. Both are one port because a call from Drake to Python costs more than the
    products. Drake's list of applied spatial forces with -F_e at T would have the same
    effect as tau_e, at the cost of another such call.

    State: none. It does not limit the torque. It applies a moment to the tool only for
    n = 6.

    Args:
        plant: A finalized plant of revolute and prismatic joints, with one actuator for
            each joint.
        num_task_axes: n, 1 to 3 or 6.
        tool_name: Name of the frame whose origin is T, for example that of a body.
        is_wired_to_motors: Whether tau is connected directly to the plant's actuation.
            The actuators must then be in the order of the generalized velocities.
            Otherwise a block in between has to reorder tau.
        R_WP: Rotation of the tool at which theta is 0 (3, 3); None: I.

    Raises:
        ValueError: If `num_task_axes` is out of range or the plant's actuation is
            not the vector of its joint torques.
    """

    is_compiled = True

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        num_task_axes: int,
        tool_name: str = "tool",
        is_wired_to_motors: bool = True,
        R_WP: ArrayLike | None = None,
    ):
        n = num_task_axes
        nv = plant.num_velocities()
        if n not in (1, 2, 3, 6):
            Refuse("num_task_axes", n, "1, 2, 3 or 6")
        # In another order of the actuators, tau would drive the wrong motors.
        B = plant.MakeActuationMatrix()
        if is_wired_to_motors and not np.array_equal(B, np.eye(len(B))):
            Refuse(
                "plant.num_actuators",
                plant.num_actuators(),
                "one for each joint, in the order of its generalized velocities",
            )
        FixedBlock.__init__(
            self,
            "",
            Kernel(
                parameters={
                    "tool": _WithoutMasses(ReadTool(plant, tool_name, n)),
                    "R_WP": np.array(np.eye(3) if R_WP is None else R_WP, dtype=float),
                },
                outputs={
                    "tool_kinematics": (
                        tool_kinematics, "tool", "R_WP", "plant_state"
                    ),
                    "tool_acceleration": (
                        tool_acceleration, "tool", "plant_state",
                        "generalized_acceleration",
                    ),
                    "joint_torques": (
                        joint_torques, "control_force", "environment_force",
                        "tool_kinematics",
                    ),
                },
            ),
            inputs={
                "plant_state": plant.num_multibody_states(),
                "generalized_acceleration": nv,
                "control_force": n,
                "environment_force": n,
            },
            outputs={
                "tool_kinematics": n * (2 + nv),
                "tool_acceleration": n,
                "joint_torques": 2 * nv,
            },
        )  # fmt: skip


def _WithoutMasses(tool: Tool) -> Tool:
    """Returns a tool for kinematics only: masses may change in the plant alone."""
    none = np.zeros(0)
    tree = tool.tree._replace(
        masses=none, moments=none, inertias=none, rotor_inertias=none, damping=none
    )
    return tool._replace(tree=tree)

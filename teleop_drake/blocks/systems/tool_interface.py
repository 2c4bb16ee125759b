"""The tool of a robot arm seen from outside: motion in task space, forces on it."""

from functools import partial
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialAcceleration_
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from teleop_drake.arrays import ArrayLike
from teleop_drake.jit.compiled import CompiledLaw
from teleop_drake.kernel.convertible import Convertible, DualOf, PlantPorts
from teleop_drake.laws.task_space import joint_torques, tool_kinematics
from teleop_drake.validation import Refuse


def SpatialJacobian(plant: Any, context: Any, frame: Any) -> Any:
    """Returns Jv_V_WF of a frame of a plant: [w_WF; v_WF] by v (6, nv)."""
    world = plant.world_frame()
    return plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
    )


class _Interface(PlantPorts):
    """Ports and callbacks for any scalar type."""

    def Declare(self: Any, T: Any, num_task_axes: int, tool: Any, R_WP: Any) -> None:
        """Declares the ports."""
        plant = self.plant
        n = num_task_axes
        nv = plant.num_velocities()
        self.num_task_axes = n
        self.tool_index = int(tool)
        self.R_WP = R_WP
        self._tool = tool
        self._tool_kinematics: Any = partial(tool_kinematics, n)
        self._joint_torques: Any = joint_torques
        if T is float:
            self._tool_kinematics = CompiledLaw(tool_kinematics, n)
            self._joint_torques = CompiledLaw(joint_torques)

        self._plant_state = self.DeclareVectorInputPort(
            "plant_state", plant.num_multibody_states()
        )
        self._accelerations = self.DeclareAbstractInputPort(
            "body_spatial_accelerations", Value[list[SpatialAcceleration_[T]]]()
        )
        self._control_force = self.DeclareVectorInputPort("control_force", n)
        self._environment_force = self.DeclareVectorInputPort("environment_force", n)

        state = {self._plant_state.ticket()}
        self._kinematics = self.DeclareVectorOutputPort(
            "tool_kinematics", n * (2 + nv), self._CalcKinematics, state
        )
        self.DeclareVectorOutputPort(
            "tool_acceleration",
            n,
            self._CalcAcceleration,
            {self._accelerations.ticket()},
        )
        self.DeclareVectorOutputPort(
            "joint_torques",
            2 * nv,
            self._CalcJointTorques,
            state | {self._control_force.ticket(), self._environment_force.ticket()},
        )

    def _CalcKinematics(self, context: Any, output: Any) -> None:
        x = self._plant_state.Eval(context)
        plant = self.plant
        plant_context = self._plant_context
        plant.SetPositionsAndVelocities(plant_context, x)
        tool = plant.get_body(self._tool)
        X_WT = plant.EvalBodyPoseInWorld(plant_context, tool).GetAsMatrix34()
        output.SetFromVector(
            self._tool_kinematics(
                self.R_WP,
                X_WT,
                SpatialJacobian(plant, plant_context, tool.body_frame()),
                x,
            )
        )

    def _CalcAcceleration(self, context: Any, output: Any) -> None:
        A_WT = self._accelerations.Eval(context)[self.tool_index]
        a_WT = np.append(A_WT.translational(), A_WT.rotational())
        output.SetFromVector(a_WT[: self.num_task_axes])

    def _CalcJointTorques(self, context: Any, output: Any) -> None:
        output.SetFromVector(
            self._joint_torques(
                self._control_force.Eval(context),
                self._environment_force.Eval(context),
                self._kinematics.Eval(context),
            )
        )


class ToolInterface(_Interface, Convertible):
    """Joins a MultibodyPlant to task space at its tool (2.6 to 2.13).

    The task axes are the first n axes of the world, and the tool T is the origin of
    one of the plant's bodies. With Drake's translational Jacobian J = Jv_v_WT, kept to
    its first n rows,

        v_WT = J qdot,    tau = J^T F_c  (2.11),    tau_e = -J^T F_e  (2.6).

    tau_e is what the environment's reaction -F_e at T does to the joints. With n = 6,
    position, velocity and forces are those of laws.task_space: r = [p_WT; theta], a
    twist, and wrenches; the units of their last three numbers are rad, rad/s and N m.

    Input ports:

    | name                       | size    | unit                                      |
    |----------------------------|---------|-------------------------------------------|
    | plant_state                | nq + nv | rad or m, and their rates                 |
    | body_spatial_accelerations | list    | m/s^2, one for each body                  |
    | control_force              | n       | N                                         |
    | environment_force          | n       | N, force of the robot ON the environment  |

    Output ports:

    | name              | size      | unit     | direct feedthrough from            |
    |-------------------|-----------|----------|------------------------------------|
    | tool_kinematics   | 2n + n nv | m, m/s   | plant_state                        |
    | tool_acceleration | n         | m/s^2    | body_spatial_accelerations         |
    | joint_torques     | 2 nv      | N m or N | plant_state, both forces           |

    `tool_kinematics` is [p_WT; v_WT; J row by row], what one visit to the plant for
    each state yields. `joint_torques` is [tau; tau_e]: the first half goes to the
    plant's actuation, the second to its applied generalized force. The two come
    together because each call from Drake to Python costs more than its products do;
    the force -F_e at T as one of Drake's lists of applied spatial forces would do the
    same, and cost as much again.

    State: none. It applies no limit to the torque, and a moment to the tool only for
    n = 6.

    Attributes:
        plant, num_task_axes, R_WP: As given.
        tool_index: Index of the body whose origin is T.

    Args:
        plant: A finalized plant; its actuators must be one for each joint, in the
            order of the generalized velocities.
        num_task_axes: n, 1 to 3 or 6.
        tool_name: The body whose origin is T.
        is_wired_to_motors: Whether tau goes to the plant's actuation as it is. If
            something in between puts it into the order of the actuators, that may
            be any.
        R_WP: Rotation of the tool at which theta is 0 (3, 3); None: I.

    Raises:
        ValueError: If `num_task_axes` is out of range or the plant's actuation is
            not the vector of its joint torques.
    """

    dual = DualOf(_Interface)

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        num_task_axes: int,
        tool_name: str = "tool",
        is_wired_to_motors: bool = True,
        R_WP: ArrayLike | None = None,
    ):
        Convertible.__init__(self)
        if num_task_axes not in (1, 2, 3, 6):
            Refuse("num_task_axes", num_task_axes, "1, 2, 3 or 6")
        # Otherwise tau in the order of the velocities would drive the wrong motors.
        B = plant.MakeActuationMatrix()
        if is_wired_to_motors and not np.array_equal(B, np.eye(len(B))):
            Refuse(
                "plant.num_actuators",
                plant.num_actuators(),
                "one for each joint, in the order of its generalized velocities",
            )
        R_WP = np.array(np.eye(3) if R_WP is None else R_WP, dtype=float)
        tool = plant.GetBodyByName(tool_name).index()
        self.Use(float, plant, num_task_axes=num_task_axes, tool=tool, R_WP=R_WP)

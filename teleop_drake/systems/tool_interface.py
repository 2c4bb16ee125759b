"""The tool of a robot arm seen from outside: motion in task space, forces on it."""

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialAcceleration
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, ModelInstanceIndex
from pydrake.systems.framework import (
    BasicVector,
    Context,
    LeafSystem,
)

from teleop_drake.laws.task_space import joint_torques, tool_kinematics
from teleop_drake.numerics.compiled import compiled


class ToolInterface(LeafSystem):
    """Joins a MultibodyPlant to task space at its tool (2.6 to 2.13).

    The task axes are the first n axes of the world, and the tool T is the origin of
    one of the plant's bodies. With Drake's translational Jacobian J = Jv_v_WT, kept to
    its first n rows,

        v_WT = J qdot,    tau = J^T F_c  (2.11),    tau_e = -J^T F_e  (2.6).

    tau_e is what the environment's reaction -F_e at T does to the joints.

    Input ports:

    | name                       | size    | unit                                      |
    |----------------------------|---------|-------------------------------------------|
    | plant_state                | nq + nv | rad or m, and their rates                 |
    | body_spatial_accelerations | list    | m/s^2, one for each body                  |
    | control_force              | M n     | N                                         |
    | environment_force          | M n     | N, force of the robot ON the environment  |

    Output ports:

    | name              | size        | unit     | direct feedthrough from          |
    |-------------------|-------------|----------|----------------------------------|
    | tool_kinematics   | 2M n + n nv | m, m/s   | plant_state                      |
    | tool_acceleration | M n         | m/s^2    | body_spatial_accelerations       |
    | joint_torques     | 2 nv        | N m or N | plant_state, both forces         |

    M is 1, or the number of an ensemble's members: as many robots of one model, which
    the plant has one after another. Every part of a vector has theirs in this order;
    J has the columns of the robot's own velocities.

    `tool_kinematics` is [p_WT; v_WT; J row by row], what one visit to the plant for
    each state yields. `joint_torques` is [tau; tau_e]: the first half goes to the
    plant's actuation, the second to its applied generalized force. The two come
    together because each call from Drake to Python costs more than its products do;
    the force -F_e at T as one of Drake's lists of applied spatial forces would do the
    same, and cost as much again.

    State: none. It applies no limit to the torque, and no moment to the tool.
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        num_task_axes: int,
        tool_name: str = "tool",
        num_members: int = 1,
    ):
        """Constructs the interface.

        Args:
            plant: A finalized plant; its actuators must be one for each joint, in the
                order of the generalized velocities.
            num_task_axes: n, 1 to 3.
            tool_name: The body whose origin is T; each robot has one of that name.
            num_members: M, >= 1.

        Raises:
            ValueError: If `num_task_axes` is out of range or the plant's actuation is
                not the vector of its joint torques.
        """
        super().__init__()
        if not 1 <= num_task_axes <= 3:
            raise ValueError(f"num_task_axes: {num_task_axes} is not 1, 2 or 3")
        nv = plant.num_velocities()
        # Otherwise tau in the order of the velocities would drive the wrong motors.
        if not np.array_equal(plant.MakeActuationMatrix(), np.eye(nv)):
            raise ValueError(
                "plant: its actuators must be one for each joint, in the order of "
                "its generalized velocities"
            )
        self._plant = plant
        if num_members == 1:
            tools = [plant.GetBodyByName(tool_name)]
        else:
            tools = [
                plant.GetBodyByName(tool_name, ModelInstanceIndex(i))
                for i in range(plant.num_model_instances())
                if plant.HasBodyNamed(tool_name, ModelInstanceIndex(i))
            ]
        if len(tools) != num_members:
            raise ValueError(
                f"num_members: {num_members}, but the plant has {len(tools)} bodies "
                f"{tool_name!r}"
            )
        # What the calls to the plant for each tool take.
        self._tools = [(tool, tool.body_frame()) for tool in tools]
        self._tool_indices = [int(tool.index()) for tool in tools]
        # Working memory only: every calculation sets its state before it is read.
        self._plant_context = plant.CreateDefaultContext()
        self._world_frame = plant.world_frame()
        self._origin = np.zeros(3)
        self._tool_kinematics = compiled(tool_kinematics)
        self._joint_torques = compiled(joint_torques)
        M, n = num_members, num_task_axes
        self._n = n

        self._plant_state = self.DeclareVectorInputPort(
            "plant_state", BasicVector(plant.num_multibody_states())
        )
        self._accelerations = self.DeclareAbstractInputPort(
            "body_spatial_accelerations", Value[list[SpatialAcceleration]]()
        )
        self._control_force = self.DeclareVectorInputPort(
            "control_force", BasicVector(M * n)
        )
        self._environment_force = self.DeclareVectorInputPort(
            "environment_force", BasicVector(M * n)
        )

        state = {self._plant_state.ticket()}
        self._kinematics = self.DeclareVectorOutputPort(
            "tool_kinematics", 2 * M * n + n * nv, self._CalcKinematics, state
        )
        self.DeclareVectorOutputPort(
            "tool_acceleration",
            M * n,
            self._CalcAcceleration,
            {self._accelerations.ticket()},
        )
        self.DeclareVectorOutputPort(
            "joint_torques",
            2 * nv,
            self._CalcJointTorques,
            state | {self._control_force.ticket(), self._environment_force.ticket()},
        )

    def _CalcKinematics(self, context: Context, output: BasicVector) -> None:
        x = self._plant_state.Eval(context)
        plant, plant_context = self._plant, self._plant_context
        plant.SetPositionsAndVelocities(plant_context, x)
        eval_pose = plant.EvalBodyPoseInWorld
        calc_jacobian = plant.CalcJacobianTranslationalVelocity
        kV, p_TT, W = JacobianWrtVariable.kV, self._origin, self._world_frame
        p_WT, Jv_v_WT = [], []
        for tool, T in self._tools:
            p_WT.append(eval_pose(plant_context, tool).translation())
            Jv_v_WT.append(calc_jacobian(plant_context, kV, T, p_TT, W, W))
        if len(p_WT) == 1:  # For speed.
            p, J = p_WT[0], Jv_v_WT[0]
        else:
            p, J = np.concatenate(p_WT), np.concatenate(Jv_v_WT)
        output.SetFromVector(self._tool_kinematics(p, J, x, self._n))

    def _CalcAcceleration(self, context: Context, output: BasicVector) -> None:
        A_WT = self._accelerations.Eval(context)
        parts = [A_WT[i].translational()[: self._n] for i in self._tool_indices]
        output.SetFromVector(parts[0] if len(parts) == 1 else np.concatenate(parts))

    def _CalcJointTorques(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(
            self._joint_torques(
                self._control_force.Eval(context),
                self._environment_force.Eval(context),
                self._kinematics.Eval(context),
                self._n,
            )
        )

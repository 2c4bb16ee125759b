"""The controller of the joints that the task leaves free."""

from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.arrays import Array, ArrayLike
from teleop_drake.blocks.systems.tool_interface import SpatialJacobian
from teleop_drake.kernel.convertible import Convertible, DualOf
from teleop_drake.laws.task_space import (
    PostureGains,
    orientation_torque,
    posture_torque,
)
from teleop_drake.validation import CheckVector, Refuse


class _Hold:
    """Ports and callback for any scalar type."""

    def _Declare(self: Any, plant: Any, tool_name: str) -> None:
        self.plant = plant
        # The body is looked up each time; see ToolInterface.
        self._tool = plant.GetBodyByName(tool_name).index()
        self.tool_index = int(self._tool)
        # Working memory only: every calculation sets its state before it is read.
        self._plant_context = plant.CreateDefaultContext()
        self._state = self.DeclareVectorInputPort(
            "plant_state", plant.num_multibody_states()
        )
        self.DeclareVectorOutputPort(
            "hold_torque", plant.num_velocities(), self._CalcTorque
        )

    def Mirror(self: Any, other: Any) -> None:
        """Declares the ports of another block, and holds what it does."""
        self.num_axes = other.num_axes
        self.gains = other.gains
        self._q_0, self._R_0 = other.held
        self._keeps_orientation = self._R_0 is not None
        tool = other.plant.get_body(other._tool)
        self._Declare(other.plant.ToAutoDiffXd(), tool.name())

    def _ToolRotation(self: Any) -> Any:
        body = self.plant.get_body(self._tool)
        pose = self.plant.EvalBodyPoseInWorld(self._plant_context, body)
        return np.array(pose.rotation().matrix())

    def _CalcTorque(self: Any, context: Any, output: Any) -> None:
        """Calculates the torque that holds the posture or the orientation."""
        plant = self.plant
        plant_context = self._plant_context
        x = self._state.Eval(context)
        plant.SetPositionsAndVelocities(plant_context, x)
        q, v = np.split(x, 2)
        tool = plant.get_body(self._tool)
        J = SpatialJacobian(plant, plant_context, tool.body_frame())
        J_w = J[:3]
        J_v = np.concatenate((J[3:], J[:3]))[: self.num_axes]
        M = plant.CalcMassMatrix(plant_context)
        if self._keeps_orientation:
            R = self._ToolRotation()
            tau = orientation_torque(
                self.gains, M, J_v, J_w, self._R_0, R, self._q_0, q, v
            )
        else:
            tau = posture_torque(self.gains, M, J_v, self._q_0, q, v)
        output.SetFromVector(tau)


class PostureHold(_Hold, Convertible):
    """Torque that holds a posture, or the tool's orientation, beside the task.

        tau = M a + J^T Lambda (y - J a),  Lambda = (J M^-1 J^T)^-1 damped

    laws.task_space has what a, J and y are, and where it is from. The torque does not
    accelerate the tool along the task axes.

    | port | name        | size    | unit                      |
    |------|-------------|---------|---------------------------|
    | in   | plant_state | nq + nv | rad or m, and their rates |
    | out  | hold_torque | nv      | N m or N                  |

    State: none. Direct feedthrough: yes.

    It compensates neither weight nor friction nor the Coriolis forces, which move what
    it holds a little.

    Attributes:
        plant, num_axes, gains: As given.
        tool_index: Index of the body whose origin is the tool.

    Args:
        plant: A finalized plant whose qdot is its velocity.
        num_axes: n, number of task axes.
        tool_name: The body whose origin is the tool.
        joint_positions: q_0; with keeps_orientation, R_0 is the tool's rotation there.
        gains: How.
        keeps_orientation: Whether the tool's orientation is held; else the posture.

    Raises:
        ScenarioError: If the joints are fewer than what is to be held.
    """

    dual = DualOf(_Hold)

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        num_axes: int,
        tool_name: str,
        joint_positions: ArrayLike,
        gains: PostureGains,
        keeps_orientation: bool,
    ):
        Convertible.__init__(self)
        nv = plant.num_velocities()
        rows = num_axes + 3 * keeps_orientation
        CheckVector("joint_positions", joint_positions, nv, "rad or m")
        if rows > nv:
            Refuse("num_axes", num_axes, f"{nv - 3 * keeps_orientation} or less")
        self.num_axes = num_axes
        self.gains = gains
        self._keeps_orientation = keeps_orientation
        self._Declare(plant, tool_name)
        self._q_0 = np.array(joint_positions, dtype=float)
        plant.SetPositions(self._plant_context, self._q_0)
        self._R_0: Array = self._ToolRotation()

    @property
    def held(self) -> tuple[Array, Array | None]:
        """q_0, and R_0 if the orientation is held."""
        return self._q_0, self._R_0 if self._keeps_orientation else None

"""The controller of the joints that the task leaves free."""

from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.arrays import Array, ArrayLike
from teleop_drake.blocks.systems.tool_interface import SpatialJacobian
from teleop_drake.kernel.convertible import Convertible, DualOf, PlantPorts
from teleop_drake.laws.task_space import (
    PostureGains,
    orientation_torque,
    posture_torque,
)
from teleop_drake.validation import CheckVector, Refuse

Held = tuple[Array, Array | None]


def BodyRotation(plant: Any, context: Any, body: Any) -> Any:
    """Returns R_WB of a body of a plant (3, 3)."""
    return np.array(plant.EvalBodyPoseInWorld(context, body).rotation().matrix())


class _Hold(PlantPorts):
    """Ports and callback for any scalar type."""

    def Declare(
        self: Any, T: Any, num_axes: int, tool: Any, gains: PostureGains, held: Held
    ) -> None:
        """Declares the ports."""
        self.num_axes = num_axes
        self.tool_index = int(tool)
        self.gains = gains
        self.held = held
        self._tool = tool
        self._state = self.DeclareVectorInputPort(
            "plant_state", self.plant.num_multibody_states()
        )
        self.DeclareVectorOutputPort(
            "hold_torque", self.plant.num_velocities(), self._CalcTorque
        )

    def _CalcTorque(self: Any, context: Any, output: Any) -> None:
        """Calculates the torque that holds the posture or the orientation."""
        plant = self.plant
        plant_context = self._plant_context
        x = self._state.Eval(context)
        plant.SetPositionsAndVelocities(plant_context, x)
        q, v = np.split(x, 2)
        tool = plant.get_body(self._tool)
        q_0, R_0 = self.held
        J = SpatialJacobian(plant, plant_context, tool.body_frame())
        J_w = J[:3]
        J_v = np.concatenate((J[3:], J[:3]))[: self.num_axes]
        M = plant.CalcMassMatrix(plant_context)
        if R_0 is None:
            tau = posture_torque(self.gains, M, J_v, q_0, q, v)
        else:
            R = BodyRotation(plant, plant_context, tool)
            tau = orientation_torque(self.gains, M, J_v, J_w, R_0, R, q_0, q, v)
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
        held: q_0, and R_0 if the orientation is held, else None.
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
        tool = plant.GetBodyByName(tool_name)
        q_0 = np.array(joint_positions, dtype=float)
        R_0 = None
        if keeps_orientation:
            context = plant.CreateDefaultContext()
            plant.SetPositions(context, q_0)
            R_0 = BodyRotation(plant, context, tool)
        self.Use(
            float,
            plant,
            num_axes=num_axes,
            tool=tool.index(),
            gains=gains,
            held=(q_0, R_0),
        )

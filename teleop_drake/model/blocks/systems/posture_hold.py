"""The controller of the joints that the task leaves free."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.validation import CheckVector, Refuse
from teleop_drake.loops.kernel import FixedBlock, Kernel
from teleop_drake.loops.numerics.rigid_body import calc_motion
from teleop_drake.model.blocks.robot_tool import ReadTool
from teleop_drake.model.laws.task_space import PostureGains, hold_torque, place_tool


class PostureHold(FixedBlock):
    """Torque that holds a posture, or the tool's orientation, besides the task.

        tau = M a + J^T Lambda (y - J a),  Lambda = (J M^-1 J^T)^-1 damped

    See laws.task_space for a, J and y, and for the sources. The torque does not
    accelerate the tool along the task axes.

    | port | name        | size    | unit                      |
    |------|-------------|---------|---------------------------|
    | in   | plant_state | nq + nv | rad or m, and their rates |
    | out  | hold_torque | nv      | N m or N                  |

    State: none. Direct feedthrough: yes.

    It compensates neither weight nor friction nor Coriolis forces. These cause small
    errors of the posture or orientation.

    Args:
        plant: A finalized plant of revolute and prismatic joints.
        num_axes: n, number of task axes.
        tool_name: Name of the frame whose origin is the tool.
        joint_positions: q_0 in rad or m (nv); R_0 is the tool's rotation there.
        gains: The gains of the law.
        keeps_orientation: Whether the tool's orientation R_0 is held; else the posture.

    Raises:
        ScenarioError: If the task and the orientation take more axes than there are
            joints.
    """

    is_compiled = True

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
        nv = plant.num_velocities()
        rows = num_axes + 3 * keeps_orientation
        CheckVector("joint_positions", joint_positions, nv, "rad or m")
        if rows > nv:
            Refuse("num_axes", num_axes, f"{nv - 3 * keeps_orientation} or less")
        tool = ReadTool(plant, tool_name, num_axes)
        q_0 = np.array(joint_positions, dtype=float)
        R_0, _, _ = place_tool(tool, calc_motion(tool.tree, q_0, 0 * q_0))
        parameters = {
            "tool": tool,
            "gains": gains,
            "held": (q_0, R_0) if keeps_orientation else (q_0,),
        }
        FixedBlock.__init__(
            self,
            "",
            Kernel(
                parameters=parameters,
                outputs={"hold_torque": (hold_torque, *parameters, "plant_state")},
            ),
            inputs={"plant_state": plant.num_multibody_states()},
            outputs={"hold_torque": nv},
        )

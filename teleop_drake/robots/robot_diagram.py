"""A MultibodyPlant as a robot: forces on its tool in, motion of its tool out."""

from numpy.typing import ArrayLike
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Demultiplexer

from teleop_drake.robots.inverse_kinematics import TOOL
from teleop_drake.systems.tool_interface import ToolInterface

TOOL_BODY = "tool_body"
"""Name of the body that marks the tool where TOOL is the name of a mere frame."""


def MakeRobotDiagram(
    *, plant: MultibodyPlant, num_axes: int, joint_positions: ArrayLike
) -> Diagram:
    """Makes the robot: forces on its tool in, motion of its tool out (2.6, 2.7).

    The Diagram, named `robot`, holds the MultibodyPlant `plant`, the ToolInterface
    `tool_interface`, and `joint_state`, `tool_motion` and `joint_torques`, which split
    signals. Its default context is at rest at the start pose.

    Input ports:

    | name              | size | unit                                              |
    |-------------------|------|---------------------------------------------------|
    | control_force     | n    | N                                                 |
    | environment_force | n    | N, force of the robot ON the environment          |

    Output ports:

    | name              | size | unit         | direct feedthrough from             |
    |-------------------|------|--------------|-------------------------------------|
    | tool_position     | n    | m            | none                                |
    | tool_velocity     | n    | m/s          | none                                |
    | tool_acceleration | n    | m/s^2        | both forces; costs a forward        |
    |                   |      |              | dynamics, meant for recordings      |
    | joint_position    | nq   | rad or m     | none                                |
    | joint_velocity    | nv   | rad/s or m/s | none                                |
    | joint_torque      | nv   | N m or N     | both forces, in form; it depends on |
    |                   |      |              | control_force alone                 |

    Args:
        plant: A finalized, continuous plant with a body `tool`; its actuators must be
            one for each joint, in the order of the generalized velocities.
        num_axes: n, 1 to 3; fewer than nv leave the rest of the joints to themselves.
        joint_positions: q at the start (nq).

    Raises:
        ValueError: If the plant's actuation is not the vector of its joint torques.
    """
    n, nq, nv = num_axes, plant.num_positions(), plant.num_velocities()
    plant.SetDefaultPositions(joint_positions)
    builder = DiagramBuilder()
    builder.AddNamedSystem("plant", plant)
    tool_name = TOOL if plant.HasBodyNamed(TOOL) else TOOL_BODY
    tool = builder.AddNamedSystem(
        "tool_interface",
        ToolInterface(plant=plant, num_task_axes=n, tool_name=tool_name),
    )
    motion = builder.AddNamedSystem("tool_motion", Demultiplexer([n, n, n * nv]))
    joints = builder.AddNamedSystem("joint_state", Demultiplexer([nq, nv]))
    state = plant.get_state_output_port()
    builder.Connect(state, joints.get_input_port())
    builder.Connect(state, tool.GetInputPort("plant_state"))
    builder.Connect(
        plant.get_body_spatial_accelerations_output_port(),
        tool.GetInputPort("body_spatial_accelerations"),
    )
    torques = builder.AddNamedSystem("joint_torques", Demultiplexer([nv, nv]))
    builder.Connect(tool.GetOutputPort("joint_torques"), torques.get_input_port())
    builder.Connect(torques.get_output_port(0), plant.get_actuation_input_port())
    builder.Connect(
        torques.get_output_port(1),
        plant.get_applied_generalized_force_input_port(),
    )
    for name in ("control_force", "environment_force"):
        builder.ExportInput(tool.GetInputPort(name), name)
    builder.Connect(tool.GetOutputPort("tool_kinematics"), motion.get_input_port())
    builder.ExportOutput(motion.get_output_port(0), "tool_position")
    builder.ExportOutput(motion.get_output_port(1), "tool_velocity")
    builder.ExportOutput(tool.GetOutputPort("tool_acceleration"), "tool_acceleration")
    builder.ExportOutput(joints.get_output_port(0), "joint_position")
    builder.ExportOutput(joints.get_output_port(1), "joint_velocity")
    builder.ExportOutput(torques.get_output_port(0), "joint_torque")
    robot = builder.Build()
    robot.set_name("robot")
    return robot

"""A MultibodyPlant as a robot: forces on its tool in, motion of its tool out."""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import Adder, Demultiplexer, MatrixGain, Saturation

from teleop_drake.arrays import ArrayLike
from teleop_drake.blocks.robots.inverse_kinematics import TOOL, ToolRotation
from teleop_drake.blocks.systems.tool_interface import ToolInterface

TOOL_BODY = "tool_body"
"""Name of the body that marks the tool where TOOL is the name of a mere frame."""


@dataclass(kw_only=True)
class JointDrive:
    """What acts on the joints beside the task and the environment.

    The motors' torque is the sum of the task's, the hold's and the compensation of the
    weight, within the effort limits of the plant's actuators.

    Attributes:
        hold: From plant_state to hold_torque (nv), such as PostureHold.
        gravity_compensation: From plant_state to gravity_torque (nv).
        friction: From joint_velocity to friction_torque (nv), such as JointFriction.
    """

    hold: System | None = None
    gravity_compensation: System | None = None
    friction: System | None = None


def ToolBodyName(plant: MultibodyPlant) -> str:
    """Returns the name of the body whose origin is the tool."""
    return TOOL if plant.HasBodyNamed(TOOL) else TOOL_BODY


def MakeRobotDiagram(
    *,
    plant: MultibodyPlant,
    num_axes: int,
    joint_positions: ArrayLike,
    posture: ArrayLike | None = None,
    drive: JointDrive | None = None,
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

    With n = 6 they are wrenches, and the motion is that of laws.task_space.

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
    |                   |      |              | control_force and `drive` alone     |

    Args:
        plant: A finalized, continuous plant with a body `tool`; its actuators must be
            one for each joint, in any order.
        num_axes: n, 1 to 3, or 6, of which the last three turn the tool; fewer than nv
            leave the rest of the joints to themselves, or to `drive`.
        joint_positions: q at the start (nq).
        posture: q at which the rotation vector of six axes is 0 (nq); None: the start.
        drive: What else acts on the joints; None: nothing.

    Raises:
        ValueError: If the plant's actuators are not one for each joint.
    """
    n = num_axes
    nq = plant.num_positions()
    nv = plant.num_velocities()
    plant.SetDefaultPositions(joint_positions)
    builder = DiagramBuilder()
    builder.AddNamedSystem("plant", plant)
    is_ordered = _AreMotorsInOrder(plant)
    tool = builder.AddNamedSystem(
        "tool_interface",
        ToolInterface(
            plant=plant,
            num_task_axes=n,
            tool_name=ToolBodyName(plant),
            is_wired_to_motors=is_ordered,
            R_WP=ToolRotation(plant, joint_positions if posture is None else posture),
        ),
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
    applied, reaction = torques.get_output_port(0), torques.get_output_port(1)
    if drive is not None:
        applied, reaction = _AddDrive(
            builder, plant, drive, applied, reaction, joints.get_output_port(1)
        )
    if is_ordered:
        builder.Connect(applied, plant.get_actuation_input_port())
    else:
        B = plant.MakeActuationMatrix()
        order = builder.AddNamedSystem("motor_order", MatrixGain(B.T))
        builder.Connect(applied, order.get_input_port())
        builder.Connect(order.get_output_port(), plant.get_actuation_input_port())
    builder.Connect(reaction, plant.get_applied_generalized_force_input_port())
    for name in ("control_force", "environment_force"):
        builder.ExportInput(tool.GetInputPort(name), name)
    builder.Connect(tool.GetOutputPort("tool_kinematics"), motion.get_input_port())
    builder.ExportOutput(motion.get_output_port(0), "tool_position")
    builder.ExportOutput(motion.get_output_port(1), "tool_velocity")
    builder.ExportOutput(tool.GetOutputPort("tool_acceleration"), "tool_acceleration")
    builder.ExportOutput(joints.get_output_port(0), "joint_position")
    builder.ExportOutput(joints.get_output_port(1), "joint_velocity")
    builder.ExportOutput(applied, "joint_torque")
    robot = builder.Build()
    robot.set_name("robot")
    return robot


def _AddDrive(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    drive: JointDrive,
    task: OutputPort,
    reaction: OutputPort,
    joint_velocity: OutputPort,
) -> tuple[OutputPort, OutputPort]:
    """Adds the parts of a drive.

    Returns:
        The motors' torque, and all other torques.
    """
    motors, others = [task], [reaction]
    for name, system, torque in (
        ("posture_hold", drive.hold, "hold_torque"),
        ("gravity_compensation", drive.gravity_compensation, "gravity_torque"),
    ):
        if system is not None:
            builder.AddNamedSystem(name, system)
            builder.Connect(
                plant.get_state_output_port(), system.GetInputPort("plant_state")
            )
            motors.append(system.GetOutputPort(torque))
    if drive.friction is not None:
        friction = builder.AddNamedSystem("joint_friction", drive.friction)
        builder.Connect(joint_velocity, friction.GetInputPort("joint_velocity"))
        others.append(friction.GetOutputPort("friction_torque"))
    limits = np.zeros(plant.num_velocities())
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        limits[actuator.joint().velocity_start()] = actuator.effort_limit()
    limited = builder.AddNamedSystem("torque_limits", Saturation(-limits, limits))
    wanted = _AddSum(builder, "motor_torques", motors)
    builder.Connect(wanted, limited.get_input_port())
    return limited.get_output_port(), _AddSum(builder, "other_torques", others)


def _AddSum(builder: DiagramBuilder, name: str, terms: list[OutputPort]) -> OutputPort:
    """Returns the sum of some torques."""
    if len(terms) == 1:
        return terms[0]
    adder = builder.AddNamedSystem(name, Adder(len(terms), terms[0].size()))
    for i, term in enumerate(terms):
        builder.Connect(term, adder.get_input_port(i))
    return adder.get_output_port()


def _AreMotorsInOrder(plant: MultibodyPlant) -> bool:
    """Returns whether joint torques may go to the motors as they are.

    If the actuation matrix B is a permutation, u = B^T tau is what tau = B u asks of
    the motors, and they are in order only if B is the identity.
    """
    B = plant.MakeActuationMatrix()
    identity = np.eye(plant.num_velocities())
    is_permutation = B.shape == identity.shape and np.array_equal(B @ B.T, identity)
    return not is_permutation or np.array_equal(B, identity)

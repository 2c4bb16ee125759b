"""A MultibodyPlant as a robot: forces on its tool in, motion of its tool out."""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, System
from pydrake.systems.primitives import Adder, Demultiplexer, MatrixGain, Saturation

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.wiring import Connections, Wire
from teleop_drake.model.blocks.robots.inverse_kinematics import TOOL, ToolRotation
from teleop_drake.model.blocks.systems.tool_interface import ToolInterface


@dataclass(kw_only=True)
class JointDrive:
    """Systems that act on the joints besides the task and the environment.

    The motors' torque is the sum of the torques of the task, of the hold and of the
    gravity compensation, within the effort limits of the plant's actuators.

    Attributes:
        hold: A system from the plant's state to torques (nv), such as PostureHold.
        gravity_compensation: A system from the plant's state to torques (nv), such as
            GravityCompensation.
        friction: A system from the joints' velocities to torques (nv), such as
            JointFriction.
    """

    hold: System | None = None
    gravity_compensation: System | None = None
    friction: System | None = None


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
    | joint_torque      | nv   | N m or N     | declared: both forces; the value    |
    |                   |      |              | depends on control_force, `drive`   |

    Args:
        plant: A finalized, continuous plant with a frame `tool`; its actuators must be
            one for each joint, in any order.
        num_axes: n, 1 to 3 or 6; the last three of six turn the tool. If n < nv, the
            remaining motions of the joints are free, or controlled by `drive`.
        joint_positions: q at the start (nq).
        posture: q at which the rotation vector of six axes is 0 (nq); None: the start.
        drive: Further systems that act on the joints; None: there are none.

    Raises:
        ValueError: If the plant's actuators are not one for each joint.
    """
    nv = plant.num_velocities()
    plant.SetDefaultPositions(joint_positions)
    is_ordered = _AreMotorsInOrder(plant)
    tool = ToolInterface(
        plant=plant,
        num_task_axes=num_axes,
        tool_name=TOOL,
        is_wired_to_motors=is_ordered,
        R_WP=ToolRotation(plant, joint_positions if posture is None else posture),
    )
    # From the plant's state to the tool's motion, from forces on the tool to torques.
    systems = {
        "plant": plant,
        "tool_interface": tool,
        "tool_motion": Demultiplexer([num_axes, num_axes, num_axes * nv]),
        "joint_state": Demultiplexer([plant.num_positions(), nv]),
        "joint_torques": Demultiplexer([nv, nv]),
    }
    connections = {
        "joint_state": "plant.state",
        "tool_interface.plant_state": "plant.state",
        "tool_interface.generalized_acceleration": "plant.generalized_acceleration",
        "tool_motion": "tool_interface.tool_kinematics",
        "joint_torques": "tool_interface.joint_torques",
    }
    applied = "joint_torques.y0"
    reaction = "joint_torques.y1"
    if drive is not None and drive != JointDrive():
        reaction = _AddDrive(systems, connections, drive)
        applied = "torque_limits"
    connections["plant.applied_generalized_force"] = reaction
    connections["plant.actuation"] = applied
    if not is_ordered:
        _AddMotorOrder(systems, connections)
    return Wire(
        Diagram(),
        "robot",
        systems,
        inputs={
            "control_force": ["tool_interface.control_force"],
            "environment_force": ["tool_interface.environment_force"],
        },
        connections=connections,
        outputs={
            "tool_position": "tool_motion.y0",
            "tool_velocity": "tool_motion.y1",
            "tool_acceleration": "tool_interface.tool_acceleration",
            "joint_position": "joint_state.y0",
            "joint_velocity": "joint_state.y1",
            "joint_torque": applied,
        },
    )


def _AddMotorOrder(systems: dict[str, System], connections: Connections) -> None:
    """Puts the torques of the joints into the order of the motors."""
    systems["motor_order"] = MatrixGain(systems["plant"].MakeActuationMatrix().T)
    connections["motor_order"] = connections["plant.actuation"]
    connections["plant.actuation"] = "motor_order"


def _AddDrive(
    systems: dict[str, System], connections: Connections, drive: JointDrive
) -> str:
    """Adds a drive between the torques of the task and `torque_limits`.

    Returns:
        The place (see wiring) of the sum of all torques except those of the motors.
    """
    # The places of the terms of the motors' torque, and of the other torques.
    motors = ["joint_torques.y0"]
    others = ["joint_torques.y1"]
    parts = {
        "posture_hold": (drive.hold, "plant.state", motors),
        "gravity_compensation": (drive.gravity_compensation, "plant.state", motors),
        "joint_friction": (drive.friction, "joint_state.y1", others),
    }
    for name, (system, signal, torques) in parts.items():
        if system is not None:
            systems[name] = system
            connections[name] = signal
            torques.append(name)
    # The motors' torque is within the effort limits of the actuators.
    plant = systems["plant"]
    limits = np.zeros(plant.num_velocities())
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        limits[actuator.joint().velocity_start()] = actuator.effort_limit()
    systems["torque_limits"] = Saturation(-limits, limits)
    connections["torque_limits"] = _AddSum(systems, connections, "motor", motors)
    return _AddSum(systems, connections, "other", others)


def _AddSum(
    systems: dict[str, System], connections: Connections, name: str, terms: list[str]
) -> str:
    """Adds the sum of the torques at the given places, and returns its place."""
    if len(terms) == 1:
        return terms[0]
    size = systems["plant"].num_velocities()
    systems[f"{name}_torques"] = Adder(len(terms), size)
    for i, term in enumerate(terms):
        connections[f"{name}_torques.u{i}"] = term
    return f"{name}_torques"


def _AreMotorsInOrder(plant: MultibodyPlant) -> bool:
    """Returns whether joint torques can be connected to the motors directly.

    If the actuation matrix B is a permutation, tau = B u requires the motor torques
    u = B^T tau, which are in the order of tau only if B is the identity. If B is no
    permutation, ToolInterface refuses the plant.
    """
    B = plant.MakeActuationMatrix()
    identity = np.eye(plant.num_velocities())
    is_permutation = B.shape == identity.shape and np.array_equal(B @ B.T, identity)
    return not is_permutation or np.array_equal(B, identity)

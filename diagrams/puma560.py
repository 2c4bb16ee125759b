"""A Puma 560 in space, built from its blocks.

The task moves the needle's tip along three axes. The arm has six joints, weight and
friction. Five torques act at its joints: the torque of the task, the torque that holds
the direction of the needle, the compensation of gravity, the torque of the environment,
and friction. The motors apply the first three, whose sum is limited.

`MakeRobot(model="puma560", start=...)` makes this diagram in one call. Run `python
diagrams/puma560.py`: it draws the robot beside this file (or into the file given as an
argument), pushes at the needle for half a second, and prints the distance and the angle
by which it moved. `teleop-drake compare puma560_insertion` simulates the whole loop.
"""

import math
import sys
from pathlib import Path

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    Demultiplexer,
    Saturation,
)

from teleop_drake.loops.draw.block_diagram import WriteDiagram
from teleop_drake.model.blocks.robots import Puma560Config
from teleop_drake.model.blocks.systems.gravity_compensation import GravityCompensation
from teleop_drake.model.blocks.systems.joint_friction import JointFriction
from teleop_drake.model.blocks.systems.posture_hold import PostureHold
from teleop_drake.model.blocks.systems.tool_interface import ToolInterface
from teleop_drake.model.laws.task_space import PostureGains

START = np.array([0.6, -0.15, 0.4])
EFFORT_LIMITS = np.array([97.6, 186.4, 89.4, 24.2, 20.1, 21.3])  # N m


def MakePuma() -> Diagram:
    """Makes the robot, from the forces at the tool to the motion of the tool."""
    config = Puma560Config(start=START)
    builder = DiagramBuilder()

    # The arm, and the coordinates of its tool in the task.
    plant = builder.AddNamedSystem("plant", config.LoadPlant())
    q_0 = config.JointPositions(START)
    plant.SetDefaultPositions(q_0)
    tool = builder.AddNamedSystem(
        "tool_interface", ToolInterface(plant=plant, num_task_axes=3)
    )
    torques = builder.AddNamedSystem("joint_torques", Demultiplexer([6, 6]))
    motion = builder.AddNamedSystem("tool_motion", Demultiplexer([3, 3, 18]))
    joints = builder.AddNamedSystem("joint_state", Demultiplexer([6, 6]))

    # The torques in addition to those of the task.
    hold = builder.AddNamedSystem(
        "posture_hold",
        PostureHold(
            plant=plant,
            num_axes=3,
            tool_name="tool",
            joint_positions=q_0,
            gains=PostureGains(
                frequency=10.0, damping_ratio=1.0, near=1e-3, damping=1e-2
            ),
            keeps_orientation=True,
        ),
    )
    weight = builder.AddNamedSystem(
        "gravity_compensation", GravityCompensation(model=config.LoadPlant())
    )
    friction = builder.AddNamedSystem(
        "joint_friction",
        JointFriction(
            forward=[24.7, 13.6, 7.1, 0.85, 0.67, 0.30],  # N m
            backward=[27.2, 7.7, 5.6, 1.29, 1.04, 0.81],
            speed=0.02,  # rad/s
        ),
    )
    motors = builder.AddNamedSystem("motor_torques", Adder(3, 6))
    limits = builder.AddNamedSystem(
        "torque_limits", Saturation(-EFFORT_LIMITS, EFFORT_LIMITS)
    )
    others = builder.AddNamedSystem("other_torques", Adder(2, 6))

    state = plant.get_state_output_port()
    for source, target in (
        (state, tool.GetInputPort("plant_state")),
        (state, hold.GetInputPort("plant_state")),
        (state, weight.GetInputPort("plant_state")),
        (state, joints.get_input_port()),
        (
            plant.get_generalized_acceleration_output_port(),
            tool.GetInputPort("generalized_acceleration"),
        ),
        (tool.GetOutputPort("tool_kinematics"), motion.get_input_port()),
        (tool.GetOutputPort("joint_torques"), torques.get_input_port()),
        (joints.get_output_port(1), friction.GetInputPort("joint_velocity")),
        (torques.get_output_port(0), motors.get_input_port(0)),
        (hold.GetOutputPort("hold_torque"), motors.get_input_port(1)),
        (weight.GetOutputPort("gravity_torque"), motors.get_input_port(2)),
        (motors.get_output_port(), limits.get_input_port()),
        (limits.get_output_port(), plant.get_actuation_input_port()),
        (torques.get_output_port(1), others.get_input_port(0)),
        (friction.GetOutputPort("friction_torque"), others.get_input_port(1)),
        (others.get_output_port(), plant.get_applied_generalized_force_input_port()),
    ):
        builder.Connect(source, target)
    builder.ExportInput(tool.GetInputPort("control_force"), "control_force")
    builder.ExportInput(tool.GetInputPort("environment_force"), "environment_force")
    builder.ExportOutput(motion.get_output_port(0), "tool_position")
    builder.ExportOutput(motion.get_output_port(1), "tool_velocity")
    builder.ExportOutput(joints.get_output_port(0), "joint_position")
    robot = builder.Build()
    robot.set_name("robot")
    return robot


def main(picture: Path) -> None:
    robot = MakePuma()
    WriteDiagram(robot, picture)

    # A push of 25 N along the needle, without an environment.
    builder = DiagramBuilder()
    builder.AddNamedSystem("robot", robot)
    for name, force in (
        ("control_force", [25.0, 0, 0]),
        ("environment_force", [0, 0, 0]),
    ):
        source = builder.AddNamedSystem(name, ConstantVectorSource(force))
        builder.Connect(source.get_output_port(), robot.GetInputPort(name))
    simulator = Simulator(builder.Build())
    context = robot.GetMyContextFromRoot(simulator.get_context())
    plant = Puma560Config(start=START).LoadPlant()
    poses = []
    for time in (0.0, 0.5):
        simulator.AdvanceTo(time)
        plant_context = plant.CreateDefaultContext()
        q = robot.GetOutputPort("joint_position").Eval(context)
        plant.SetPositions(plant_context, q)
        tool = plant.GetFrameByName("tool")
        poses.append(tool.CalcPoseInWorld(plant_context))
    moved = poses[1].translation() - poses[0].translation()
    turned = RotationMatrix(poses[0].inverse().rotation() @ poses[1].rotation())
    angle = math.degrees(turned.ToAngleAxis().angle())
    along = 1000 * moved[0]
    print(f"the needle went {along:.1f} mm along x and turned by {angle:.2f} deg")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).with_suffix(".svg"))

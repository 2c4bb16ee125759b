"""The one-axis teleoperator of chapter 4, wired by hand from its blocks.

Every number of the thesis's one-axis task is given below, at the block that uses it.
Run `python diagrams/one_dof_by_hand.py`: it draws the diagram beside this file (or into
the file given as an argument) and simulates the first two seconds.
"""

import math
import sys
from pathlib import Path

from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Demultiplexer, Multiplexer

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.draw.block_diagram import WriteDiagram
from teleop_drake.loops.run.simulator import MakeSimulator
from teleop_drake.model.blocks.architectures.adaptive_backstepping import (
    AdaptiveBackstepping,
)
from teleop_drake.model.blocks.environments import Surface
from teleop_drake.model.blocks.environments.layered_force_field import LayeredForceField
from teleop_drake.model.blocks.operators import ConstantVelocityOperator
from teleop_drake.model.blocks.robots import MakeRobot
from teleop_drake.model.blocks.systems.haptic_device import HapticDevice
from teleop_drake.model.laws.backstepping import BacksteppingGains
from teleop_drake.model.laws.gaussian_network import GaussianNetwork
from teleop_drake.model.scenario import LayerConfig


def MakeOneDofByHand() -> Diagram:
    """Makes the teleoperator of chapter 4 from its blocks."""
    builder = DiagramBuilder()

    # The blocks, in the order of the picture from left to right. The master: the haptic
    # device and its operator.
    haptic_device = builder.AddNamedSystem(
        "haptic_device",
        HapticDevice(numerator=[25, 50], denominator=[1, 25, 0], num_axes=1),
    )
    operator = builder.AddNamedSystem(
        "surgeon",
        ConstantVelocityOperator(
            velocity=[0.001],
            contact_force=[0.005],
            contact_surface=Surface("contact", point_W=[0.015], normal_W=[1.0]),
        ),
    )

    # The forward channel transmits the haptic force and the velocity command.
    pack_forward = builder.AddNamedSystem("pack_forward", Multiplexer([1, 1]))
    forward_channel = builder.AddNamedSystem(
        "forward_channel", TransportDelay(delay=0.1, size=2)
    )
    unpack_forward = builder.AddNamedSystem("unpack_forward", Demultiplexer([1, 1]))

    # The slave: controller, robot and environment.
    controller = builder.AddNamedSystem(
        "controller",
        AdaptiveBackstepping(
            gains=BacksteppingGains(
                Lambda=[[1.0]],
                G1=[[2.0]],
                G2=[[20.0]],
                P=[[1.0]],
                beta1=0.1,
                beta2=0.1,
                beta3=0.1,
                nu1=0.1,
                nu3=0.1,
                Upsilon=1.0,
                Psi0=[[4.3]],
                Psi_min=0.1,
            ),
            network=GaussianNetwork(lower=[0.0], upper=[0.015], count=[5], width=1.0),
        ),
    )
    robot = builder.AddNamedSystem(
        "robot", MakeRobot(model="slider", start=[0.0], mass=0.5, damping=0.1)
    )
    environment = builder.AddNamedSystem(
        "environment",
        LayeredForceField(
            layers=[
                LayerConfig(
                    name="tissue", start=-math.inf, stiffness=0.01, damping=0.5
                ),
                LayerConfig(name="free", start=0.0075),
                LayerConfig(name="bone", start=0.015, stiffness=150.0, reference=0.015),
            ],
            num_axes=1,
        ),
    )

    # The return channel transmits the position and the velocity of the tool.
    pack_return = builder.AddNamedSystem("pack_return", Multiplexer([1, 1]))
    return_channel = builder.AddNamedSystem(
        "return_channel", TransportDelay(delay=0.1, size=2)
    )
    unpack_return = builder.AddNamedSystem("unpack_return", Demultiplexer([1, 1]))

    # The connections, in the order in which a signal runs through the loop.
    velocity_command = operator.GetOutputPort("velocity_command")
    builder.Connect(velocity_command, haptic_device.GetInputPort("velocity_command"))
    builder.Connect(
        haptic_device.GetOutputPort("haptic_force"),
        operator.GetInputPort("haptic_force"),
    )
    builder.Connect(
        operator.GetOutputPort("force_command"), pack_forward.get_input_port(0)
    )
    builder.Connect(velocity_command, pack_forward.get_input_port(1))
    builder.Connect(
        pack_forward.get_output_port(), forward_channel.GetInputPort("signal")
    )
    builder.Connect(
        forward_channel.GetOutputPort("delayed_signal"),
        unpack_forward.get_input_port(),
    )
    builder.Connect(
        unpack_forward.get_output_port(0), controller.GetInputPort("haptic_force")
    )
    builder.Connect(
        unpack_forward.get_output_port(1), controller.GetInputPort("velocity_command")
    )
    builder.Connect(
        controller.GetOutputPort("control_force"), robot.GetInputPort("control_force")
    )
    for name in ("tool_position", "tool_velocity"):
        builder.Connect(robot.GetOutputPort(name), environment.GetInputPort(name))
        builder.Connect(robot.GetOutputPort(name), controller.GetInputPort(name))
    for system in (robot, controller):
        builder.Connect(
            environment.GetOutputPort("environment_force"),
            system.GetInputPort("environment_force"),
        )
    builder.Connect(robot.GetOutputPort("tool_position"), pack_return.get_input_port(0))
    builder.Connect(robot.GetOutputPort("tool_velocity"), pack_return.get_input_port(1))
    builder.Connect(
        pack_return.get_output_port(), return_channel.GetInputPort("signal")
    )
    builder.Connect(
        return_channel.GetOutputPort("delayed_signal"), unpack_return.get_input_port()
    )
    builder.Connect(
        unpack_return.get_output_port(0), operator.GetInputPort("felt_position")
    )
    builder.Connect(
        unpack_return.get_output_port(1), haptic_device.GetInputPort("felt_velocity")
    )

    diagram = builder.Build()
    diagram.set_name("one_dof_by_hand")
    return diagram


def main(picture: Path) -> None:
    diagram = MakeOneDofByHand()
    WriteDiagram(diagram, picture, max_depth=1)

    # Drake's Simulator, configured for signals that jump and are delayed. The plain
    # Simulator(diagram) locates no contact unless its Context has an accuracy; the
    # blocks warn about this.
    simulator = MakeSimulator(
        diagram,
        SimulatorConfig(
            # Dormand-Prince 5(4), which Simulink calls ode45.
            integration_scheme="runge_kutta5",
            use_error_control=True,
            accuracy=1e-8,
            max_step_size=0.05,
        ),
    )
    simulator.AdvanceTo(2.0)
    robot = diagram.GetSubsystemByName("robot")
    velocity = robot.GetOutputPort("tool_velocity").Eval(
        robot.GetMyContextFromRoot(simulator.get_context())
    )
    print(f"tool velocity after 2 s: {1000 * velocity[0]:.4f} mm/s (commanded: 1)")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).with_suffix(".svg"))

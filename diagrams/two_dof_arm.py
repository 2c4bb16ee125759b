"""The two-axis teleoperator of chapter 5, built from its stations.

The six boxes are those of Fig. 2.1. Their numbers are from a scenario file. Run
`python diagrams/two_dof_arm.py`: it draws the diagram beside this file (or into the
file given as an argument) and simulates the first second.
"""

import sys
from pathlib import Path

from pydrake.systems.framework import Diagram, DiagramBuilder

from teleop_drake.loops.draw.block_diagram import WriteDiagram
from teleop_drake.loops.run.simulator import MakeSimulator
from teleop_drake.model.blocks.environments.layered_force_field import LayeredForceField
from teleop_drake.model.blocks.robots import MakeRobot
from teleop_drake.model.scenario import LoadScenario, Scenario
from teleop_drake.model.stations import MakeArchitecture, MakeMasterStation


def MakeTwoDofArm(scenario: Scenario) -> Diagram:
    """Makes the teleoperator of a scenario with the two-link arm from its stations."""
    start = scenario.robot.start
    builder = DiagramBuilder()
    master = builder.AddNamedSystem("master", MakeMasterStation(scenario))
    # Until the first signals arrive, the robot receives a force and a command of zero,
    # and the operator feels the tool at rest at its start.
    forward_channel = builder.AddNamedSystem(
        "forward_channel",
        scenario.forward_channel.MakeChannel(size=4, initial_value=[0.0] * 4),
    )
    controller = builder.AddNamedSystem(
        "controller", MakeArchitecture(scenario).slave_side
    )
    robot = builder.AddNamedSystem(
        "robot",
        MakeRobot(model="two_link_arm", start=start, elbow=scenario.robot.elbow),
    )
    environment = builder.AddNamedSystem(
        "environment",
        LayeredForceField(layers=scenario.environment.layers, num_axes=2),
    )
    return_channel = builder.AddNamedSystem(
        "return_channel",
        scenario.return_channel.MakeChannel(size=4, initial_value=[*start, 0.0, 0.0]),
    )

    def connect(source, output, target, input):
        builder.Connect(source.GetOutputPort(output), target.GetInputPort(input))

    connect(master, "forward_packet", forward_channel, "signal")
    connect(forward_channel, "delayed_signal", controller, "forward_packet")
    connect(controller, "control_force", robot, "control_force")
    for system in (environment, controller):
        connect(robot, "tool_position", system, "tool_position")
        connect(robot, "tool_velocity", system, "tool_velocity")
    for system in (robot, controller):
        connect(environment, "environment_force", system, "environment_force")
    connect(controller, "return_packet", return_channel, "signal")
    connect(return_channel, "delayed_signal", master, "return_packet")

    diagram = builder.Build()
    diagram.set_name("two_dof_arm")
    return diagram


def main(picture: Path) -> None:
    scenario = LoadScenario("two_dof_combined")
    diagram = MakeTwoDofArm(scenario)
    WriteDiagram(diagram, picture, max_depth=1)

    # Drake's Simulator, configured for signals that jump and are delayed.
    simulator = MakeSimulator(diagram, scenario.simulator)
    simulator.AdvanceTo(1.0)
    robot = diagram.GetSubsystemByName("robot")
    x, y = robot.GetOutputPort("tool_position").Eval(
        robot.GetMyContextFromRoot(simulator.get_context())
    )
    print(f"tool after 1 s: x = {x:.4f} m, y = {y:.6f} m")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).with_suffix(".svg"))

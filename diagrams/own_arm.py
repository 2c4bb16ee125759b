"""An arm of your own, from a URDF file.

own_arm.urdf beside this file is an arm of three joints, and own_arm.yaml is a task for
it along three axes. The robot is defined by `robot: {model: arm, file: own_arm.urdf,
...}` only. Run `python diagrams/own_arm.py`: it draws the robot beside this file (or
into the file given as an argument), simulates the task, and prints the mass at the tool
and the force of the first impact on the wall.

The scenario also runs on the command line: `teleop-drake run diagrams/own_arm.yaml`.
"""

import sys
from pathlib import Path

from teleop_drake.loops.draw.block_diagram import WriteDiagram
from teleop_drake.model.blocks.robots import FactsOfRobot
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.model.teleoperator import MakeTeleoperator


def main(picture: Path) -> None:
    scenario = LoadScenario(Path(__file__).with_suffix(".yaml"))
    teleoperator = MakeTeleoperator(scenario)
    robot = teleoperator.GetSubsystemByName("robot")
    WriteDiagram(robot, picture)

    mass = FactsOfRobot(robot).inertia.diagonal()
    print("mass at the tool: x, y, z = " + ", ".join(f"{m:.3f}" for m in mass) + " kg")
    collision = RunMetrics(simulate(scenario, teleoperator=teleoperator))["collision"]
    print(f"first impact: {collision['initial_impact_force']:.3f} N")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).with_suffix(".svg"))

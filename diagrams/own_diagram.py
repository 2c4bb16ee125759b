"""A delay in a diagram of your own: one of Drake's plants with late feedback.

From this package the diagram has only the delay. simulate() compiles it to machine
code, with an exact delay, and records the exported outputs.

Run `python diagrams/own_diagram.py`: it draws the diagram beside this file (or into the
file given as an argument), simulates a step response, and prints its overshoot with and
without the delay.
"""

import sys
from pathlib import Path

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder, ConstantVectorSource, Gain, Integrator

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.draw.block_diagram import WriteDiagram
from teleop_drake.model.run.simulate import simulate


def MakeDiagram(delay: float = 0.4) -> Diagram:
    """Makes y' = 2 (1 - y(t - delay))."""
    builder = DiagramBuilder()
    reference = builder.AddNamedSystem("reference", ConstantVectorSource([1.0]))
    error = builder.AddNamedSystem("error", Adder(2, 1))
    controller = builder.AddNamedSystem("controller", Gain(2.0, 1))
    plant = builder.AddNamedSystem("plant", Integrator(1))
    sensor = builder.AddNamedSystem("sensor", TransportDelay(delay=delay, size=1))
    minus = builder.AddNamedSystem("minus", Gain(-1.0, 1))
    builder.Connect(reference.get_output_port(), error.get_input_port(0))
    builder.Connect(error.get_output_port(), controller.get_input_port())
    builder.Connect(controller.get_output_port(), plant.get_input_port())
    builder.Connect(plant.get_output_port(), sensor.get_input_port())
    builder.Connect(sensor.get_output_port(), minus.get_input_port())
    builder.Connect(minus.get_output_port(), error.get_input_port(1))
    builder.ExportOutput(plant.get_output_port(), "position")
    builder.ExportOutput(sensor.get_output_port(), "measured")
    diagram = builder.Build()
    diagram.set_name("late_feedback")
    return diagram


def main(picture: Path) -> None:
    WriteDiagram(MakeDiagram(0.4), picture, max_depth=1)
    for delay in (0.0, 0.2, 0.4):
        recording = simulate(MakeDiagram(delay), duration=5.0)
        overshoot = 100 * np.maximum(recording["position"].max() - 1, 0)
        print(f"{delay:g} s late: overshoot {overshoot:.2f} %")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).with_suffix(".svg"))

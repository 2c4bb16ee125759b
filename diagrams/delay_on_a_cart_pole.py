"""A delay in the loop of a cart-pole: Drake's LQR, 50 ms late.

DelayMargin() returns the longest delay of the measured state with which the pole does
not fall, and simulate() confirms it on both sides. In the page the delay is a slider.

Run `python diagrams/delay_on_a_cart_pole.py`: it draws the diagram beside this file (or
into the file given as an argument) and writes the page into a second file if one is
given. It prints the margin, and whether a small push decays or grows with a delay
slightly below and above the margin.
"""

import sys
from pathlib import Path

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.controllers import LinearQuadraticRegulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import AffineSystem

from teleop_drake import DelayMargin, TransportDelay, WriteDiagram, WritePage, simulate

CART_POLE = "package://drake/examples/multibody/cart_pole/cart_pole.sdf"

# Position of the cart, angle of the pole, and their rates.
UPRIGHT = np.array([0.0, np.pi, 0.0, 0.0])


def MakeCartPole() -> MultibodyPlant:
    """Makes Drake's cart-pole, which is upright by default."""
    plant = MultibodyPlant(time_step=0.0)
    Parser(plant).AddModelsFromUrl(CART_POLE)
    plant.Finalize()
    plant.SetDefaultPositions(UPRIGHT[:2])
    return plant


def MakeLqr() -> AffineSystem:
    """Makes the regulator of the upright pole, designed without a delay."""
    plant = MakeCartPole()
    context = plant.CreateDefaultContext()
    motor = plant.get_actuation_input_port()
    motor.FixValue(context, [0.0])
    Q = np.diag([10.0, 10.0, 1.0, 1.0])
    R = np.array([[1.0]])
    # Drake linearises the plant at this Context.
    return LinearQuadraticRegulator(
        plant, context, Q, R, input_port_index=int(motor.get_index())
    )


def MakeDiagram(delay: float = 0.05) -> Diagram:
    """The regulator holds the pole upright and receives the state late."""
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", MakeCartPole())
    sensor = builder.AddNamedSystem(
        "sensor", TransportDelay(delay, 4, initial_value=UPRIGHT)
    )
    lqr = builder.AddNamedSystem("lqr", MakeLqr())
    builder.Connect(plant.get_state_output_port(), sensor.get_input_port())
    builder.Connect(sensor.get_output_port(), lqr.get_input_port())
    builder.Connect(lqr.get_output_port(), plant.get_actuation_input_port())
    builder.ExportOutput(plant.get_state_output_port(), "state")
    diagram = builder.Build()
    diagram.set_name("delay_on_a_cart_pole")
    return diagram


def MakePushed(diagram: Diagram, push: float) -> Context:
    """Makes a Context in which the pole initially turns with `push`, rad/s."""
    context = diagram.CreateDefaultContext()
    plant = diagram.GetSubsystemByName("plant")
    start = [*UPRIGHT[:3], push]
    plant.GetMyMutableContextFromRoot(context).SetContinuousState(start)
    return context


def main(picture: Path, page: Path | None) -> None:
    diagram = MakeDiagram(0.05)
    WriteDiagram(diagram, picture, max_depth=1)
    if page is not None:
        WritePage(
            diagram, page, context=MakePushed(diagram, 0.1), vary={"delay": (0, 0.2)}
        )
    sensor = diagram.GetSubsystemByName("sensor")
    context = diagram.CreateDefaultContext()
    more = DelayMargin(diagram, context, sensor.get_output_port())
    margin = 0.05 + more
    print(f"50 ms late; {1e3 * more:.2f} ms more are tolerated: {1e3 * margin:.2f} ms")
    for share in (0.97, 1.03):
        late = MakeDiagram(share * margin)
        recording = simulate(late, context=MakePushed(late, 1e-6), duration=20.0)
        size = np.abs(recording["state"] - UPRIGHT).max(axis=1)
        early, end = (size[recording.time > t].max() for t in (5.0, 19.0))
        change = "decays" if end < early else "grows"
        print(f"{1e3 * share * margin:.2f} ms late: the push {change}")


if __name__ == "__main__":
    files = [Path(name) for name in sys.argv[1:3]]
    main(
        files[0] if files else Path(__file__).with_suffix(".svg"),
        files[1] if files[1:] else None,
    )

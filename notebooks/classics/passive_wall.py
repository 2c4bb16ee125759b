"""Passivity control of a wall at 1 kHz. (Hannaford and Ryu.)

A passivity observer adds up the energy that a one-port has absorbed, and a passivity
controller adds a damper as soon as that energy is negative. Hannaford and Ryu observe

    E(n) = T sum_k f(k) v(k),   alpha(n) = -E(n)/(T v(n)^2) if E(n) < 0, else 0

with the force f + alpha v. A force that is held between samples does work that samples
of the velocity do not show. What the tool has given to the wall is exactly

    E(n) = sum_k F_(k-1) (x_k - x_(k-1))

with the force F_(k-1) that was held, because that force is constant between samples.
This sum is the observer here.

Sources: B. Hannaford and J.-H. Ryu, "Time-domain passivity control of haptic
interfaces", IEEE Trans. Robotics and Automation 18 (2002); S. Stramigioli, C. Secchi,
A. van der Schaft and C. Fantuzzi, "Sampled data systems passivity and discrete
port-Hamiltonian systems", IEEE Trans. Robotics 21 (2005), for the exact sum.
"""

from typing import ClassVar

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import AffineSystem, Demultiplexer

from classics import InPageStyle
from teleop_drake import Recording, simulate
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.kernel import Kernel, KernelBlock, Transition
from teleop_drake.study.figures.style import COLORS, GREY, LINES, Figure

PERIOD = 1e-3  # s
STIFFNESS = 5000.0  # N/m
MASS = 0.5  # kg
FRICTION = 0.1  # N s/m; passive are b > K T/2 = 2.5 N s/m
PUSH = 1.0  # N
START = -0.01  # m
DURATION = 2.0  # s
LARGEST_DAMPING = 50.0  # N s/m


class PassiveWall(KernelBlock):
    """A wall in x > 0 that is sampled, observed and, if need be, damped.

    | port | name     | size | unit                       |
    |------|----------|------|----------------------------|
    | in   | position | 1    | m                          |
    | out  | force    | 1    | N, held between samples    |
    | out  | energy   | 1    | J, absorbed by the wall    |

    | parameter | name            | unit  |
    |-----------|-----------------|-------|
    | 0         | stiffness       | N/m   |
    | 1         | largest_damping | N s/m |

    State (discrete, 3): [position of the last sample, force, energy].

    Args:
        largest_damping: Of the passivity controller; 0: there is none.
    """

    numeric_parameters: ClassVar = {"stiffness": "N/m", "largest_damping": "N s/m"}

    def __init__(self, largest_damping: float):
        KernelBlock.__init__(self)
        self._largest_damping = largest_damping
        self.DeclareVectorInputPort("position", 1)
        self.DeclareDiscreteState([START, 0.0, 0.0])
        self.DeclareOutputs(force=1, energy=1)

    def Kernel(self) -> Kernel:
        """Returns what the block computes."""
        law = (next_sample, "mode", "position", "stiffness", "largest_damping")
        return Kernel(
            parameters={
                "stiffness": STIFFNESS,
                "largest_damping": self._largest_damping,
            },
            outputs={"force": ("mode", 1, 2), "energy": ("mode", 2, 3)},
            transitions={"samples": Transition(mode=law, period=PERIOD)},
        )


def next_sample(
    mode: Array, position: Array, stiffness: float, largest_damping: float
) -> Array:
    """Returns [position, force, energy] from one sample to the next."""
    x, (last_x, held_force, energy) = position[0], mode
    step = x - last_x
    energy = energy + held_force * step
    velocity = step / PERIOD
    damping = 0.0
    if energy < 0 and velocity != 0:
        damping = min(-energy / (PERIOD * velocity**2), largest_damping)
    force = stiffness * max(x, 0.0) + damping * velocity
    return np.array([x, force, energy])


def MakeContact(largest_damping: float) -> Diagram:
    """Makes a tool that a hand pushes against the wall with a constant force."""
    builder = DiagramBuilder()
    tool = builder.AddNamedSystem(
        "tool",
        AffineSystem(
            A=[[0, 1], [0, -FRICTION / MASS]],
            B=[[0], [-1 / MASS]],
            f0=[0, PUSH / MASS],
            C=np.eye(2),
            D=np.zeros((2, 1)),
            y0=[0, 0],
        ),
    )
    tool.configure_default_state([START, 0])
    motion = builder.AddNamedSystem("motion", Demultiplexer([1, 1]))
    wall = builder.AddNamedSystem("wall", PassiveWall(largest_damping))
    builder.Connect(tool.get_output_port(), motion.get_input_port())
    builder.Connect(motion.get_output_port(0), wall.GetInputPort("position"))
    builder.Connect(wall.GetOutputPort("force"), tool.get_input_port())
    builder.ExportOutput(motion.get_output_port(0), "position")
    builder.ExportOutput(motion.get_output_port(1), "velocity")
    for name in ("force", "energy"):
        builder.ExportOutput(wall.GetOutputPort(name), name)
    diagram = builder.Build()
    diagram.set_name("contact")
    return diagram


def Contact(largest_damping: float) -> Recording:
    """Returns the run of a tool that is pushed against the wall."""
    return simulate(MakeContact(largest_damping), duration=DURATION)


def SumsOfSamples(recording: Recording) -> tuple[float, float]:
    """Returns T sum f(k) v(k) in J, which the wall seems to absorb.

    First with the velocity at the samples, and then with differences of the positions.
    """
    samples = PERIOD * np.arange(round(DURATION / PERIOD))
    # The force that follows from a sample is there until the next one.
    force = recording.Interpolate("force", samples + PERIOD / 2)[:, 0]
    velocity = recording.Interpolate("velocity", samples)[:, 0]
    position = recording.Interpolate("position", samples)[:, 0]
    steps = np.diff(position, prepend=position[0])
    return float(PERIOD * force @ velocity), float(force @ steps)


@InPageStyle
def Draw() -> Figure:
    """Draws position and absorbed energy without and with the controller."""
    figure = Figure(figsize=(7.0, 2.2))
    left, right = figure.subplots(1, 2)
    by_name = {"no controller": 0.0, "passivity controller": LARGEST_DAMPING}
    for i, (name, largest_damping) in enumerate(by_name.items()):
        run = Contact(largest_damping)
        look = {"color": COLORS[1 - i], "lw": 1, "label": name}
        left.plot(run.time, 1e3 * run["position"][:, 0], ls=LINES[i], **look)
        right.plot(run.time, 1e3 * run["energy"][:, 0], ls=LINES[i], **look)
    for ax in (left, right):
        ax.axhline(0, color=GREY, lw=0.6)
        ax.set_xlabel("time [s]")
    left.set_ylabel("position [mm]")
    right.set_ylabel("absorbed energy [mJ]")
    left.set_title("the wall is above 0")
    left.legend(loc="lower left")
    return figure

"""An environment of your own: a floor under the arm, softer at first touch.

It consists of the two classes below: a block with two inputs and one output, and a
config that makes it. The block provides its surface, a point and a normal, which the
operator, the events, the metrics and the analysis use. The config can be named in a
scenario file or on the command line if this folder is on Python's path:

    teleop-drake run two_dof_collision --set "environment={kind: own_environment:Floor}"

The block's law is a separate function, which `Kernel` names. Drake's Simulator and
compiled runs (`--engine compiled`) both use it.

Run `python diagrams/own_environment.py`: it draws the loop with the floor beside this
file (or into the file given as an argument), simulates how the arm moves down on to the
floor, and prints the time of the contact and the force of the first impact.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teleop_drake.loops.draw.block_diagram import WriteDiagram
from teleop_drake.loops.framework.validation import Number
from teleop_drake.loops.kernel import Kernel, KernelBlock
from teleop_drake.model.blocks.environments import EnvironmentConfig, Surface
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.model.teleoperator import MakeTeleoperator


def hunt_crossley_force(K, B, point_W, normal_W, p_WT, v_WT):
    """Returns the force on the wall in N (n)."""
    depth = max(np.sum((p_WT - point_W) * normal_W), 0.0)
    speed = np.sum(v_WT * normal_W)
    return max(K * depth**1.5 * (1 + B * speed), 0.0) * normal_W


class HuntCrossleyWall(KernelBlock):
    """F_e = K d^(3/2) (1 + B d') along the normal, at the depth d > 0.

    Source: K. H. Hunt and F. R. E. Crossley, "Coefficient of restitution interpreted as
    damping in vibroimpact", J. Applied Mechanics 42 (1975).
    """

    def __init__(self, *, surface, stiffness, damping):
        KernelBlock.__init__(self)
        self._surface = surface
        self._parameters = {
            "stiffness": stiffness,
            "damping": damping,
            "point": surface.point_W,
            "normal": surface.normal_W,
        }
        n = surface.normal_W.size
        self.DeclareVectorInputPort("tool_position", n)
        self.DeclareVectorInputPort("tool_velocity", n)
        self.DeclareOutputs(environment_force=n)

    def Surfaces(self):
        return [self._surface]

    def Kernel(self):
        return Kernel(
            parameters=self._parameters,
            outputs={
                "environment_force": (
                    hunt_crossley_force,
                    *self._parameters,
                    "tool_position",
                    "tool_velocity",
                )
            },
        )


@dataclass(kw_only=True, eq=False)
class Floor(EnvironmentConfig):
    """A floor at `y`, which is stiff below."""

    # The height of the floor, m.
    y: float = Number(-0.05, "m")
    # K, N/m^(3/2), > 0.
    stiffness: float = Number(1000.0, "N/m^1.5", above=0)
    # B, s/m, >= 0.
    damping: float = Number(2.0, "s/m", minimum=0)

    def MakeEnvironment(self, start):
        n = np.size(start)
        normal_W = -np.eye(n)[1]  # Downwards, into the floor.
        surface = Surface("contact", -self.y * normal_W, normal_W)
        return HuntCrossleyWall(
            surface=surface, stiffness=self.stiffness, damping=self.damping
        )


def main(picture: Path) -> None:
    scenario = LoadScenario(
        "two_dof_collision",
        ["surgeon.velocity=[0, -0.1]", "surgeon.contact_force=[0, -0.2]", "duration=2"],
    )
    scenario.environment = Floor()
    WriteDiagram(MakeTeleoperator(scenario), picture, max_depth=1)

    collision = RunMetrics(simulate(scenario, engine="auto"))["collision"]
    time, force = collision["time"], collision["initial_impact_force"]
    print(f"touches the floor at {time:.3f} s; first impact {force:.3f} N")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).with_suffix(".svg"))

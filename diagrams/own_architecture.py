"""An architecture of your own: the control laws at both ends of the channels.

It consists of the two blocks CompliantMaster and BrakedSlave below. They define the
contents of their packets, and the channels have the widths of their ports. The hand is
compliant until its force has returned from the tool, and the tool is braked.

Run `python diagrams/own_architecture.py`: it draws the master station with the new side
beside this file (or into the file given as an argument), simulates the one-axis task
with this architecture and with direct force application, and prints the velocity
overshoot of the tool after the puncture.
"""

import sys
from pathlib import Path

import numpy as np
from pydrake.systems.framework import LeafSystem

from teleop_drake.loops.draw.block_diagram import WriteDiagram
from teleop_drake.model.blocks.architectures import Architecture
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.model.teleoperator import MakeTeleoperator


def Declare(system, name, size, calc, *inputs):
    """Declares an output of a system that depends on these inputs only."""
    system.DeclareVectorOutputPort(
        name,
        size,
        lambda context, output: output.SetFromVector(
            calc(*(port.Eval(context) for port in inputs))
        ),
        prerequisites_of_calc={port.ticket() for port in inputs},
    )


class CompliantMaster(LeafSystem):
    """Sends F_h. From the return packet [p_WT; v; F], feels v + (F_h - F) / damping."""

    def __init__(self, damping):
        LeafSystem.__init__(self)
        self.set_name("compliant_master")
        F_h = self.DeclareVectorInputPort("haptic_force", 1)
        self.DeclareVectorInputPort("velocity_command", 1)
        packet = self.DeclareVectorInputPort("return_packet", 3)

        def Feel(packet, F):
            return packet[1:2] + (F - packet[2:]) / damping

        Declare(self, "felt_position", 1, lambda packet: packet[:1], packet)
        Declare(self, "felt_velocity", 1, Feel, packet, F_h)
        Declare(self, "forward_packet", 1, lambda F: F, F_h)


class BrakedSlave(LeafSystem):
    """Applies F - damping v, where F is the received force; returns [p_WT; v; F]."""

    def __init__(self, damping):
        LeafSystem.__init__(self)
        F = self.DeclareVectorInputPort("forward_packet", 1)
        p = self.DeclareVectorInputPort("tool_position", 1)
        v = self.DeclareVectorInputPort("tool_velocity", 1)
        self.DeclareVectorInputPort("environment_force", 1)
        Declare(self, "control_force", 1, lambda F, v: F - damping * v, F, v)
        Declare(self, "return_packet", 3, lambda *x: np.concatenate(x), p, v, F)


def Overshoot(scenario, teleoperator=None):
    """Returns the velocity overshoot of the tool after the puncture, mm/s."""
    metrics = RunMetrics(simulate(scenario, teleoperator=teleoperator, engine="auto"))
    return 1000 * metrics["puncture"]["velocity_overshoot"]


def main(picture: Path) -> None:
    # The run of nine seconds includes the puncture and ends before the bone. No step is
    # longer than the delay.
    overrides = {"controller.kind": "direct_force", "duration": 9.0}
    scenario = LoadScenario("one_dof", {**overrides, "simulator.max_step_size": 0.1})
    # With these dampings the architecture is a matched wave line of impedance 1 N s/m.
    architecture = Architecture(
        master_side=CompliantMaster(damping=2.0),
        slave_side=BrakedSlave(damping=1.0),
        # Before the first packet: no force, and the tool at rest at its start.
        initial_forward_packet=[0.0],
        initial_return_packet=[0.0, 0.0, 0.0],
    )
    teleoperator = MakeTeleoperator(scenario, architecture=architecture)
    WriteDiagram(teleoperator.GetSubsystemByName("master"), picture, max_depth=1)

    own, direct = Overshoot(scenario, teleoperator), Overshoot(scenario)
    print(f"overshoot: {own:.3f} mm/s (direct force: {direct:.3f})")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).with_suffix(".svg"))

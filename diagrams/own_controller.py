"""A controller of your own in the place of the adaptive one.

A control law is a plain function, such as damped() below, or a LeafSystem with the
ports of a control law, such as DampingInjection. The function can be compiled and runs
in a page. The LeafSystem runs in Drake's Simulator, and it may have a state.

Run `python diagrams/own_controller.py`: it draws the slave station with the LeafSystem
beside this file (or into the file given as an argument), simulates the one-axis task
with both laws and with direct force application, and prints the velocity overshoot of
the tool after the puncture.

If this folder is on Python's path, both are kinds of controllers, too. The gain is a
field: `--set controller.parameters.damping=2`. In this folder, run

    teleop-drake compare one_dof --controllers all,own_controller:DampingInjection
"""

import sys
from pathlib import Path

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from teleop_drake.loops.draw.block_diagram import WriteDiagram
from teleop_drake.loops.run.recording import Recording
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.teleoperator import MakeTeleoperator


def damped(
    haptic_force, velocity_command, tool_position, tool_velocity, environment_force,
    damping=1.0,
):  # fmt: skip
    """Returns F_c = F_hd + damping (v_dd - v), the law of DampingInjection."""
    return haptic_force + damping * (velocity_command - tool_velocity)


class DampingInjection(LeafSystem):
    """Direct force application, braked at the slave without delay.

        F_c = F_hd + damping (v_dd - v)

    The ports are those of every control law: haptic_force (F_hd), velocity_command
    (v_dd), tool_position, tool_velocity and environment_force in, control_force out.

    Args:
        num_axes: Number n of task axes.
        damping: N s/m.
    """

    def __init__(self, *, num_axes: int, damping: float = 1.0):
        LeafSystem.__init__(self)
        self.set_name("damping_injection")
        self._damping = damping
        self._haptic_force = self.DeclareVectorInputPort("haptic_force", num_axes)
        self._command = self.DeclareVectorInputPort("velocity_command", num_axes)
        self.DeclareVectorInputPort("tool_position", num_axes)
        self._velocity = self.DeclareVectorInputPort("tool_velocity", num_axes)
        self.DeclareVectorInputPort("environment_force", num_axes)
        # With these prerequisites Drake finds no algebraic loop through the
        # environment, whose force this law does not use.
        self.DeclareVectorOutputPort(
            "control_force",
            num_axes,
            self._CalcControlForce,
            prerequisites_of_calc={
                self._haptic_force.ticket(),
                self._command.ticket(),
                self._velocity.ticket(),
            },
        )

    def _CalcControlForce(self, context: Context, control_force: BasicVector) -> None:
        velocity_error = self._command.Eval(context) - self._velocity.Eval(context)
        control_force.SetFromVector(
            self._haptic_force.Eval(context) + self._damping * velocity_error
        )


def Overshoot(recording: Recording) -> float:
    """Returns the velocity overshoot of the tool after the puncture, m/s."""
    puncture = next(e.time for e in recording.events if e.name == "puncture")
    velocity = recording.signals["tool_velocity"][recording.time >= puncture, 0]
    return velocity.max() - recording.scenario.surgeon.velocity[0]


def main(picture: Path) -> None:
    # The run of nine seconds includes the puncture and ends before the bone. No step is
    # longer than the delay.
    overrides = {"controller.kind": "direct_force", "duration": 9.0}
    scenario = LoadScenario("one_dof", {**overrides, "simulator.max_step_size": 0.1})
    teleoperator = MakeTeleoperator(
        scenario, control_law=DampingInjection(num_axes=1, damping=1.0)
    )
    WriteDiagram(teleoperator.GetSubsystemByName("controller"), picture)
    with_function = MakeTeleoperator(scenario, control_law=damped)

    runs = {
        "LeafSystem": simulate(scenario, teleoperator=teleoperator),
        "function": simulate(scenario, teleoperator=with_function),
        "direct force": simulate(scenario),
    }
    for name, recording in runs.items():
        print(f"overshoot, {name}: {1000 * Overshoot(recording):.3f} mm/s")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).with_suffix(".svg"))

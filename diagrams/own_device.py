"""A haptic device of your own, over a real network.

A device is driven by a function that is called once per period. The function takes the
time and the packet received from the robot, and returns the packet to send. Lever below
is a placeholder for your device. A real device would read its encoder and set its
motor. Here a simulated hand moves the lever at a constant speed and stops when the
force reaches a limit.

Run `python diagrams/own_device.py`: it draws the robot's side of the loop beside this
file (or into the file given as an argument), starts this side in another process, which
could be on another machine, and operates it for a second. It prints the motion and the
force that were felt, and the round trip of the packets.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from teleop_drake.loops.draw.block_diagram import WriteDiagram
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.teleoperator import AddTeleoperator
from teleop_drake.study.link.packets import NewKey
from teleop_drake.study.link.remote import OperateRemotely

OVERRIDES = ["controller.kind=direct_force", "duration=1.0"]


class Lever:
    """A lever that a spring and a damper couple to the felt motion of the tool.

    Args:
        speed: The speed with which the hand moves the lever, m/s.
        most_force: The force at which the hand stops, N.
    """

    def __init__(self, *, speed: float = 0.01, most_force: float = 0.01):
        self._speed, self._most_force = speed, most_force
        self._time = self._position = self.force = 0.0

    def __call__(self, t: float, return_packet: np.ndarray) -> np.ndarray:
        """Takes [p_WT; v_WT] in m and m/s; returns [F_h; v_d] in N and m/s."""
        p_WT, v_WT = return_packet
        velocity = self._speed if self.force < self._most_force else 0.0
        # Read your encoder here ...
        self._position += velocity * (t - self._time)
        self._time = t
        # ... and set your motor to -force.
        self.force = 20.0 * (self._position - p_WT) + 0.1 * (velocity - v_WT)
        return np.array([self.force, velocity])


def main(picture: Path) -> None:
    # The robot's side without a network: its packets are ports.
    scenario = LoadScenario("one_dof", OVERRIDES)
    builder = DiagramBuilder()
    AddTeleoperator(builder, scenario, side="robot")
    channel = builder.GetSubsystemByName("forward_channel")
    builder.ExportInput(channel.get_input_port(), "forward_packet")
    controller = builder.GetSubsystemByName("controller")
    builder.ExportOutput(controller.GetOutputPort("return_packet"), "return_packet")
    robot_side = builder.Build()
    robot_side.set_name("robot_side")
    WriteDiagram(robot_side, picture, max_depth=1)

    # The other process prints its address on stderr, and ends after the run.
    command = [sys.executable, "-m", "teleop_drake", "serve", "one_dof"]
    command += [f"--set={override}" for override in OVERRIDES]
    with tempfile.TemporaryDirectory() as folder:
        key = f"{folder}/key"
        NewKey(key)
        command += ["--listen", "127.0.0.1:0", "--key", key, "--json", "-"]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as server:
            address = server.stderr.readline().split()[-1]
            side = OperateRemotely(
                scenario, connect=address, key=key, step=Lever(), say=lambda line: None
            )
            server.communicate()
    recording = side.Recording()
    felt, sent = recording["return_packet_received"], recording["forward_packet_sent"]
    trip = side.Report()["round_trip_s"]["median"]
    print(
        f"the tool was felt to move {1000 * felt[-1, 0]:.2f} mm, "
        f"with up to {sent[:, 0].max():.3f} N; "
        f"round trip {1000 * trip:.1f} ms"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).with_suffix(".svg"))

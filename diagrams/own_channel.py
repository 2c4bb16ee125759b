"""A channel of your own: a delay followed by a low-pass filter.

It consists of the class BandLimitedChannel below, a kind of channel like the built-in
ones. The class checks its fields, makes its block, and provides the longest step of a
simulation and the delay for the analysis. It can be named in a scenario file or on the
command line if this folder is on Python's path:

    teleop-drake compare one_dof --set \
        'return_channel={kind: own_channel:BandLimitedChannel, bandwidth: 20}'

Run `python diagrams/own_channel.py`: it draws the channel beside this file (or into the
file given as an argument), simulates the one-axis task with several bandwidths of the
return channel, and prints the velocity overshoot of the tool after the puncture.
"""

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LinearSystem

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.draw.block_diagram import WriteDiagram
from teleop_drake.loops.framework.validation import CheckNumber
from teleop_drake.model.channels import ChannelConfig, ConstantDelay
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import RunMetrics


@dataclass(kw_only=True, eq=False)
class BandLimitedChannel(ChannelConfig):
    """Delays the signal by `delay` > 0, and smooths it by a first-order low-pass."""

    # Corner of the low-pass, rad/s, > 0.
    bandwidth: float = 100.0

    def Check(self, path, duration):
        super().Check(path, duration)
        CheckNumber(f"{path}.delay", self.delay, "s", above=0)
        CheckNumber(f"{path}.bandwidth", self.bandwidth, "rad/s", above=0)

    def MakeChannel(self, *, size, initial_value, duration=math.inf, stream=""):
        """Makes the diagram of delay and low-pass, with the ports of a channel."""
        builder = DiagramBuilder()
        delay = builder.AddNamedSystem(
            "delay",
            TransportDelay(
                delay=self.delay,
                size=size,
                initial_value=initial_value,
                max_sample_interval=math.inf,
            ),
        )
        w, identity = self.bandwidth, np.eye(size)
        low_pass = builder.AddNamedSystem(
            "low_pass",
            LinearSystem(A=-w * identity, B=w * identity, C=identity, D=0 * identity),
        )
        low_pass.configure_default_state(x0=np.array(initial_value, dtype=float))
        builder.Connect(delay.get_output_port(), low_pass.get_input_port())
        builder.ExportInput(delay.get_input_port(), "signal")
        builder.ExportOutput(low_pass.get_output_port(), "delayed_signal")
        channel = builder.Build()
        channel.set_name("band_limited_channel")
        return channel

    def LongestStep(self, duration):
        return self.delay

    def AsConstantDelay(self, path, duration):
        lag = 1 / self.bandwidth
        note = f"{path}: the low-pass counts as a delay of {lag:g} s."
        return ConstantDelay(delay=self.delay + lag, note=note)


def main(picture: Path) -> None:
    channel = BandLimitedChannel(delay=0.1)
    WriteDiagram(
        channel.MakeChannel(size=2, initial_value=[0.0, 0.0]), picture, max_depth=1
    )

    # The run of twelve seconds includes the puncture and ends before the bone.
    scenario = LoadScenario("one_dof", ["controller.kind=direct_force", "duration=12"])
    for bandwidth in (1000.0, 100.0, 20.0):
        scenario.return_channel = BandLimitedChannel(delay=0.1, bandwidth=bandwidth)
        puncture = RunMetrics(simulate(scenario, engine="auto"))["puncture"]
        overshoot = 1000 * puncture["velocity_overshoot"]
        print(f"{bandwidth:g} rad/s: overshoot {overshoot:.3f} mm/s")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).with_suffix(".svg"))

"""The planar arm with Drake's own DiscreteTimeDelay, beside an exact delay.

Drake's DiscreteTimeDelay(h, n) corresponds to the Integer Delay of Simulink: it samples
a signal every h and outputs it n samples later. Its mean delay is (n + 1/2) h, because
each sample is held for h. As a channel it is `kind: discrete`. The exact delay is
TransportDelay, `kind: transport`.

Run `python diagrams/two_dof_discrete_delay.py`: it draws the loop with the discrete
delays beside this file (or into the file given as an argument), simulates the arm with
both kinds of delays, and prints the overshoots of both side by side, as well as those
with an exact delay of (n + 1/2) h.
"""

import sys
from pathlib import Path

from teleop_drake import (
    LoadScenario,
    MakeTeleoperator,
    RunMetrics,
    Scenario,
    WriteDiagram,
    simulate,
)

PERIOD = 0.02  # h, s
NUM_PERIODS = 5  # n


def WithChannels(kind: str, delay: float) -> Scenario:
    """Returns the arm's task under direct force, with two channels of a kind."""
    channel = {"kind": kind, "delay": delay}
    if kind == "discrete":
        channel["sample_period"] = PERIOD
    changes = {"controller.kind": "direct_force", "duration": 12.0}
    changes |= {"forward_channel": channel, "return_channel": channel}
    return LoadScenario("two_dof_combined", changes)


def main(picture: Path) -> None:
    delay = NUM_PERIODS * PERIOD
    mean_delay = (NUM_PERIODS + 0.5) * PERIOD
    scenarios = {
        f"DiscreteTimeDelay({PERIOD:g}, {NUM_PERIODS})": WithChannels(
            "discrete", delay
        ),
        f"TransportDelay({delay:g})": WithChannels("transport", delay),
        f"TransportDelay({mean_delay:g})": WithChannels("transport", mean_delay),
    }
    discrete = next(iter(scenarios.values()))
    WriteDiagram(MakeTeleoperator(discrete), picture, max_depth=2)

    print(f"{'':26}overshoot at the start  after the puncture")
    for name, scenario in scenarios.items():
        metrics = RunMetrics(simulate(scenario))
        start = 1000 * metrics["start_velocity_overshoot"]
        puncture = 1000 * metrics["puncture"]["velocity_overshoot"]
        print(f"{name:26}{start:17.4f} mm/s {puncture:14.4f} mm/s")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).with_suffix(".svg"))

"""Events at the end of a run do not happen, in either engine."""

import pytest
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Integrator,
    LinearSystem,
    ZeroOrderHold,
)
from wired import Wired

from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.delays.variable import DelayProfile
from teleop_drake.model.blocks.systems.sampled_sensor import SampledSensor
from teleop_drake.model.run.simulate import simulate


def network(delay):
    profile = DelayProfile(delay=delay)
    return NetworkDelay(
        network=PacketNetwork(profile=profile, sample_period=0.02), size=1
    )


def sensor():
    return SampledSensor(sample_period=0.3, initial_value=[0.0])


# A block, the end of a run at which its output jumps, and the output until then. The
# rounded time of the jump is slightly before the end, at it, or slightly after it.
CASES = {
    "packet before": (lambda: network(0.037), 0.057, 0.0),
    "packet at": (lambda: network(0.5), 0.52, 0.0),
    "sample before": (sensor, 0.9, 0.6),
    "sample at": (sensor, 0.6, 0.3),
    "hold before": (lambda: ZeroOrderHold(0.3, 1), 0.9, 0.6),
    "hold at": (lambda: ZeroOrderHold(0.3, 1), 0.6, 0.3),
    "steps": (
        lambda: LinearSystem([[0.0]], [[1.0]], [[1.0]], [[0.0]], 0.3), 0.9, 0.6,
    ),
    "first value": (
        lambda: TransportDelay(delay=0.7, size=1, initial_value=[-1.0]), 0.7, -1.0,
    ),
}  # fmt: skip


@pytest.mark.parametrize("engine", ["drake", "compiled"])
@pytest.mark.parametrize("case", CASES)
def test_what_is_due_at_the_end_does_not_happen(case, engine):
    make, end, expected = CASES[case]
    block = make()
    diagram = Wired(
        {
            "one": ConstantVectorSource([1.0]),
            "ramp": Integrator([0.0]),
            "block": block,
        },
        {"ramp": "one", "block": "ramp"},
        {"y": f"block.{block.get_output_port(0).get_name()}"},
    )
    recording = simulate(diagram, duration=end, engine=engine)
    assert recording.time[-1] == end
    assert recording["y"][-1, 0] == pytest.approx(expected, abs=1e-9)
    assert recording.termination == "completed"

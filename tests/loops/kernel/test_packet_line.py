"""Packets of runs that begin after time 0, against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.primitives import ConstantVectorSource, Integrator
from wired import InSeries, Wired

from teleop_drake.loops import NetworkDelay, simulate
from teleop_drake.loops.delays.packet_network import PacketNetwork, Receiver
from teleop_drake.loops.delays.variable import DelayProfile
from teleop_drake.loops.numerics.pieces import Pieces

ENGINES = ["drake", "compiled"]
PERIOD = 0.05
DELAY = 0.1
START = 3.0


def ramp_in_packets():
    """The signal 1 + (t - START) in packets, which the receiver extrapolates."""
    network = PacketNetwork(profile=DelayProfile(delay=DELAY), sample_period=PERIOD)
    receiver = Receiver(policy="extrapolate")
    parts = {
        "slope": ConstantVectorSource([1.0]),
        "ramp": Integrator([1.0]),
        "network": NetworkDelay(network, 1, [7.0], receiver=receiver),
    }
    return Wired(parts, InSeries(*parts), {"shown": "network"})


def expected(times):
    """Returns the output between the instants at which packets are shown."""
    arrived = START + DELAY
    line = 1.0 + (times - arrived)
    # The first packet has no predecessor and is held.
    return np.where(times < arrived, 7.0, np.where(times < arrived + PERIOD, 1.0, line))


def check(recording):
    pieces = Pieces(recording.time, recording.steps)
    values = pieces.signal(recording["shown"])[:, 1:-1, 0]
    shares = np.array([0.25, 0.5, 0.75])
    times = pieces.begin[:, None] + shares * pieces.length[:, None]
    assert_allclose(values, expected(times), atol=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_first_packet_of_a_run_is_held(engine):
    """It was continued along a line from a packet that no run had sent."""
    diagram = ramp_in_packets()
    context = diagram.CreateDefaultContext()
    context.SetTime(START)
    recording = simulate(diagram, context=context, duration=0.4, engine=engine)
    assert recording.solver.engine == engine
    check(recording)


@pytest.mark.parametrize("split", [0.02, 0.12, 0.17])
@pytest.mark.parametrize("former", ENGINES)
@pytest.mark.parametrize("latter", ENGINES)
def test_the_first_packet_is_held_in_a_later_part_too(split, former, latter):
    """The parts end before the first packet is shown, while it is, and after."""
    diagram = ramp_in_packets()
    context = diagram.CreateDefaultContext()
    context.SetTime(START)
    first = simulate(diagram, context=context, duration=split, engine=former)
    rest = {"duration": 0.4 - split, "engine": latter}
    second = simulate(
        diagram,
        context=first.final_context,
        suppress_initialization_events=True,
        **rest,
    )
    check(second)

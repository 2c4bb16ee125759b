"""Drake's discrete updates before a delay and before a guard, against exact answers."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.framework import DiagramBuilder, DiscreteStateIndex, LeafSystem
from pydrake.systems.primitives import (
    ConstantVectorSource,
    DiscreteDerivative,
    Integrator,
    LinearSystem,
    Sine,
    ZeroOrderHold,
)

from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.delays.variable import DelayProfile
from teleop_drake.loops.kernel import FixedBlock, Kernel, Transition
from teleop_drake.model.blocks.systems.sampled_sensor import SampledSensor
from teleop_drake.model.run.simulate import simulate

ENGINES = ("drake", "compiled")


def chain(source, *blocks):
    """Returns a diagram of blocks in series, which exports their outputs y0, y1, ..."""
    builder = DiagramBuilder()
    output = builder.AddNamedSystem("source", source).get_output_port(0)
    for i, block in enumerate(blocks):
        builder.AddNamedSystem(f"block_{i}", block)
        builder.Connect(output, block.get_input_port(0))
        output = block.get_output_port(0)
        builder.ExportOutput(output, f"y{i}")
    return builder.Build()


def past_half(u, mode):
    return u - 0.5 - 2 * mode


def switched_on(mode):
    return 0 * mode + 1


def relay():
    """Returns a block whose output rises from 0 to 1 once its input is 0.5."""
    on = Transition(guard=(past_half, "u", "mode"), mode=(switched_on, "mode"))
    kernel = Kernel(outputs={"y": "mode"}, transitions={"on": on})
    block = FixedBlock("relay", kernel, inputs={"u": 1}, outputs={"y": 1})
    block.DeclareDiscreteState([0.0])
    return block


PERIOD = 0.05
DELAY = 0.037
FREQUENCY = 3.0
END = 0.9


@pytest.mark.mostly_slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("period", [PERIOD, 0.01, 0.4])
def test_a_held_signal_is_delayed_exactly(engine, period):
    diagram = chain(
        Sine(1.0, FREQUENCY, 0.4, True),
        ZeroOrderHold(period, 1),
        TransportDelay(delay=DELAY, size=1),
        Integrator([0.0]),
    )
    recording = simulate(diagram, duration=END, engine=engine)
    times = np.arange(DELAY, END, period)
    samples = np.sin(FREQUENCY * period * np.arange(len(times)) + 0.4)
    inside = np.arange(DELAY + 0.0011, END, 0.0013)
    k = np.floor((inside - DELAY) / period).astype(int)
    delayed = recording.Interpolate("y1", inside)[:, 0]
    assert_allclose(delayed, samples[k], atol=1e-12)
    exact = samples @ np.diff([*times, END])
    assert recording["y2"][-1, 0] == pytest.approx(exact, abs=1e-9)


class Counter(LeafSystem):
    """A block that counts its updates, one every 20 ms."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("unused", 1)
        self.DeclareDiscreteState([0.0])
        self.DeclareStateOutputPort("y", DiscreteStateIndex(0))
        self.DeclarePeriodicDiscreteUpdateEvent(0.02, 0.0, self._Count)

    def _Count(self, context, values):
        values.set_value(0, context.get_discrete_state_vector().value() + 1)


def test_an_own_block_counts_each_instant_once():
    """The passes at one instant that delays need do not repeat a periodic event."""
    diagram = chain(
        ConstantVectorSource([1.0]), Counter(), TransportDelay(delay=0.015, size=1)
    )
    recording = simulate(diagram, duration=0.99, engine="drake")
    assert recording["y0"][-1, 0] == 50
    times = np.arange(0.0163, 0.99, 0.0019)
    counts = np.floor((times - 0.015) / 0.02) + 1
    assert_allclose(recording.Interpolate("y1", times)[:, 0], counts)


def counted(mode, places):
    return mode + places


@pytest.mark.parametrize("engine", ENGINES)
def test_a_block_with_two_discrete_periods_is_delayed_exactly(engine):
    periods = {"first": 0.02, "second": 0.05}
    places = {"first": np.array([1.0, 0.0]), "second": np.array([0.0, 1.0])}
    transitions = {
        name: Transition(mode=(counted, "mode", name), period=h, is_discrete=True)
        for name, h in periods.items()
    }
    kernel = Kernel(
        outputs={"y": "mode"}, parameters=places, transitions=transitions, unused=("u",)
    )
    counter = FixedBlock("counter", kernel, inputs={"u": 1}, outputs={"y": 2})
    counter.DeclareDiscreteState([0.0, 0.0])
    diagram = chain(
        ConstantVectorSource([1.0]), counter, TransportDelay(delay=0.015, size=2)
    )
    recording = simulate(diagram, duration=0.6, engine=engine)
    times = np.arange(0.0163, 0.6, 0.0019)
    counts = [np.floor((times - 0.015) / h) + 1 for h in periods.values()]
    assert_allclose(recording.Interpolate("y1", times).T, counts)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_relay_behind_a_difference_equation_switches_with_it(engine):
    """x_{k+1} = 0.8 x_k + 0.2 from 0 exceeds 0.5 in its fourth step, at 0.06 s."""
    diagram = chain(
        ConstantVectorSource([1.0]),
        LinearSystem([[0.8]], [[0.2]], [[1.0]], [[0.0]], 0.02),
        relay(),
        TransportDelay(delay=DELAY, size=1),
        Integrator([0.0]),
    )
    recording = simulate(diagram, duration=0.5, engine=engine)
    (place,) = np.flatnonzero(np.diff(recording["y1"][:, 0]))
    assert recording.time[place : place + 2] == pytest.approx([0.06, 0.06], abs=1e-12)
    assert recording["y3"][-1, 0] == pytest.approx(0.5 - 0.06 - DELAY, abs=1e-9)


@pytest.mark.parametrize(("period", "is_noted"), [(0.02, True), (0.015, False)])
def test_rounding_that_decides_which_sample_is_earlier_is_noted(period, is_noted):
    """33 * 0.02 is not 22 * 0.03; multiples of 0.015 are those of 0.03."""
    source = Sine(1.0, FREQUENCY, 0.4, True)
    diagram = chain(source, ZeroOrderHold(0.03, 1), ZeroOrderHold(period, 1))
    recording = simulate(diagram, duration=0.7, engine="drake")
    notes = [note for note in recording.notes if "both sample at 0.66 s" in note]
    assert len(notes) == is_noted


@pytest.mark.parametrize("engine", ENGINES)
def test_a_relay_that_is_due_at_the_start_precedes_the_first_sample(engine):
    """It is on from the start, so that its difference quotient is 0."""
    source = ConstantVectorSource([1.0])
    diagram = chain(source, relay(), DiscreteDerivative(1, PERIOD))
    recording = simulate(diagram, duration=0.2, engine=engine)
    assert np.abs(recording["y1"]).max() == 0


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("early", [1e-7, 1e-9])
def test_a_packet_just_before_a_sample_is_seen_by_it(engine, early):
    """Packet 1 arrives just before 0.3 s, packet 2 just before 0.4 s, ..."""
    network = PacketNetwork(profile=DelayProfile(delay=0.2 - early), sample_period=0.1)
    diagram = chain(
        Sine(1.0, FREQUENCY, 0.4, True),
        NetworkDelay(network=network, size=1),
        SampledSensor(sample_period=0.1, initial_value=[0.0]),
    )
    recording = simulate(diagram, duration=0.95, engine=engine)
    times = 0.05 + 0.1 * np.arange(2, 9)
    exact = np.sin(FREQUENCY * 0.1 * np.arange(7) + 0.4)
    seen = recording.Interpolate("y1", times)[:, 0]
    assert_allclose(seen, exact, atol=1e-12)

"""Samplers and packets at one instant, in both engines, against exact arithmetic."""

import math
from fractions import Fraction

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pydrake.systems.analysis import Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Integrator,
    Sine,
    ZeroOrderHold,
)
from wired import Wired

from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.delays.variable import DelayProfile
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.run import CompiledRun
from teleop_drake.loops.kernel.events import Ticks
from teleop_drake.loops.run.simulator import MakeSimulator
from teleop_drake.model.blocks.environments import Surface
from teleop_drake.model.blocks.operators import ConstantVelocityOperator
from teleop_drake.model.blocks.systems.sampled_sensor import SampledSensor


def sensor(h):
    return SampledSensor(sample_period=h, initial_value=[0.0])


def hold(h):
    return ZeroOrderHold(h, 1)


def sampled(h):
    return SampledDelay(delay=h, sample_period=h, size=1)


def network(h, delay=0.0):
    profile = DelayProfile(delay=delay)
    return NetworkDelay(network=PacketNetwork(profile=profile, sample_period=h), size=1)


def in_both_engines(diagram, output, start, times):
    """Yields the output of the diagram's block at each time, in Drake and compiled."""
    simulator = Simulator(diagram)
    simulator.get_mutable_context().SetTime(start)
    own = output.get_system().GetMyContextFromRoot(simulator.get_context())
    context = diagram.CreateDefaultContext()
    context.SetTime(start)
    run = CompiledRun(
        Evaluator(diagram, context),
        context,
        end=times[-1],
        accuracy=1e-9,
        max_step=1.0,
    )
    signals = run.evaluator.program.signals
    blocks = [block.system for block in run.evaluator.blocks]
    place = next(
        part
        for source, part in signals.items()
        if blocks[source.block] is output.get_system()
        and source.port == output.get_name()
    )
    for time in times:
        simulator.AdvanceTo(time)
        rows = run.Advance(time)
        yield output.Eval(own).item(), rows[-1, place].item()


def newest(h, time, start, *, is_before):
    """Returns the newest multiple of h before a time, or at it; None before start."""
    k = math.ceil(time / h) - 1 if is_before else math.floor(time / h)
    return k * h if k * h >= start else None


@pytest.mark.parametrize(
    ("first", "second", "late", "h_1", "h_2", "start", "end"),
    [
        (sensor, sampled, 1, "0.1", "0.3", "0", "2"),
        (sensor, network, 0, "0.1", "0.3", "0", "2"),
        (hold, sampled, 1, "0.001", "0.01", "11.66", "11.69"),
        # A discrete update of Drake's sees what unrestricted ones have made.
        (sensor, hold, 0, "0.3", "0.1", "0", "2"),
        (sensor, network, 0, "0.02", "0.1", "0", "0.7"),
    ],
)
def test_updates_at_one_instant_see_what_was_there_before(
    first, second, late, h_1, h_2, start, end
):
    one = first(float(h_1))
    two = second(float(h_2))
    output = two.get_output_port()
    h_1, h_2, start, end = map(Fraction, (h_1, h_2, start, end))
    step = min(h_1, h_2)
    middles = [
        start + (k + Fraction(1, 2)) * step for k in range((end - start) // step)
    ]
    diagram = Wired(
        {"sine": Sine(1.0, 3.0, 0.4, 1), "one": one, "two": two},
        {"one": "sine.y0", "two": f"one.{one.get_output_port(0).get_name()}"},
    )
    values = in_both_engines(diagram, output, float(start), [float(t) for t in middles])
    for t, pair in zip(middles, values, strict=True):
        sent = newest(h_2, t - late * h_2, start, is_before=False)
        taken = None
        if sent is not None:
            taken = newest(h_1, sent, start, is_before=second is not hold)
        expected = 0.0 if taken is None else math.sin(3 * float(taken) + 0.4)
        assert pair == pytest.approx((expected, expected), abs=1e-12), float(t)


def test_a_packet_without_delay_is_there_at_once():
    times = [1e-9, 0.05]
    channel = network(0.1)
    diagram = Wired(
        {"sine": Sine(1.0, 3.0, 0.4, 1), "channel": channel},
        {"channel": "sine.y0"},
    )
    pairs = in_both_engines(diagram, channel.get_output_port(), 0.0, times)
    for pair in pairs:
        assert pair == pytest.approx((math.sin(0.4),) * 2, abs=1e-12)


@pytest.mark.filterwarnings("ignore:.*no event is located")
def test_a_sample_on_the_surface_is_contact():
    """The first sample of x = t behind 0.375 m is 0.5 m, to the last bit."""
    surface = Surface("contact", np.array([0.5]), np.array([1.0]))
    operator = ConstantVelocityOperator(
        velocity=[1.0], contact_force=[1.0], contact_surface=surface
    )
    diagram = Wired(
        {
            "ramp": Integrator([0.0]),
            "encoder": SampledSensor(
                sample_period=0.1, initial_value=[0.0], resolution=0.25
            ),
            "surgeon": operator,
            "force": ConstantVectorSource([0.0]),
        },
        {
            "ramp": "surgeon.velocity_command",
            "encoder": "ramp",
            "surgeon.felt_position": "encoder.sample",
            "surgeon.haptic_force": "force",
        },
    )
    times = [0.399, 0.401]
    modes = in_both_engines(diagram, operator.GetOutputPort("mode"), 0.0, times)
    assert list(modes) == [(0, 0), (1, 1)]


def test_a_step_that_ends_just_before_a_tick_has_both_sides_of_the_jump():
    """Drake's hold ends steps at 0.3 s, which is less than 3 * 0.1 s."""
    builder = DiagramBuilder()
    sine = builder.AddNamedSystem("sine", Sine(1.0, 3.0, 0.4, 1))
    blocks = [
        builder.AddNamedSystem("encoder", sensor(0.1)),
        builder.AddNamedSystem("hold", hold(0.3)),
    ]
    for block in blocks:
        builder.Connect(sine.get_output_port(0), block.get_input_port(0))
    simulator = MakeSimulator(builder.Build(), SimulatorConfig())
    own = blocks[0].GetMyContextFromRoot(simulator.get_context())
    rows = []
    simulator.set_monitor(
        lambda root: rows.append(
            (root.get_time(), blocks[0].get_output_port(0).Eval(own).item())
        )
    )
    simulator.AdvanceTo(1.0)
    times, samples = np.transpose(rows)
    jumps = np.flatnonzero((np.diff(samples) != 0) & (times[:-1] > 0))
    assert len(jumps) == 9
    assert_array_equal(times[jumps], times[jumps + 1])


def test_ticks_near_and_after_a_time():
    ticks = Ticks(0.1, 0.05)
    assert [ticks.At(t) for t in (0.0, 0.05, 0.35 - 1e-16, 0.35 + 1e-8)] == [
        None, 0, 3, None,
    ]  # fmt: skip
    later = [ticks.After(t) for t in (-1.0, 0.05 - 1e-16, 0.05 - 1e-8, 0.1)]
    assert later == pytest.approx([0.05, 0.15, 0.05, 0.15])
    assert ticks.At(9000.05 + 4e-12) == 90000

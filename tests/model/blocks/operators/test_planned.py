"""Planned operators: the modes of the thesis's, and the plans in closed form."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Integrator,
    LogVectorOutput,
)

from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.model.blocks.environments import Surface
from teleop_drake.model.blocks.operators import ConstantVelocityOperator
from teleop_drake.model.blocks.operators.planned import (
    MinimumJerkConfig,
    PlannedOperator,
    PlanOfPieces,
    SineConfig,
    TrapezoidConfig,
)
from teleop_drake.model.laws.piecewise_polynomial import (
    differentiate_pieces,
    evaluate_pieces,
    largest_norm,
)
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks import TaskOf


class Bench:
    """An operator who feels p = [t, 0] and a haptic device that reads [1, 2]."""

    def __init__(self, *, channel=None, accuracy=None, **arguments):
        parameters = {
            "velocity": [0.1, 0.0],
            "contact_force": [0.2, 0.0],
            "contact_surface": Surface("contact", [0.55, 0.0], [1.0, 0.0]),
        } | arguments
        builder = DiagramBuilder()
        self.dut = builder.AddNamedSystem("dut", ConstantVelocityOperator(**parameters))
        force = builder.AddNamedSystem("force", ConstantVectorSource([1.0, 2.0]))
        speed = builder.AddNamedSystem("speed", ConstantVectorSource([1.0, 0.0]))
        position = builder.AddNamedSystem("position", Integrator(2))
        builder.Connect(speed.get_output_port(), position.get_input_port())
        felt = position.get_output_port()
        if channel is not None:
            builder.AddNamedSystem("channel", channel)
            builder.Connect(felt, channel.get_input_port())
            felt = channel.get_output_port()
        builder.Connect(felt, self.dut.GetInputPort("felt_position"))
        builder.Connect(force.get_output_port(), self.dut.GetInputPort("haptic_force"))
        # What is commanded, integrated: tells when it changed.
        impulse = builder.AddNamedSystem("impulse", Integrator(2))
        builder.Connect(
            self.dut.GetOutputPort("force_command"), impulse.get_input_port()
        )
        self.logger = LogVectorOutput(impulse.get_output_port(), builder)
        self.simulator = Simulator(builder.Build())
        if accuracy is not None:
            self.simulator.get_mutable_context().SetAccuracy(accuracy)

    def At(self, time):
        """Returns (mode, v_d, F_h) after the events at a time."""
        self.simulator.AdvanceTo(time)
        self.simulator.AdvancePendingEvents()
        context = self.dut.GetMyContextFromRoot(self.simulator.get_context())
        mode, velocity, force = (
            self.dut.GetOutputPort(name).Eval(context).tolist()
            for name in ("mode", "velocity_command", "force_command")
        )
        return mode[0], velocity, force

    def SwitchTime(self, end):
        """Returns when the first force command went from 1 N to 0.2 N."""
        self.At(end)
        log = self.logger.FindLog(self.simulator.get_context())
        return (log.data()[0, -1] - 0.2 * end) / (1.0 - 0.2)


@pytest.mark.filterwarnings("ignore:.*no event is located")
@pytest.mark.parametrize("accuracy", [1e-6, None])
def test_velocity_then_force(accuracy):
    bench = Bench(accuracy=accuracy)
    assert bench.At(0.5) == (0, [0.1, 0.0], [1.0, 2.0])
    assert bench.At(0.7) == (1, [0.0, 0.0], [0.2, 0.0])
    assert bench.At(2.0) == (1, [0.0, 0.0], [0.2, 0.0])


def test_contact_is_located():
    assert Bench(accuracy=1e-6).SwitchTime(1.0) == pytest.approx(0.55, abs=1e-6)


@pytest.mark.filterwarnings("ignore:.*no event is located")
@pytest.mark.parametrize("accuracy", [1e-6, None])
def test_contact_behind_a_sampled_channel(accuracy):
    """The packet sent at 0.6 is the first beyond 0.55, and arrives at 0.8."""
    channel = SampledDelay(delay=0.2, sample_period=0.1, size=2)
    bench = Bench(channel=channel, accuracy=accuracy)
    assert bench.SwitchTime(1.5) == pytest.approx(0.8, abs=1e-9)


@pytest.mark.filterwarnings("ignore:.*no event is located")
def test_contact_is_latched():
    """It stays in force mode although the tool is felt in front of the bone again."""
    dut = ConstantVelocityOperator(
        velocity=[0.1],
        contact_force=[0.2],
        contact_surface=Surface("contact", [0.5], [1.0]),
    )
    simulator = Simulator(dut)
    context = simulator.get_mutable_context()
    dut.GetInputPort("haptic_force").FixValue(context, [1.0])
    position = dut.GetInputPort("felt_position").FixValue(context, [0.6])
    simulator.AdvanceTo(0.1)
    position.GetMutableData().set_value([0.0])
    simulator.AdvanceTo(0.2)
    assert dut.GetOutputPort("mode").Eval(context)[0] == 1


def test_a_stop_withdraws_the_force_and_before_contact_leaves_the_device_braking():
    bench = Bench(accuracy=1e-6, stop_time=1.25)
    assert bench.At(1.2) == (1, [0.0, 0.0], [0.2, 0.0])
    assert bench.At(1.25) == (2, [0.0, 0.0], [0.0, 0.0])
    bench = Bench(accuracy=1e-6, stop_time=0.25)
    assert bench.At(0.2) == (0, [0.1, 0.0], [1.0, 2.0])
    for time in (0.3, 0.9):
        assert bench.At(time) == (2, [0.0, 0.0], [1.0, 2.0])


@pytest.mark.parametrize(
    "arguments", [{"contact_force": None}, {"contact_surface": None}]
)
def test_never_switches_without_force_or_surface(arguments):
    assert Bench(accuracy=1e-6, **arguments).At(3.0) == (0, [0.1, 0.0], [1.0, 2.0])


def test_feedthrough():
    dut = ConstantVelocityOperator(velocity=[0.1])
    for output in ("velocity_command", "force_command", "mode"):
        for source in ("haptic_force", "felt_position"):
            assert dut.HasDirectFeedthrough(
                dut.GetInputPort(source).get_index(),
                dut.GetOutputPort(output).get_index(),
            ) == (output == "force_command" and source == "haptic_force")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"velocity": [math.nan]}, "velocity = "),
        ({"contact_force": [1.0, 2.0]}, "contact_force = .*1 finite"),
        ({"contact_surface": Surface("a", [math.inf], [1.0])}, "contact_surface"),
        ({"stop_time": -1.0}, "stop_time = -1.0"),
    ],
)
def test_bad_parameters(arguments, message):
    with pytest.raises(ValueError, match=message):
        ConstantVelocityOperator(**({"velocity": [0.1]} | arguments))


def Commands(dut, times):
    """Returns v_d of an operator at some times."""
    context = dut.CreateDefaultContext()
    values = []
    for time in times:
        context.SetTime(time)
        values.append(dut.GetOutputPort("velocity_command").Eval(context).copy())
    return np.array(values)


LINES = np.array([0.0, 1.0]), np.array([[[0.0, 1.0, 0.0], [2.0, 0.0, 0.0]]])


def test_time_alone_decides():
    plan = PlanOfPieces(*LINES, [1.0])
    dut = PlannedOperator(plan=plan, num_axes=3, stop_time=2.0)
    assert dut.jump_times == [1.0, 2.0]
    assert Commands(dut, [0.0, 0.25, 1.0]).tolist() == [[0, 1, 0], [0.5, 1, 0], [0] * 3]
    for name in ("haptic_force", "felt_position"):
        assert not dut.HasDirectFeedthrough(
            dut.GetInputPort(name).get_index(),
            dut.GetOutputPort("velocity_command").get_index(),
        )


@pytest.mark.parametrize(
    ("breaks", "factor"),
    ((-LINES[0], 1.0), (LINES[0], math.nan)),
)
def test_bad_pieces(breaks, factor):
    with pytest.raises(ValueError, match="must be ascending, with finite coeff"):
        PlanOfPieces(breaks, factor * LINES[1])


@pytest.mark.parametrize("cruise_time", [0.0, 0.3, None])
def test_the_trapezoid_rises_stays_and_falls(cruise_time):
    times = np.linspace(0.0, 2.0, 201)
    end = np.inf if cruise_time is None else 0.5 + cruise_time
    share = np.clip(np.minimum(times / 0.5, 1 - (times - end) / 0.5), 0, 1)
    v_d = np.array([0.2, -0.1])
    config = TrapezoidConfig(velocity=v_d, rise_time=0.5, cruise_time=cruise_time)
    dut = config.MakeOperator(start=[0.0, 0.0])
    assert_allclose(Commands(dut, times), np.outer(share, v_d), atol=1e-12)
    assert len(dut.jump_times) == {0.0: 2, 0.3: 3, None: 1}[cruise_time]
    ends = [transition.offset for transition in dut.Kernel().transitions.values()]
    assert ends == dut.jump_times


def test_least_jerk_reaches_the_waypoints_with_the_speed_asked_for():
    points = [[0.1, 0.0], [0.2, 0.1], [0.2, 0.3]]
    config = MinimumJerkConfig(velocity=np.array([0.06, 0.08]), waypoints=points)
    breaks, path = config.Path()
    assert np.isclose(largest_norm(breaks, differentiate_pieces(path)), 0.1)
    ends = [evaluate_pieces(np.nextafter(x, 0), breaks, path) for x in breaks[1:]]
    assert_allclose(ends, points, atol=1e-12)
    dut = config.MakeOperator(start=[0.0, 0.0])
    on_the_way, at_the_end = Commands(dut, [breaks[1], breaks[-1]])
    assert np.linalg.norm(on_the_way) > 0.05  # It does not stop there.
    assert not at_the_end.any()
    assert dut.jump_times == [breaks[-1]]


def test_without_waypoints_it_goes_where_the_velocity_points():
    breaks, path = MinimumJerkConfig(velocity=np.array([0.1]), reach_time=2.0).Path()
    # The mean speed of one piece is 8/15 of its peak.
    assert np.isclose(breaks[-1], 15 / 8 * 2.0)
    end = evaluate_pieces(np.nextafter(breaks[-1], 0), breaks, path)
    assert np.isclose(end, 0.2)


def test_steps_are_short_against_the_period_of_a_sine():
    config = SineConfig(velocity=np.array([0.1]), frequency=200.0)
    dut = config.MakeOperator(start=[0.0])
    assert dut.longest_step == config.LongestStep() < 2 * np.pi / 200 / 10


def test_a_mass_swings_as_its_transfer_function_says():
    """Without delay, in empty space: v/v_d = H/(m s + d + H)."""
    w = 3.0
    scenario = LoadScenario(
        "one_dof",
        {
            "surgeon.kind": "sine",
            "surgeon.frequency": w,
            "controller.kind": "direct_force",
            "environment.layers": [],
            "delay": 0,
            "duration": 12.0,
            "simulator.accuracy": 1e-7,
            "simulator.max_step_size": 0.05,
        },
    )
    recording = simulate(scenario)
    s = 1j * w
    H = (25 * s + 50) / (s * s + 25 * s)
    gain = H / (0.5 * s + 0.1 + H)
    late = recording.time > 9.0
    expected = (0.001 * gain * np.exp(s * recording.time[late])).imag
    v = recording["tool_velocity"][late, 0]
    assert_allclose(v, expected, atol=2e-3 * 0.001 * abs(gain))
    # The excess over the momentary command, not over its amplitude.
    metrics = TaskOf(scenario).Metrics(recording)
    peak = 0.001 * abs(gain - 1)
    assert not recording.has_constant_command
    assert metrics["start_velocity_overshoot"] > 0.8 * peak

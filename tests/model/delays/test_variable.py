"""Exact delays: both blocks, and the profile of a varying one as a sum of parts."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import (
    DiagramBuilder,
)
from pydrake.systems.primitives import Integrator, LogVectorOutput, Sine
from scipy.optimize import brentq
from sources import Step
from wired import Wired

from teleop_drake import simulate
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.delays.variable import DelayProfile, Sinusoid, VariableDelay
from teleop_drake.model.scenario import ScenarioError

# dT/dt is between -0.75 and 0.75; below -1 nothing changes.
WAVE = DelayProfile(
    delay=0.2, drift=0.01, sinusoid=Sinusoid(amplitude=0.15, frequency=5.0, phase=0.3)
)
TRACE = DelayProfile(
    delay=0.01, trace=([7.0, 7.3, 7.4, 9.0, 12.0], [0.1, 0.2, 0.05, 0.3, 0.1])
)
PROFILES = {"wave": WAVE, "trace": TRACE, "constant": DelayProfile(delay=1 / 3)}


def Delay(name, **signal):
    """The block that delays by a profile; a constant one is a transport delay."""
    if name == "constant":
        return TransportDelay(delay=1 / 3, **signal)
    return VariableDelay(profile=PROFILES[name], **signal)


def make_simulator(diagram, context=None):
    simulator = Simulator(diagram, context)
    ApplySimulatorConfig(
        SimulatorConfig(
            integration_scheme="runge_kutta5",
            accuracy=1e-9,
            use_error_control=True,
            max_step_size=0.02,
        ),
        simulator,
    )
    return simulator


def build(source, dut):
    """Returns (simulator, log of the delayed signal, integral's context)."""
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("source", source)
    dut = builder.AddNamedSystem("dut", dut)
    size = dut.get_output_port().size()
    integrator = builder.AddNamedSystem("integrator", Integrator(size))
    builder.Connect(source.get_output_port(0), dut.get_input_port())
    builder.Connect(dut.get_output_port(), integrator.get_input_port())
    logger = LogVectorOutput(dut.get_output_port(), builder)
    simulator = make_simulator(builder.Build())
    return simulator, logger.FindLog(simulator.get_context())


@pytest.mark.mostly_slow
@pytest.mark.parametrize("name", PROFILES)
def test_smooth_signal_is_delayed_exactly(name):
    profile = PROFILES[name]
    simulator, log = build(
        Sine(amplitude=1.0, frequency=3.0, phase=0.3, size=2),
        Delay(name, size=2, initial_value=[7.0, 8.0]),
    )
    simulator.AdvanceTo(3.0)
    t = log.sample_times()
    origin = t - [profile(time) for time in t]
    arrived = origin > 0
    error = np.abs(log.data() - np.sin(3 * origin + 0.3))[:, arrived]
    assert error.max() < 1e-6
    assert np.all(log.data()[:, origin < 0] == [[7.0], [8.0]])
    assert np.sum(arrived) > 100


@pytest.mark.parametrize("name", PROFILES)
def test_step_arrives_exactly(name):
    profile = PROFILES[name]
    dut = Delay(name, size=1, initial_value=[7.0])
    simulator, _ = build(Step(time=0.4321, before=[1.0], after=[3.0]), dut)
    context = dut.GetMyContextFromRoot(simulator.get_context())
    simulator.Initialize()
    for origin, before, after in ((0.0, 7.0, 1.0), (0.4321, 1.0, 3.0)):
        arrival = brentq(lambda t, s=origin: t - profile(t) - s, origin, 3.0)
        simulator.AdvanceTo(origin + 0.01)
        simulator.AdvancePendingEvents()
        jump = dut.NextJumpTime(context)
        assert jump == pytest.approx(arrival, abs=1e-10)
        simulator.AdvanceTo(jump)
        # Before the jump within the step that ends there, after it in the next one.
        assert dut.get_output_port().Eval(context)[0] == before
        simulator.AdvancePendingEvents()
        assert dut.get_output_port().Eval(context)[0] == after
    assert dut.NextJumpTime(context) == math.inf
    steps = simulator.get_num_steps_taken()
    simulator.AdvanceTo(jump + 0.5)
    # No step was refused because of the jump.
    assert simulator.get_num_steps_taken() - steps < 60


@pytest.mark.parametrize("name", ["wave", "constant"])
def test_without_stops_the_integrator_finds_the_jump(name):
    profile = PROFILES[name]
    dut = Delay(name, size=1, initial_value=[7.0])
    simulator, _ = build(Step(time=0.4321, before=[1.0], after=[3.0]), dut)
    simulator.AdvanceTo(2.0)
    first = brentq(lambda t: t - profile(t), 0.0, 1.0)
    second = brentq(lambda t: t - profile(t) - 0.4321, 0.4, 1.5)
    expected = 7 * first + (second - first) + 3 * (2.0 - second)
    integral = simulator.get_context().get_continuous_state_vector()[0]
    assert integral == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("delay", [0.003, 0.2])
def test_longer_steps_are_cut_even_without_anything_to_integrate(delay):
    dut = TransportDelay(delay=delay, size=1)
    diagram = Wired(
        {"source": Sine(amplitude=1.0, frequency=3.0, phase=0.3, size=1), "dut": dut},
        {"dut": "source.y0"},
    )
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.2345)
    context = dut.GetMyContextFromRoot(simulator.get_context())
    expected = math.sin(3.0 * (1.2345 - delay) + 0.3)
    assert dut.get_output_port().Eval(context)[0] == pytest.approx(expected, abs=1e-6)


def test_beyond_the_end_of_the_trace_is_refused():
    profile = DelayProfile(delay=0.1, trace=([0.0, 1.0], [0.0, 0.1]))
    simulator, _ = build(
        Sine(amplitude=1.0, frequency=2.0, phase=0.3, size=1),
        VariableDelay(profile=profile, size=1),
    )
    with pytest.raises(ValueError, match="must be at most 1 s, the duration"):
        simulator.AdvanceTo(1.5)


# The profile.


def test_profile_adds_its_parts():
    times = [1000.0, 1000.5, 1002.0]
    values = [0.02, 0.05, 0.03]
    profile = DelayProfile(
        delay=0.1,
        drift=-0.001,
        sinusoid=Sinusoid(amplitude=0.01, frequency=3.0, phase=0.4),
        trace=(times, values),
    )
    assert profile.duration == 2.0
    for t in np.linspace(0, 2, 41):
        expected = 0.1 - 0.001 * t + 0.01 * math.sin(3 * t + 0.4)
        expected += np.interp(1000 + t, times, values)
        assert profile(t) == pytest.approx(expected, abs=1e-13)
    assert profile.minimum == pytest.approx(0.1 - 0.002 - 0.01 + 0.02)
    assert profile.max_slope == pytest.approx(-0.001 + 0.03 + 0.03 / 0.5)
    with pytest.raises(ValueError, match=r"t = 2.1: must be at most 2 s"):
        profile(2.1)


def test_beyond_the_trace_it_has_no_value_and_without_one_it_has_no_end():
    trace = DelayProfile(delay=0.0, trace=([3.0, 4.0], [0.1, 0.3]), duration=0.5)
    assert trace.duration == 0.5
    assert trace(0.5) == pytest.approx(0.2)
    constant = DelayProfile(delay=0.1)
    assert constant.duration == math.inf
    assert constant(1e9) == constant.minimum == constant.delay == 0.1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"delay": 0.0}, "delay = 0.0: must be .* never less than 1e-06 s"),
        ({"drift": 1.0}, "drift = 1.0: must be such that dT/dt, up to 1, is less"),
        (
            {"sinusoid": Sinusoid(amplitude=0.05, frequency=20.5)},
            "sinusoid.amplitude = 0.05: must be such that dT/dt, up to 1.025",
        ),
        ({"trace": ([0, 1, 1.01], [0.1, 0.1, 0.2])}, "trace = .*: must .* up to 10"),
    ],
)
def test_what_cannot_be_continuous(arguments, message):
    profile = DelayProfile(**({"delay": 0.1} | arguments))
    with pytest.raises(ValueError, match=message):
        profile.CheckContinuous()


BEFORE = {
    "sinusoid": DelayProfile(delay=0.3, sinusoid=Sinusoid(amplitude=0.1, frequency=2)),
    "trace": DelayProfile(delay=0.1, trace=([5.0, 6.0, 8.0], [0.1, 0.3, 0.2])),
    "shrinking trace": DelayProfile(
        delay=0.1, drift=-0.01, trace=([0.0, 1.0, 3.0], [0.1, 0.3, 0.2])
    ),
}


# Drake's Simulator takes samples every 10 ms.
ACCURACY = {"drake": 1e-9, "compiled": 1e-11}


def late_sine(profile):
    """Returns a Diagram of sin(3 t + 0.7) behind a delay."""
    return Wired(
        {"source": Sine(1.0, 3.0, 0.7, 1), "delay": VariableDelay(profile, 1)},
        {"delay": "source.y0"},
        {"late": "delay"},
    )


@pytest.mark.mostly_slow
@pytest.mark.parametrize("profile", BEFORE.values(), ids=BEFORE)
@pytest.mark.parametrize("engine", ["drake", "compiled"])
def test_a_run_that_begins_before_time_0_has_the_delay_of_the_profile(profile, engine):
    """Before 0 a trace has its first delay, so that T bends at 0."""
    diagram = late_sine(profile)
    context = diagram.CreateDefaultContext()
    context.SetTime(-0.3)
    recording = simulate(diagram, context=context, duration=1.2, engine=engine)
    times = np.linspace(-0.29, 0.89, 200)
    sent = times - profile(times)
    right = np.where(sent > -0.3, np.sin(3.0 * sent + 0.7), 0.0)
    late = recording.Interpolate("late", times)[:, 0]
    assert_allclose(late, right, atol=ACCURACY[engine])


@pytest.mark.parametrize("engine", ["drake", "compiled"])
def test_a_delay_that_grows_does_not_begin_before_time_0(engine):
    diagram = late_sine(DelayProfile(delay=0.3, drift=0.4, duration=10.0))
    context = diagram.CreateDefaultContext()
    context.SetTime(-1.0)
    with pytest.raises(ScenarioError, match=r"^t = -1.0: must be at least 0 s, becau"):
        simulate(diagram, context=context, duration=2.0, engine=engine)

"""Tests of the exact transport delay."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import (
    DiagramBuilder,
)
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Integrator,
    LogVectorOutput,
    Sine,
)
from sources import Step

from teleop_drake.channels.transport import TransportDelay


def simulate(source, *, delay, duration, initial_value=None, max_step_size=None):
    """Returns (diagram, simulator, logs of the delayed signal and its integral)."""
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("source", source)
    size = source.get_output_port(0).size()
    dut = builder.AddNamedSystem(
        "dut", TransportDelay(delay=delay, size=size, initial_value=initial_value)
    )
    integrator = builder.AddNamedSystem("integrator", Integrator(size))
    builder.Connect(source.get_output_port(0), dut.GetInputPort("signal"))
    builder.Connect(dut.GetOutputPort("delayed_signal"), integrator.get_input_port())
    loggers = [
        LogVectorOutput(system.get_output_port(), builder)
        for system in (dut, integrator)
    ]
    diagram = builder.Build()
    simulator = Simulator(diagram)
    config = SimulatorConfig(
        integration_scheme="runge_kutta5",
        accuracy=1e-9,
        use_error_control=True,
        max_step_size=max_step_size or min(0.1, delay or 0.1),
    )
    ApplySimulatorConfig(config, simulator)
    simulator.AdvanceTo(duration)
    return (
        dut,
        simulator,
        *[logger.FindLog(simulator.get_context()) for logger in loggers],
    )


@settings(max_examples=15)
@given(delay=st.floats(0.02, 0.7), frequency=st.floats(0.3, 2.0))
def test_smooth_signal_is_delayed_exactly(delay, frequency):
    _, _, log, _ = simulate(
        Sine(amplitude=1.0, frequency=frequency, phase=0.3, size=3),
        delay=delay,
        duration=2.0,
    )
    t = log.sample_times()
    arrived = t > delay
    expected = np.sin(frequency * (t - delay) + 0.3)
    error = np.abs(log.data() - expected)[:, arrived]
    assert error.max() <= 1e-6
    np.testing.assert_array_equal(log.data()[:, ~arrived], 0.0)


@pytest.mark.parametrize("delay", [0.1, 0.1234567, 1 / 3, math.pi / 10])
def test_step_arrives_exactly_and_without_overshoot(delay):
    time = 0.4321
    _, _, log, integral = simulate(
        Step(time=time, before=[1.0, -2.0], after=[3.0, 5.0]),
        delay=delay,
        duration=1.5,
        initial_value=[7.0, 8.0],
    )
    t, y = log.sample_times(), log.data()
    assert np.all(y[:, t < delay] == [[7.0], [8.0]])
    assert np.all(y[:, (t > delay) & (t < time + delay)] == [[1.0], [-2.0]])
    assert np.all(y[:, t > time + delay] == [[3.0], [5.0]])
    # The integral tells when it arrived, to the accuracy of the solver.
    expected = (
        np.array([7.0, 8.0]) * delay
        + np.array([1.0, -2.0]) * time
        + np.array([3.0, 5.0]) * (1.5 - time - delay)
    )
    np.testing.assert_allclose(integral.data()[:, -1], expected, atol=1e-5)


def test_a_step_of_the_solver_may_end_on_the_jump():
    """Before the jump within the step that ends there, after it in the next one."""
    delay, time = 0.25, 0.5
    builder = DiagramBuilder()
    source = builder.AddSystem(Step(time=time, before=[0.0], after=[1.0]))
    dut = builder.AddSystem(
        TransportDelay(delay=delay, size=1, max_sample_interval=delay)
    )
    integrator = builder.AddSystem(Integrator(1))
    builder.Connect(source.get_output_port(0), dut.get_input_port())
    builder.Connect(dut.get_output_port(), integrator.get_input_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    ApplySimulatorConfig(
        SimulatorConfig(
            integration_scheme="runge_kutta5", accuracy=1e-9, max_step_size=0.1
        ),
        simulator,
    )
    context = simulator.get_mutable_context()
    my_context = dut.GetMyContextFromRoot(context)
    simulator.AdvanceTo(time)
    assert dut.NextJumpTime(my_context) == math.inf
    simulator.AdvancePendingEvents()
    assert dut.NextJumpTime(my_context) == time + delay
    steps = simulator.get_num_steps_taken()
    simulator.AdvanceTo(time + delay)
    assert context.get_time() == time + delay
    assert dut.get_output_port().Eval(my_context)[0] == 0.0
    assert context.get_continuous_state_vector()[0] == 0.0
    simulator.AdvancePendingEvents()
    assert dut.get_output_port().Eval(my_context)[0] == 1.0
    assert dut.NextJumpTime(my_context) == math.inf
    simulator.AdvanceTo(1.0)
    assert context.get_continuous_state_vector()[0] == pytest.approx(0.25, abs=1e-14)
    # No step was refused because of the jump.
    assert simulator.get_num_steps_taken() - steps < 12


def test_zero_delay_is_a_pass_through():
    dut, simulator, log, _ = simulate(
        Sine(amplitude=1.0, frequency=1.0, phase=0.0, size=2),
        delay=0.0,
        duration=1.0,
        initial_value=[5.0, 5.0],
    )
    np.testing.assert_allclose(
        log.data()[0], np.sin(log.sample_times()), rtol=0, atol=1e-15
    )
    assert dut.HasDirectFeedthrough(0, 0)
    context = dut.GetMyContextFromRoot(simulator.get_context())
    assert context.num_total_states() == 0
    assert dut.NextJumpTime(context) == math.inf


def test_no_feedthrough_so_a_loop_can_be_closed():
    dut = TransportDelay(delay=0.1, size=1)
    assert not dut.HasDirectFeedthrough(0, 0)
    builder = DiagramBuilder()
    builder.AddSystem(dut)
    builder.Connect(dut.get_output_port(), dut.get_input_port())
    builder.Build()


def test_cloned_context_continues_identically():
    dut, simulator, _, _ = simulate(
        Sine(amplitude=1.0, frequency=2.0, phase=0.3, size=2), delay=0.13, duration=1.0
    )
    clone = simulator.get_context().Clone()
    simulator.AdvanceTo(2.0)
    diagram = simulator.get_system()
    other = Simulator(diagram, clone)
    ApplySimulatorConfig(
        SimulatorConfig(
            integration_scheme="runge_kutta5",
            accuracy=1e-9,
            use_error_control=True,
            max_step_size=0.1,
        ),
        other,
    )
    other.AdvanceTo(1.5)
    first = dut.get_output_port().Eval(dut.GetMyContextFromRoot(clone))
    np.testing.assert_allclose(first, np.sin(2 * (1.5 - 0.13) + 0.3), atol=1e-7)
    other.AdvanceTo(2.0)
    # The original has gone on in the meantime without touching the clone.
    np.testing.assert_allclose(
        dut.get_output_port().Eval(dut.GetMyContextFromRoot(clone)),
        dut.get_output_port().Eval(dut.GetMyContextFromRoot(simulator.get_context())),
        atol=1e-9,
    )


def test_second_run_of_the_same_diagram_is_the_same():
    runs = []
    builder = DiagramBuilder()
    source = builder.AddSystem(Sine(amplitude=1.0, frequency=3.0, phase=0.0, size=1))
    dut = builder.AddSystem(TransportDelay(delay=0.2, size=1))
    builder.Connect(source.get_output_port(0), dut.get_input_port())
    diagram = builder.Build()
    for _ in range(2):
        simulator = Simulator(diagram)
        simulator.AdvanceTo(0.777)
        context = dut.GetMyContextFromRoot(simulator.get_context())
        runs.append(dut.get_output_port().Eval(context)[0])
    assert runs[0] == runs[1]


@pytest.mark.parametrize("delay", [0.003, 0.2])
def test_longer_steps_are_cut_even_without_anything_to_integrate(delay):
    builder = DiagramBuilder()
    source = builder.AddSystem(Sine(amplitude=1.0, frequency=3.0, phase=0.3, size=1))
    dut = builder.AddSystem(TransportDelay(delay=delay, size=1))
    builder.Connect(source.get_output_port(0), dut.get_input_port())
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(1.2345)
    context = dut.GetMyContextFromRoot(simulator.get_context())
    assert dut.get_output_port().Eval(context)[0] == pytest.approx(
        math.sin(3.0 * (1.2345 - delay) + 0.3), abs=1e-6
    )


def test_evaluation_far_beyond_the_last_step_is_refused():
    dut, simulator, _, _ = simulate(
        Sine(amplitude=1.0, frequency=1.0, phase=0.0, size=1), delay=0.1, duration=1.0
    )
    simulator.get_mutable_context().SetTime(2.0)
    context = dut.GetMyContextFromRoot(simulator.get_context())
    with pytest.raises(RuntimeError, match="at most the delay"):
        dut.get_output_port().Eval(context)


def test_history_is_bounded():
    _, simulator, _, _ = simulate(
        ConstantVectorSource([1.0]), delay=0.05, duration=20.0, max_step_size=0.01
    )
    dut = simulator.get_system().GetSystems()[1]
    context = dut.GetMyContextFromRoot(simulator.get_context())
    history = context.get_abstract_state(0).get_value()
    assert len(history.times) < 60


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"delay": -0.1, "size": 1}, "delay = -0.1: must"),
        ({"delay": math.nan, "size": 1}, "delay = nan: must"),
        ({"delay": math.inf, "size": 1}, "delay = inf: must"),
        ({"delay": 0.1, "size": 0}, "size = 0: must"),
        ({"delay": 0.1, "size": 1, "max_sample_interval": 0.2}, "interval = 0.2: must"),
        (
            {"delay": 0.1, "size": 1, "max_sample_interval": math.nan},
            "interval = nan: must",
        ),
        ({"delay": 0.1, "size": 2, "initial_value": [1.0]}, "initial_value = .*: must"),
    ],
)
def test_bad_parameters(arguments, message):
    with pytest.raises(ValueError, match=message):
        TransportDelay(**arguments)

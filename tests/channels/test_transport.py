"""Tests of the exact transport delay."""

import math

import numpy as np
import pytest
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import (
    DiagramBuilder,
)
from pydrake.systems.primitives import (
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


@pytest.mark.parametrize(
    ("delay", "frequency"), [(0.0234, 2.0), (0.1, 1.1), (0.7, 0.3)]
)
def test_smooth_signal_is_delayed_exactly(delay, frequency):
    _, _, log, _ = simulate(
        Sine(amplitude=1.0, frequency=frequency, phase=0.3, size=3),
        delay=delay,
        duration=1.2,
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


def test_no_feedthrough_so_a_loop_can_be_closed():
    dut = TransportDelay(delay=0.1, size=1)
    assert not dut.HasDirectFeedthrough(0, 0)
    builder = DiagramBuilder()
    builder.AddSystem(dut)
    builder.Connect(dut.get_output_port(), dut.get_input_port())
    builder.Build()


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

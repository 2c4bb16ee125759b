"""The end of a run where another run begins, or where the Context is changed."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Integrator, Sine

from teleop_drake.loops import (
    MakeSimulator,
    SampledDelay,
    TransportDelay,
    VariableDelay,
    simulate,
)
from teleop_drake.loops.delays.variable import DelayProfile
from teleop_drake.loops.framework.solver import DefaultSimulator
from teleop_drake.loops.kernel import FixedBlock, Kernel, Transition

ENGINES = ["drake", "compiled"]
PAIRS = [(former, latter) for former in ENGINES for latter in ENGINES]
DELAYS = {
    "constant": lambda: TransportDelay(0.3, 1),
    "varying": lambda: VariableDelay(DelayProfile(delay=0.3), 1),
}


def doubled(mode):
    return 2.0 * mode


def step(time):
    """Returns a source that jumps from 1 to 2, by an unrestricted update."""
    jump = Transition(mode=(doubled, "mode"), offset=time)
    kernel = Kernel(outputs={"y": "mode"}, transitions={"jump": jump})
    return FixedBlock("step", kernel, inputs={}, outputs={"y": 1}, mode=[1.0])


def fed(parts, source=None):
    """Returns a Diagram of parts that have one signal: of a source, or the input u."""
    builder = DiagramBuilder()
    for name, part in parts.items():
        builder.AddNamedSystem(name, part)
        builder.ExportOutput(part.get_output_port(0), name)
    inputs = [part.get_input_port() for part in parts.values()]
    if source is None:
        builder.ExportInput(inputs[0], "u")
        for port in inputs[1:]:
            builder.ConnectInput("u", port)
        return builder.Build()
    builder.AddNamedSystem("source", source)
    for port in inputs:
        builder.Connect(source.get_output_port(0), port)
    return builder.Build()


def integral(delay):
    """Returns the integral of a delayed input u, with both outputs exported."""
    builder = DiagramBuilder()
    line = builder.AddNamedSystem("delay", delay)
    plant = builder.AddNamedSystem("plant", Integrator(1))
    builder.ExportInput(line.get_input_port(), "u")
    builder.Connect(line.get_output_port(), plant.get_input_port())
    builder.ExportOutput(line.get_output_port(), "late")
    builder.ExportOutput(plant.get_output_port(), "x")
    return builder.Build()


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("kind", "former", "latter"),
    [
        *[("constant", *pair) for pair in PAIRS],
        ("varying", "drake", "compiled"),
        ("varying", "compiled", "drake"),
    ],
)
def test_an_input_that_changes_between_two_runs_jumps(kind, former, latter):
    """The delayed input is 1 from 0.3 s to 0.8 s, and 3 until 1 s: 0.5 + 0.6."""
    diagram = integral(DELAYS[kind]())
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("u").FixValue(context, 1.0)
    first = simulate(diagram, context=context, duration=0.5, engine=former)
    changed = first.final_context
    diagram.GetInputPort("u").FixValue(changed, 3.0)
    second = simulate(diagram, context=changed, duration=0.5, engine=latter)
    assert second["x"][-1, 0] == pytest.approx(1.1, abs=1e-9)
    late = second.Interpolate("late", np.array([0.79999, 0.80001]))
    np.testing.assert_allclose(late[:, 0], [1.0, 3.0], atol=1e-12)


@pytest.mark.parametrize("latter", ENGINES)
def test_a_state_that_changes_between_two_runs_jumps(latter):
    """x' = 0 from 2 s on -2: the delay delivers 2, and -2 from 0.6 s on."""
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", Integrator([2.0]))
    line = builder.AddNamedSystem("delay", TransportDelay(0.2, 1))
    builder.ExportInput(plant.get_input_port(), "rate")
    builder.Connect(plant.get_output_port(), line.get_input_port())
    builder.ExportOutput(line.get_output_port(), "late")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("rate").FixValue(context, 0.0)
    changed = simulate(diagram, context=context, duration=0.4).final_context
    changed.SetContinuousState([-2.0])
    second = simulate(diagram, context=changed, duration=0.4, engine=latter)
    times = np.array([0.41, 0.59999, 0.60001, 0.79])
    late = second.Interpolate("late", times)[:, 0]
    np.testing.assert_allclose(late, [2.0, 2.0, -2.0, -2.0], atol=1e-12)


def changed_on_the_way(simulator, diagram, *, has_events):
    """Returns x(1 s) of integral(), whose input changes at 0.5 s."""
    context = simulator.get_mutable_context()
    diagram.GetInputPort("u").FixValue(context, 1.0)
    simulator.AdvanceTo(0.5)
    if has_events:
        simulator.AdvancePendingEvents()
    diagram.GetInputPort("u").FixValue(context, 3.0)
    simulator.AdvanceTo(1.0)
    return diagram.GetOutputPort("x").Eval(context)[0]


def test_an_input_that_changes_during_a_run_of_a_simulator_jumps():
    diagram = integral(TransportDelay(0.3, 1))
    simulator = MakeSimulator(diagram, DefaultSimulator())
    x = changed_on_the_way(simulator, diagram, has_events=False)
    assert x == pytest.approx(1.1, abs=1e-9)


def test_it_jumps_in_drakes_own_simulator_after_the_pending_events():
    diagram = integral(TransportDelay(0.3, 1))
    x = changed_on_the_way(Simulator(diagram), diagram, has_events=True)
    assert x == pytest.approx(1.1, abs=2e-3)


@pytest.mark.mostly_slow
@pytest.mark.parametrize("names", ["long short packets", "packets short long"])
@pytest.mark.parametrize(("former", "latter"), PAIRS)
def test_delays_of_one_signal_each_deliver_it(names, former, latter):
    """What one of them stores of the signal is less than what another one needs."""
    kinds = {
        "long": TransportDelay(0.6, 1),
        "short": TransportDelay(0.005, 1),
        "packets": SampledDelay(0.5, 0.3, 1),
    }
    parts = {name: kinds[name] for name in names.split()}
    diagram = fed(parts, Sine(1.0, 6.0, 0.0, 1))
    first = simulate(diagram, duration=0.95, engine=former)
    rest = {"duration": 0.6, "engine": latter}
    second = simulate(
        diagram,
        context=first.final_context,
        suppress_initialization_events=True,
        **rest,
    )
    times = np.linspace(0.951, 1.549, 200)
    sent = np.floor((times - 0.5) / 0.3) * 0.3
    right = {"long": times - 0.6, "short": times - 0.005, "packets": sent}
    for name, past in right.items():
        late = second.Interpolate(name, times)[:, 0]
        np.testing.assert_allclose(late, np.sin(6.0 * past), atol=1e-7, err_msg=name)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_packet_of_the_start_stays_the_value_before_the_jump(engine):
    """The signal jumps from 1 to 2 at 0 s, where packet 0 is taken: before the jump."""
    parts = {"packets": SampledDelay(0.4, 0.4, 1), "late": TransportDelay(0.5, 1)}
    diagram = fed(parts, step(0.0))
    first = simulate(diagram, duration=0.45, engine="drake")
    rest = {"duration": 0.5, "engine": engine}
    second = simulate(
        diagram,
        context=first.final_context,
        suppress_initialization_events=True,
        **rest,
    )
    times = np.array([0.46, 0.49, 0.51, 0.79, 0.81, 0.94])
    shown = second.Interpolate("packets", times)[:, 0]
    late = second.Interpolate("late", times)[:, 0]
    np.testing.assert_allclose(shown, [1.0, 1.0, 1.0, 1.0, 2.0, 2.0], atol=1e-12)
    np.testing.assert_allclose(late, [0.0, 0.0, 2.0, 2.0, 2.0, 2.0], atol=1e-12)


@pytest.mark.parametrize(("former", "latter"), PAIRS)
def test_a_packet_of_a_later_run_has_the_input_of_that_run(former, latter):
    """Packets are sent at 0 and 0.4 s; the input changes from 1 to 3 at 0.4 s."""
    parts = {"packets": SampledDelay(0.4, 0.4, 1), "late": TransportDelay(0.3, 1)}
    diagram = fed(parts)
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("u").FixValue(context, 1.0)
    changed = simulate(diagram, context=context, duration=0.4, engine=former)
    changed = changed.final_context
    diagram.GetInputPort("u").FixValue(changed, 3.0)
    second = simulate(diagram, context=changed, duration=0.5, engine=latter)
    times = np.array([0.41, 0.69, 0.71, 0.79, 0.81, 0.89])
    shown = second.Interpolate("packets", times)[:, 0]
    late = second.Interpolate("late", times)[:, 0]
    np.testing.assert_allclose(shown, [1.0, 1.0, 1.0, 1.0, 3.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(late, [1.0, 1.0, 3.0, 3.0, 3.0, 3.0], atol=1e-12)


@pytest.mark.mostly_slow
@pytest.mark.parametrize(("former", "latter"), PAIRS)
def test_a_jump_that_arrives_at_a_seam_comes_after_the_packet(former, latter):
    """A step at 0.1 s arrives at 0.4 s, where a packet is sent and a run ends."""
    builder = DiagramBuilder()
    source = builder.AddSystem(step(0.1))
    line = builder.AddSystem(TransportDelay(0.3, 1, [1.0]))
    packets = builder.AddSystem(SampledDelay(0.2, 0.2, 1))
    builder.Connect(source.get_output_port(), line.get_input_port())
    builder.Connect(line.get_output_port(), packets.get_input_port())
    builder.ExportOutput(line.get_output_port(), "late")
    builder.ExportOutput(packets.get_output_port(), "packets")
    diagram = builder.Build()
    whole = simulate(diagram, duration=0.9, engine=latter)
    first = simulate(diagram, duration=0.4, engine=former)
    rest = {"duration": 0.5, "engine": latter}
    second = simulate(
        diagram,
        context=first.final_context,
        suppress_initialization_events=True,
        **rest,
    )
    times = np.array([0.41, 0.59, 0.61, 0.79, 0.81, 0.89])
    for run in (whole, second):
        assert run.solver.engine == latter
        shown = run.Interpolate("packets", times)[:, 0]
        np.testing.assert_allclose(shown, [1.0, 1.0, 1.0, 1.0, 2.0, 2.0], atol=1e-12)
        late = run.Interpolate("late", times)[:, 0]
        np.testing.assert_allclose(late, [2.0] * 6, atol=1e-12)

"""Runs that begin at a given Context, or at the final Context of another run."""

import numpy as np
import pytest
from grids import Slow
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.examples import PendulumPlant, RimlessWheel
from pydrake.symbolic import Variable
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
)
from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    EventStatus,
    LeafSystem,
)
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    DiscreteTimeIntegrator,
    FirstOrderLowPassFilter,
    Gain,
    Integrator,
    LogVectorOutput,
    Sine,
    SymbolicVectorSystem,
    ZeroOrderHold,
)
from wired import InSeries, Wired

from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Jitter, Loss, Receiver
from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.delays.variable import DelayProfile, Sinusoid, VariableDelay
from teleop_drake.loops.engine.parameters import SetNumbers
from teleop_drake.loops.framework.solver import DefaultSimulator
from teleop_drake.loops.kernel import Delay, Kernel
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError

ENGINES = ["drake", "compiled"]


def continued(diagram, first, **rest):
    """Returns the run that continues another one."""
    return simulate(
        diagram,
        context=first.final_context,
        suppress_initialization_events=True,
        **rest,
    )


def decay(delay: float | None = None) -> Diagram:
    """Returns x' = u - x, or x' = u - x(t - delay); the output x begins at 1."""
    systems = {"plant": Integrator([1.0]), "minus": Gain(-1.0, 1), "force": Adder(2, 1)}
    connections = {"minus": "plant", "force.u0": "minus", "plant": "force"}
    if delay is not None:
        systems["delay"] = TransportDelay(delay=delay, size=1, initial_value=[1.0])
        connections |= InSeries("plant", "delay", "minus")
    diagram = Wired(systems, connections, {"x": "plant"}, inputs={"u": "force.u1"})
    diagram.set_name("decay")
    return diagram


@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_begins_at_the_time_state_and_inputs_of_the_context(engine):
    diagram = decay()
    context = diagram.CreateDefaultContext()
    context.SetTime(3.0)
    context.SetContinuousState([0.25])
    diagram.GetInputPort("u").FixValue(context, 2.0)
    recording = simulate(diagram, context=context, duration=1.5, engine=engine)
    assert recording.solver.engine == engine
    assert recording.time[[0, -1]].tolist() == [3.0, 4.5]
    exact = 2.0 - 1.75 * np.exp(3.0 - recording.time)
    assert_allclose(recording["x"][:, 0], exact, atol=1e-7)
    # The Context of the caller has not changed.
    assert context.get_time() == 3.0
    assert context.get_continuous_state_vector().CopyToVector().tolist() == [0.25]
    assert context.get_accuracy() is None


@pytest.mark.parametrize("engine", ENGINES)
def test_numeric_parameters_are_those_of_the_context(engine):
    diagram = decay(delay=1.0)
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("u").FixValue(context, 0.0)
    SetNumbers(diagram, context, {"delay.delay": 0.5})
    recording = simulate(diagram, context=context, duration=1.0, engine=engine)
    assert recording.solver.engine == engine
    # Method of steps: x' = -1 until 0.5, then x' = -(1 - (t - 0.5)).
    s = recording.time - 0.5
    exact = np.where(s < 0, 0.5 - s, 0.5 - s + s**2 / 2)
    assert_allclose(recording["x"][:, 0], exact, atol=1e-9)


def test_an_open_input_is_refused_by_name_before_anything_else():
    with pytest.raises(ScenarioError, match=r"^input of decay = 'u': must be connec"):
        simulate(decay(), duration=1.0)


def test_a_context_is_of_the_system_that_is_simulated():
    context = PendulumPlant().CreateDefaultContext()
    with pytest.raises(ScenarioError, match=r"^context = 'a Context': must be one of"):
        simulate(decay(), context=context, duration=1.0)
    with pytest.raises(ScenarioError, match=r"^context = 'given': must be left out"):
        simulate(LoadScenario("one_dof"), context=context)


# A plain Simulator's run is recorded at the ends of steps, with straight lines between.
@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("delay", "engines", "inside"),
    [
        (None, "drake, drake", 1e-5),
        (None, "compiled, compiled", 1e-9),
        (0.3, "drake, drake", 1e-9),
        (0.3, "compiled, compiled", 1e-9),
        (0.3, "compiled, drake", 1e-9),
        (0.3, "drake, compiled", 1e-9),
        # At the end of the first half no signal has arrived yet.
        (1.5, "compiled, compiled", 1e-9),
        # The jump of the start arrives at the end of the first half.
        (0.9, "compiled, compiled", 1e-9),
        (0.9, "compiled, drake", 1e-9),
    ],
)
def test_two_halves_are_the_whole(delay, engines, inside):
    former, latter = engines.split(", ")
    diagram = decay(delay)
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("u").FixValue(context, 0.5)
    whole = simulate(diagram, context=context, duration=2.0, engine=latter)
    first = simulate(diagram, context=context, duration=0.9, engine=former)
    second = continued(diagram, first, duration=1.1, engine=latter)
    assert (first.solver.engine, second.solver.engine) == (former, latter)
    assert second.time[[0, -1]] == pytest.approx([0.9, 2.0], abs=1e-12)
    assert second["x"][-1] == pytest.approx(whole["x"][-1], abs=1e-9)
    times = np.linspace(0.9, 2.0, 111)
    assert_allclose(
        second.Interpolate("x", times), whole.Interpolate("x", times), atol=inside
    )


def loop_with_jumps():
    """Returns a loop with a constant and a varying delay, disturbed by a held sine."""
    profile = DelayProfile(delay=0.2, sinusoid=Sinusoid(amplitude=0.05, frequency=2.0))
    parts = {
        "sine": Sine(1.0, 2.0, 0.0, 1),
        "hold": ZeroOrderHold(0.4, 1),
        "sum": Adder(2, 1),
        "there": TransportDelay(delay=0.31, size=1),
        "plant": Integrator([1.0]),
        "back": VariableDelay(profile=profile, size=1),
        "minus": Gain(-2.0, 1),
    }
    loop = InSeries("sum", "there", "plant", "back", "minus", "sum.u1")
    connections = {"hold": "sine.y0", "sum.u0": "hold"} | loop
    return Wired(parts, connections, {"x": "plant", "delayed": "there"})


@pytest.mark.mostly_slow
@pytest.mark.parametrize("split", [0.55, 1.2, 1.31])
def test_jumps_under_way_arrive_in_the_second_half(split):
    """The hold jumps at 0.4 s, 0.8 s, ...; 1.2 s is the end of a first half."""
    diagram = loop_with_jumps()
    config = DefaultSimulator()
    config.accuracy = 1e-10
    whole = simulate(diagram, duration=2.5, simulator=config)
    first = simulate(diagram, duration=split, simulator=config)
    last = continued(diagram, first, duration=2.5 - split, simulator=config)
    third = {"duration": 0.9, "simulator": config}
    again = continued(diagram, last, **third)
    longer = simulate(diagram, duration=3.4, simulator=config)
    # Within a step, a polynomial is less exact than the state at its ends.
    for name, atol in (("x", 1e-8), ("delayed", 2e-6)):
        for part, run in ((last, whole), (again, longer)):
            inner = np.linspace(part.time[0], part.time[-1], 200)[1:-1] + 1e-6
            assert_allclose(
                part.Interpolate(name, inner), run.Interpolate(name, inner), atol=atol
            )
    assert {x.solver.engine for x in (whole, first, last, again)} == {"compiled"}


def test_no_run_makes_the_diagram_a_part_of_another_one():
    diagram = decay(0.3)
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("u").FixValue(context, 0.5)
    recording = simulate(diagram, context=context, duration=0.2, engine="drake")
    plant = diagram.GetSubsystemByName("plant")
    final = plant.GetMyContextFromRoot(recording.final_context)
    x = final.get_continuous_state_vector().CopyToVector()
    assert x == pytest.approx(recording["x"][-1], abs=1e-15)
    plant.GetMyContextFromRoot(diagram.CreateDefaultContext())


class Ender(LeafSystem):
    """Ends a run at 0.3 s."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorOutputPort("time", 1, self._CalcTime, {self.time_ticket()})
        self.DeclarePeriodicPublishEvent(10.0, 0.3, self._End)

    def _CalcTime(self, context, output):
        output.SetFromVector([context.get_time()])

    def _End(self, context):
        return EventStatus.ReachedTermination(self, "enough")


def test_an_event_that_ends_a_run_is_reported_with_its_reason():
    recording = simulate(Ender(), duration=1.0)
    assert (recording.termination, recording.reason) == ("terminated", "enough")
    assert recording.time[-1] == pytest.approx(0.3)


def test_an_event_ends_a_run_with_delays_too():
    diagram = Wired(
        {"ender": Ender(), "delay": TransportDelay(delay=0.05, size=1)},
        {"delay": "ender"},
    )
    recording = simulate(diagram, duration=1.0)
    assert (recording.termination, recording.reason) == ("terminated", "enough")


def test_a_bare_leaf_system_runs():
    wheel = RimlessWheel()
    context = wheel.CreateDefaultContext()
    context.SetContinuousState([0.0, 5.0])
    recording = simulate(wheel, context=context, duration=0.05)
    simulator = Simulator(wheel, context.Clone())
    ApplySimulatorConfig(DefaultSimulator(), simulator)
    simulator.get_mutable_context().SetAccuracy(1e-4)
    simulator.AdvanceTo(0.05)
    end = simulator.get_context().get_continuous_state_vector().CopyToVector()
    assert_allclose(recording["y0"][-1], end, atol=1e-12)


def test_a_discrete_system_without_rates_runs():
    x = Variable("x")
    system = SymbolicVectorSystem(
        state=[x], dynamics=[0.5 * x], output=[x], time_period=0.1
    )
    context = system.CreateDefaultContext()
    context.SetDiscreteState([1.0])
    recording = simulate(system, context=context, duration=0.35, engine="drake")
    assert_allclose(recording["y0"][-1], 0.5**4)


def test_unnamed_systems_are_called_by_their_class_and_numbered():
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([1.0]))
    for name in ("Gain2", "", ""):
        gain = builder.AddSystem(Gain(2.0, 1))
        if name:
            gain.set_name(name)
        builder.Connect(source.get_output_port(), gain.get_input_port())
    signals = list(simulate(builder.Build(), duration=0.1))
    assert signals == ["ConstantVectorSource.y0", "Gain2.y0", "Gain1.y0", "Gain3.y0"]


def test_no_name_of_a_system_makes_it_a_teleoperator():
    diagram = Wired({"robot": Speed(), "surgeon": Speed()}, {})
    recording = simulate(diagram, duration=0.1)
    assert list(recording) == ["robot.tool_velocity", "surgeon.tool_velocity"]


class Speed(LeafSystem):
    """A block with an output that has the name of a robot's."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorOutputPort("tool_velocity", 1, self._CalcZero)

    def _CalcZero(self, context, output):
        output.SetFromVector([0.0])


@pytest.mark.parametrize("period", [0.1, 0.04, 0.0])
def test_a_log_is_filled_by_a_compiled_run(period):
    """At Drake's times, before the updates of an instant, and by a further run, too."""
    builder = DiagramBuilder()
    wave = builder.AddNamedSystem("wave", Sine(1.0, 2.0, 0.5, 1))
    hold = builder.AddNamedSystem("hold", ZeroOrderHold(0.1, 1))
    builder.Connect(wave.get_output_port(0), hold.get_input_port())
    log = LogVectorOutput(hold.get_output_port(), builder, period)
    log.set_name("log")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    simulator = Simulator(diagram, context.Clone())
    for end in (0.5, 1.0):
        run = simulate(diagram, context=context, duration=0.5)
        assert run.notes == ["log: filled in final_context only."]
        simulator.Initialize()
        simulator.AdvanceTo(end)
        found = log.FindLog(run.final_context)
        expected = log.FindLog(simulator.get_context())
        if period:
            assert_array_equal(found.sample_times(), expected.sample_times())
            assert_allclose(found.data(), expected.data(), atol=1e-14)
        else:
            own = run.time[run.time == found.sample_times()[-1]]
            assert own[-1] == end
            value = np.sin(2.0 * (found.sample_times()[-1] - 0.1) + 0.5)
            assert_allclose(found.data()[0, -1], value, atol=1e-14)
        context = run.final_context


@pytest.mark.slow
@pytest.mark.parametrize("split", [0.45, 0.5])
@pytest.mark.parametrize("former", ENGINES)
@pytest.mark.parametrize("latter", ENGINES)
def test_ticks_that_are_rounded_to_before_the_end_happen_once(split, former, latter):
    """In floating point 15 * 0.03 < 0.45, and the delay's echo comes before 0.5."""
    parts = {
        "u": Sine(1.0, 3.0, 0.2, 1),
        "d": DiscreteTimeIntegrator(1, 0.03),
        "l": TransportDelay(0.05, 1),
        "y": FirstOrderLowPassFilter(0.1, 1),
    }
    shown = {"u": "u.y0", "d": "d", "l": "l", "y": "y"}
    diagram = Wired(parts, InSeries("u.y0", "d", "l", "y"), shown)
    whole = simulate(diagram, duration=1.0)
    first = simulate(diagram, duration=split, engine=former)
    rest = {"duration": 1.0 - split, "engine": latter}
    second = continued(diagram, first, **rest)
    times = np.linspace(split + 1e-3, 0.999, 100)
    for name in "dly":
        assert_allclose(
            second.Interpolate(name, times), whole.Interpolate(name, times), atol=1e-9
        )


def loop_with_packets(packets):
    """x' = u - x as packets have it; u is a delayed sine."""
    parts = {
        "sine": Sine(1.0, 2.0, 0.0, 1),
        "delay": TransportDelay(delay=0.13, size=1),
        "sum": Adder(2, 1),
        "there": packets,
        "plant": Integrator([1.0]),
        "minus": Gain(-1.0, 1),
    }
    loop = InSeries("sum", "there", "plant", "minus", "sum.u1")
    connections = {"delay": "sine.y0", "sum.u0": "delay"} | loop
    return Wired(parts, connections, {"x": "plant", "shown": "there"})


def lossy(receiver):
    network = PacketNetwork(
        profile=DelayProfile(delay=0.2),
        sample_period=0.05,
        jitter=Jitter(kind="uniform", std=0.06),
        loss=Loss(kind="independent", probability=0.2),
        seed=3,
    )
    return NetworkDelay(network, 1, receiver=receiver)


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("split", "former", "latter"),
    Slow(
        [
            (0.55, "compiled", "compiled"),
            (0.9, "compiled", "compiled"),
            (0.9, "compiled", "drake"),
            (0.9, "drake", "compiled"),
            (0.9, "drake", "drake"),
            (1.234, "compiled", "compiled"),
        ],
        but=[1, 2, 3],
    ),
)
@pytest.mark.parametrize(
    "make",
    Slow(
        [
            lambda: SampledDelay(size=1, delay=0.5, sample_period=0.3),
            lambda: lossy(Receiver()),
            lambda: lossy(Receiver(policy="playout", depth=0.1)),
            lambda: lossy(Receiver(policy="extrapolate")),
        ],
        but=[0, 3],
    ),
    ids=["sampled", "newest", "playout", "extrapolate"],
)
def test_packets_under_way_arrive_in_later_parts(make, split, former, latter):
    """A packet of the sampled delay is due to be sent where the first part ends."""
    diagram = loop_with_packets(make())
    config = DefaultSimulator()
    config.accuracy = 1e-10
    config.max_step_size = 0.05
    first = simulate(diagram, duration=split, simulator=config, engine=former)
    parts = [first]
    for duration in (0.3, 1.7 - split):
        kinds = {"duration": duration, "simulator": config, "engine": latter}
        parts.append(continued(diagram, parts[-1], **kinds))
    whole = simulate(diagram, duration=2.0, simulator=config)
    for part in parts:
        inner = np.linspace(part.time[0], part.time[-1], 50)[1:-1] + 1e-6
        for name in ("x", "shown"):
            assert_allclose(
                part.Interpolate(name, inner), whole.Interpolate(name, inner), atol=1e-9
            )


def test_packets_under_way_arrive_as_on_paper():
    diagram = Wired(
        {
            "source": Sine(1.0, 2.0, 0.0, 1),
            "hold": SampledDelay(size=1, delay=0.5, sample_period=0.3),
            "plant": Integrator(1),
        },
        {"hold": "source.y0", "plant": "hold"},
        {"x": "plant"},
    )
    first = simulate(diagram, duration=0.9)
    second = continued(diagram, first, duration=1.1)
    assert {x.solver.engine for x in (first, second)} == {"compiled"}
    sent = np.arange(0, 1.5, 0.3)
    held = np.diff(np.append(sent + 0.5, 2.0))
    assert second["x"][-1, 0] == pytest.approx(np.sin(2 * sent) @ held, abs=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_another_delay_is_refused_while_a_signal_is_under_way(engine):
    diagram = decay(0.3)
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("u").FixValue(context, 0.5)
    first = simulate(diagram, context=context, duration=0.2, engine=engine)
    changed = first.final_context
    SetNumbers(diagram, changed, {"delay.delay": 0.2})
    with pytest.raises(ScenarioError, match=r"delay.delay = 0.2: must be 0.3 s while"):
        simulate(diagram, context=changed, duration=0.2, engine=engine)


class Late(LeafSystem):
    """Delays its input by 0.3 s, and is only run until then."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("signal", 1)
        self.DeclareVectorOutputPort("late", 1, self._Calc, {self.nothing_ticket()})

    def _Calc(self, context, output):
        output.SetZero()

    def Kernel(self):
        delay = Delay(output="late", signal="signal", time=0.3, initial_value=[0.0])
        return Kernel(delays=[delay])


def test_a_run_without_final_context_has_a_note():
    diagram = Wired(
        {"source": ConstantVectorSource([1.0]), "late": Late()}, {"late": "source"}
    )
    recording = simulate(diagram, duration=0.2)
    assert recording.solver.engine == "compiled"
    assert recording.final_context is None
    assert any("signals under way no Context stores" in x for x in recording.notes)

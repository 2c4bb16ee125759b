"""Rows of discrete systems in Drake's Simulator, against closed forms."""

import time

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator, SimulatorConfig
from pydrake.systems.framework import (
    DiagramBuilder,
    EventStatus,
    LeafSystem,
    PublishEvent,
    WitnessFunctionDirection,
)
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    Demultiplexer,
    Gain,
    Integrator,
    LinearSystem,
    LogVectorOutput,
    Multiplexer,
    Saturation,
    Sine,
    ZeroOrderHold,
)

from teleop_drake.loops import simulate

PERIOD = 0.1


class Counter(LeafSystem):
    """Counts samples; the output declares no prerequisites, as most code in Python."""

    def __init__(self, output=lambda count, time: count):
        LeafSystem.__init__(self)
        self.num_calls = 0
        self.output = output
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, PERIOD, self.Update)
        self.DeclareVectorOutputPort("y", 1, self.CalcOutput)

    def Update(self, context, state):
        state.set_value(0, context.get_discrete_state_vector().value() + 1)

    def CalcOutput(self, context, output):
        self.num_calls += 1
        count = context.get_discrete_state_vector()[0]
        output.SetFromVector([self.output(count, context.get_time())])


def counted(counter):
    """Returns a Diagram with the count, and three times the count by a Gain."""
    builder = DiagramBuilder()
    builder.AddNamedSystem("counter", counter)
    gain = builder.AddNamedSystem("gain", Gain(3.0, 1))
    builder.Connect(counter.get_output_port(), gain.get_input_port())
    return builder.Build()


def test_a_block_that_only_seems_to_depend_on_time_is_evaluated_thrice_a_step():
    counter = Counter()
    options = {"simulator": SimulatorConfig(), "engine": "drake"}
    recording = simulate(counted(counter), duration=9.95, **options)
    # Just beside the jumps, early and late.
    times = np.r_[0.0, 0.0999, 0.1001, 0.45, 0.7999, 0.8001, 9.6999, 9.7001, 9.95]
    for name, factor in {"counter.y": 1, "gain.y0": 3}.items():
        found = recording.Interpolate(name, times)[:, 0]
        assert found == pytest.approx(factor * np.floor(times * 10 + 1e-9), abs=1e-12)
    assert counter.num_calls < 3 * 100 + 5 * 8
    assert recording.notes[1:] == []


def test_a_gain_behind_a_hold_moves_no_more_than_the_hold():
    """By its prerequisites a Gain depends on time; it is known to be none of those."""
    builder = DiagramBuilder()
    source = builder.AddSystem(Sine(1.0, 6.0, 0.0, 1))
    hold = builder.AddSystem(ZeroOrderHold(PERIOD, 1))
    gain = builder.AddSystem(Gain(2.0, 1))
    builder.Connect(source.get_output_port(0), hold.get_input_port())
    builder.Connect(hold.get_output_port(), gain.get_input_port())
    builder.ExportOutput(gain.get_output_port(), "y")
    diagram = builder.Build()
    times = np.arange(0.05, 2.0, PERIOD)
    expected = 2 * np.sin(6 * PERIOD * np.floor(times / PERIOD))
    for period in (None, 0.05):
        recording = simulate(
            diagram, duration=2.0, engine="drake", publish_period=period
        )
        found = recording.Interpolate("y", times)[:, 0]
        np.testing.assert_allclose(found, expected, atol=1e-12)
        assert len(recording.time) < 6 * 20  # No step ends between two samples.


@pytest.mark.parametrize(("duty", "start"), [(0.3, 0.0), (0.7, 0.0), (0.7, 2.0)])
def test_pulses_that_keep_time_with_the_steps_are_seen_or_named(duty, start):
    """y is 1 in the first part of each period from `start` on, 0 in the rest."""

    def pulse(_, time):
        return float(time < start or round(time / PERIOD, 9) % 1 < duty)

    options = {"simulator": SimulatorConfig(), "engine": "drake"}
    recording = simulate(Counter(pulse), duration=5.0, **options)
    times = np.arange(4.0, 5.0, PERIOD)
    for share in (0.01, duty - 0.01, duty + 0.01, 0.99):
        found = recording.Interpolate("y", times + share * PERIOD)[:, 0]
        np.testing.assert_allclose(found, float(share < duty), atol=1e-12)
    assert any(note.startswith("y: jumps or bends") for note in recording.notes)


class Trace(LeafSystem):
    """Stores each sample in an abstract state, whose length is the output."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareAbstractState(Value[object]([]))
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, self.Store)
        self.DeclareVectorOutputPort("y", 1, self.CalcOutput)

    def Store(self, context, state):
        times = [*context.get_abstract_state(0).get_value(), context.get_time()]
        state.get_mutable_abstract_state(0).set_value(times)

    def CalcOutput(self, context, output):
        output.SetFromVector([len(context.get_abstract_state(0).get_value())])


def test_a_publish_period_gives_the_rows_that_all_rows_would():
    """Also where nothing in Python looks at the steps between them."""
    for system in (Trace(), ZeroOrderHold(0.01, 1)):
        context = system.CreateDefaultContext()
        if system.num_input_ports():
            system.get_input_port().FixValue(context, [4.0])
        options = {"context": context, "duration": 1.03, "engine": "drake"}
        name = system.get_output_port(0).get_name()
        all_rows = simulate(system, **options)
        few = simulate(system, publish_period=0.05, **options)
        expected = np.r_[0.05 * np.arange(21), 1.03]
        np.testing.assert_allclose(few.time, expected, atol=1e-12)
        same = all_rows.Interpolate(name, few.time)
        same[0] = all_rows[name][0]  # Before an event at the start, as in a log.
        np.testing.assert_array_equal(few[name], same)
        assert few.final_context.get_time() == all_rows.final_context.get_time()


@pytest.mark.parametrize("engine", ["drake", "compiled"])
def test_a_publish_period_gives_the_rows_of_drakes_log(engine):
    """The first one, and those at events, have the values before an event."""
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([4.0]))
    hold = builder.AddNamedSystem("hold", ZeroOrderHold(PERIOD, 1))
    sums = LinearSystem(A=[[1.0]], B=[[1.0]], C=[[1.0]], time_period=PERIOD)
    builder.AddNamedSystem("sums", sums)
    for block in (hold, sums):
        builder.Connect(source.get_output_port(), block.get_input_port())
    logs = {
        "hold.y": LogVectorOutput(hold.get_output_port(), builder, 0.05),
        "sums.y0": LogVectorOutput(sums.get_output_port(), builder, 0.05),
    }
    diagram = builder.Build()
    options = {"signals": list(logs), "publish_period": 0.05, "engine": engine}
    recording = simulate(diagram, duration=1.0, **options)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.0)
    for name, log in logs.items():
        expected = log.FindLog(simulator.get_context())
        assert_allclose(recording.time, expected.sample_times(), atol=1e-12)
        assert_allclose(recording[name], expected.data().T, atol=1e-12, err_msg=name)


def sampled_loop(*, has_kinks):
    """Returns x'' = -9 x - u of a LinearSystem, with u a sample of x each 0.1 s.

    The signals are x, [x', x - u] by several blocks and, if wanted, x cut off at 0.3.
    """
    builder = DiagramBuilder()
    a = [[0.0, 1.0], [-9.0, 0.0]]
    plant = LinearSystem(a, [[0.0], [-1.0]], np.eye(2), np.zeros((2, 1)), 0.0)
    plant = builder.AddNamedSystem("plant", plant)
    parts = builder.AddNamedSystem("parts", Demultiplexer(2))
    hold = builder.AddNamedSystem("hold", ZeroOrderHold(PERIOD, 1))
    minus = builder.AddNamedSystem("minus", Gain(-1.0, 1))
    total = builder.AddNamedSystem("total", Adder(2, 1))
    both = builder.AddNamedSystem("both", Multiplexer(2))
    builder.Connect(plant.get_output_port(), parts.get_input_port())
    builder.Connect(parts.get_output_port(0), hold.get_input_port())
    builder.Connect(hold.get_output_port(), plant.get_input_port())
    builder.Connect(hold.get_output_port(), minus.get_input_port())
    builder.Connect(parts.get_output_port(0), total.get_input_port(0))
    builder.Connect(minus.get_output_port(), total.get_input_port(1))
    builder.Connect(parts.get_output_port(1), both.get_input_port(0))
    builder.Connect(total.get_output_port(), both.get_input_port(1))
    if has_kinks:
        limit = builder.AddNamedSystem("limit", Saturation([-9.0], [0.3]))
        builder.Connect(parts.get_output_port(0), limit.get_input_port())
    return builder.Build()


def solved(times):
    """Returns x, x', u of sampled_loop() at times beside the samples, from x = 1."""
    x = 1.0
    v = 0.0
    found = []
    for k in range(int(times[-1] / PERIOD) + 1):
        u = x
        own = times[(times > k * PERIOD) & (times < (k + 1) * PERIOD)] - k * PERIOD
        for h in (*own, PERIOD):
            c = np.cos(3 * h)
            s = np.sin(3 * h)
            found.append(
                [(x + u / 9) * c + v / 3 * s - u / 9, v * c - 3 * (x + u / 9) * s, u]
            )
        x, v, _ = found.pop()
    return np.array(found)


@pytest.mark.parametrize("has_kinks", [False, True])
def test_affine_signals_follow_the_state_and_jump_with_samples(has_kinks):
    diagram = sampled_loop(has_kinks=has_kinks)
    context = diagram.CreateDefaultContext()
    context.SetContinuousState([1.0, 0.0])
    recording = simulate(diagram, context=context, duration=2.0, engine="drake")
    times = np.arange(0.0037, 2.0, 0.0114)
    x, v, u = solved(times).T
    expected = {
        "plant.y0": np.transpose([x, v]),
        "parts.y1": np.transpose([v]),
        "total.sum": np.transpose([x - u]),
        "both.y0": np.transpose([v, x - u]),
    }
    if has_kinks:
        expected["limit.y0"] = np.transpose([np.minimum(x, 0.3)])
    for name, values in expected.items():
        found = recording.Interpolate(name, times)
        tolerance = 3e-4 if name == "limit.y0" else 1e-6
        np.testing.assert_allclose(found, values, atol=tolerance, err_msg=name)


class Opaque(LeafSystem):
    """A hold that stores its sample in an abstract state."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("u", 1)
        state = self.DeclareAbstractState(Value[object](0.0))
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, self.Store)
        tickets = {self.abstract_state_ticket(state)}
        self.DeclareVectorOutputPort("y", 1, self.CalcOutput, tickets)

    def Store(self, context, state):
        value = self.get_input_port().Eval(context)[0]
        state.get_mutable_abstract_state(0).set_value(value)

    def CalcOutput(self, context, output):
        output.SetFromVector([context.get_abstract_state(0).get_value()])


def test_a_sum_with_a_hold_that_is_not_recorded_is_right():
    """x' = 1 from 0, and a sample of x each 0.1 s in an abstract state: their sum."""
    builder = DiagramBuilder()
    rate = builder.AddSystem(ConstantVectorSource([1.0]))
    x = builder.AddSystem(Integrator(1))
    hold = builder.AddSystem(Opaque())
    total = builder.AddSystem(Adder(2, 1))
    builder.Connect(rate.get_output_port(), x.get_input_port())
    builder.Connect(x.get_output_port(), hold.get_input_port())
    builder.Connect(x.get_output_port(), total.get_input_port(0))
    builder.Connect(hold.get_output_port(), total.get_input_port(1))
    builder.ExportOutput(total.get_output_port(), "y")
    recording = simulate(builder.Build(), duration=1.0, engine="drake")
    times = np.arange(0.0137, 1.0, 0.0314)
    expected = times + PERIOD * np.floor(times / PERIOD)
    found = recording.Interpolate("y", times)[:, 0]
    np.testing.assert_allclose(found, expected, atol=2e-4)


def test_a_publish_period_evaluates_no_output_between_the_rows():
    counter = Counter()
    options = {"simulator": SimulatorConfig(), "engine": "drake"}
    recording = simulate(counted(counter), duration=10.0, publish_period=2.5, **options)
    assert_array_equal(recording["counter.y"][:, 0], [0, 24, 49, 74, 99])
    assert_array_equal(recording["gain.y0"], 3 * recording["counter.y"])
    # Each sample evaluates the count once before and once after an event.
    assert counter.num_calls <= 2 * 5


def test_a_signal_that_moves_takes_no_other_one_along():
    """Beside a sine, a count is evaluated within a step as rarely as without it."""
    counter = Counter()
    builder = DiagramBuilder()
    builder.AddNamedSystem("sine", Sine(2.0, 6.0, 0.0, 1))
    builder.AddNamedSystem("counter", counter)
    options = {"simulator": SimulatorConfig(), "engine": "drake"}
    recording = simulate(builder.Build(), duration=9.95, **options)
    times = np.linspace(0.0, 9.95, 777)
    found = recording.Interpolate("sine.y0", times)[:, 0]
    assert_allclose(found, 2 * np.sin(6 * times), atol=2e-4)
    found = recording.Interpolate("counter.y", times)[:, 0]
    assert_allclose(found, np.floor(times * 10 + 1e-9), atol=1e-12)
    assert counter.num_calls < 3 * 100 + 5 * 8
    assert recording.notes[1:] == []


@pytest.mark.parametrize("start", [0.0, 4.03])
def test_a_signal_is_followed_from_the_step_on_in_which_it_moves(start):
    """y is the count before `start`, then grows by 1 each second, without a note."""

    def ramp(count, time):
        return count if time < start else start * 10 // 1 + time - start

    options = {"simulator": SimulatorConfig(), "engine": "drake"}
    recording = simulate(Counter(ramp), duration=9.95, **options)
    times = np.linspace(0.0, 9.95, 1234)
    expected = [ramp(np.floor(t * 10 + 1e-9), t) for t in times]
    found = recording.Interpolate("y", times)[:, 0]
    assert_allclose(found, expected, atol=2e-3)
    assert recording.notes[1:] == []


class Product(LeafSystem):
    """The product of two inputs, in Python."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.num_calls = 0
        self.DeclareVectorInputPort("a", 1)
        self.DeclareVectorInputPort("b", 1)
        self.DeclareVectorOutputPort("y", 1, self.CalcOutput)

    def CalcOutput(self, context, output):
        a, b = (self.get_input_port(i).Eval(context)[0] for i in (0, 1))
        output.SetFromVector([a * b])


def test_each_step_has_the_discrete_states_of_its_own():
    """The product of t and of a sample of it each 0.1 s, over some hundred samples."""
    builder = DiagramBuilder()
    rate = builder.AddSystem(ConstantVectorSource([1.0]))
    x = builder.AddSystem(Integrator(1))
    hold = builder.AddSystem(ZeroOrderHold(PERIOD, 1))
    product = builder.AddSystem(Product())
    for source, target in [
        (rate, x.get_input_port()),
        (x, hold.get_input_port()),
        (x, product.get_input_port(0)),
        (hold, product.get_input_port(1)),
    ]:
        builder.Connect(source.get_output_port(), target)
    builder.ExportOutput(product.get_output_port(), "y")
    recording = simulate(builder.Build(), duration=40.0, engine="drake")
    times = np.arange(0.0137, 40.0, 0.0314)
    expected = times * PERIOD * np.floor(times / PERIOD)
    assert_allclose(recording.Interpolate("y", times)[:, 0], expected, atol=1e-9)
    assert recording.notes[1:] == []


class Undefined(LeafSystem):
    """x[k + 1] = -2 x[k]^1.5 has no value from 0.2 s on; an update may end the run."""

    def __init__(self, end=np.inf):
        LeafSystem.__init__(self)
        self.end = end
        state = self.DeclareDiscreteState([1.0])
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, PERIOD, self.Update)
        self.DeclareStateOutputPort("y", state)

    def Update(self, context, state):
        x = context.get_discrete_state_vector().value()
        with np.errstate(invalid="ignore"):
            state.set_value(0, -2 * x**1.5)
        if context.get_time() > self.end:
            return EventStatus.ReachedTermination(self, "told")
        return EventStatus.Succeeded()


@pytest.mark.parametrize("end", [np.inf, 0.75])
@pytest.mark.parametrize("period", [None, 0.5])
def test_a_held_signal_that_is_no_number_ends_the_run(period, end):
    """Also where an event ends it before the samples are checked."""
    recording = simulate(
        Undefined(end), duration=50.0, engine="drake", publish_period=period
    )
    assert recording.termination == "diverged"
    assert recording.reason == "a signal is not finite"
    assert np.isfinite(recording["y"]).all()
    assert recording.time[-1] == pytest.approx(0.0 if period else 0.2, abs=1e-9)


class Slow(Counter):
    """A count each 0.1 s, whose update takes 20 ms of real time."""

    def Update(self, context, state):
        super().Update(context, state)
        time.sleep(0.02)


def test_a_slow_run_of_held_signals_shows_its_progress():
    builder = DiagramBuilder()
    count = builder.AddSystem(Slow())
    hold = builder.AddNamedSystem("hold", ZeroOrderHold(PERIOD, 1))
    builder.Connect(count.get_output_port(), hold.get_input_port())
    times = []
    options = {"engine": "drake", "signals": ["hold.y"], "progress": times.append}
    simulate(builder.Build(), duration=5.05, **options)
    # 1 s of real time or more, with a report each 0.1 s at the most.
    assert len(times) >= 5
    assert times == sorted(times)


def test_a_signal_that_fails_within_a_step_ends_the_run_with_its_error():
    """As late as the steps are followed; the run itself needs no value of y."""

    class Failing(Product):
        def CalcOutput(self, context, output):
            if 0.4321 < context.get_time() < 0.4329:
                raise LookupError("no value is known here")
            output.SetFromVector([context.get_time()])

    builder = DiagramBuilder()
    x = builder.AddSystem(Integrator([1.0]))
    minus = builder.AddSystem(Gain(-1.0, 1))
    failing = builder.AddSystem(Failing())
    builder.Connect(x.get_output_port(), minus.get_input_port())
    for port in (x.get_input_port(), *map(failing.get_input_port, (0, 1))):
        builder.Connect(minus.get_output_port(), port)
    builder.ExportOutput(failing.get_output_port(), "y")
    config = SimulatorConfig(
        integration_scheme="runge_kutta3", max_step_size=0.0032, use_error_control=False
    )
    with pytest.raises(LookupError, match="no value is known here"):
        simulate(builder.Build(), duration=1.0, engine="drake", simulator=config)


def test_rows_of_held_signals_are_at_the_ends_of_steps():
    hold = ZeroOrderHold(PERIOD, 1)
    context = hold.CreateDefaultContext()
    hold.get_input_port().FixValue(context, [4.0])
    recording = simulate(hold, context=context, duration=0.45, engine="drake")
    # The first sample is taken at 0, where the step to 0.1 begins with a jump.
    assert_allclose(recording.time, [0, 0, 0.1, 0.2, 0.3, 0.4, 0.45], atol=1e-12)
    assert_array_equal(recording["y"][:, 0], [0, 4, 4, 4, 4, 4, 4])
    assert recording.steps.shape == (5, 2)


class Seven(LeafSystem):
    """A constant in Python, which may depend on time for all that Drake knows."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorOutputPort("y", 1, lambda _, y: y.SetFromVector([7.0]))


def test_a_look_at_one_signal_leaves_the_states_of_another_one():
    """sin(6 t) times a sample each 10 s, beside a constant that is looked at."""
    builder = DiagramBuilder()
    sine = builder.AddSystem(Sine(1.0, 6.0, 0.0, 1))
    source = builder.AddSystem(Sine(1.0, 0.2, 0.0, 1))
    hold = builder.AddSystem(ZeroOrderHold(10.0, 1))
    product = builder.AddNamedSystem("product", Product())
    builder.AddNamedSystem("seven", Seven())
    builder.Connect(source.get_output_port(0), hold.get_input_port())
    builder.Connect(sine.get_output_port(0), product.get_input_port(0))
    builder.Connect(hold.get_output_port(), product.get_input_port(1))
    names = ["product.y", "seven.y"]
    recording = simulate(builder.Build(), duration=38.0, engine="drake", signals=names)
    times = np.arange(0.0137, 38.0, 0.0314)
    expected = np.sin(6 * times) * np.sin(2 * np.floor(times / 10))
    found = recording.Interpolate("product.y", times)[:, 0]
    assert_allclose(found, expected, atol=2e-4)


class Since(LeafSystem):
    """The time since the last sample, which an abstract state has."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareAbstractState(Value[object](0.0))
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, self.Store)
        self.DeclareVectorOutputPort("y", 1, self.CalcOutput)

    def Store(self, context, state):
        state.get_mutable_abstract_state(0).set_value(context.get_time())

    def CalcOutput(self, context, output):
        since = context.get_time() - context.get_abstract_state(0).get_value()
        output.SetFromVector([since])


def test_a_jump_by_an_abstract_state_is_at_the_beginning_of_a_step():
    """y is t less the last multiple of 0.1 s, with five rows in each step."""
    recording = simulate(
        Since(), duration=5.0, engine="drake", simulator=SimulatorConfig()
    )
    times = np.arange(0.0137, 5.0, 0.0314)
    found = recording.Interpolate("y", times)[:, 0]
    assert_allclose(found, times % PERIOD, atol=1e-12)
    assert len(recording.time) <= 1 + 5 * 50
    assert recording.notes[1:] == []


def test_a_rate_that_depends_on_an_abstract_state_is_right_behind_its_jump():
    """x' is a sample of t each 0.1 s."""
    builder = DiagramBuilder()
    clock = builder.AddSystem(Integrator(1))
    rate = builder.AddSystem(ConstantVectorSource([1.0]))
    hold = builder.AddSystem(Opaque())
    x = builder.AddSystem(Integrator(1))
    builder.Connect(rate.get_output_port(), clock.get_input_port())
    builder.Connect(clock.get_output_port(), hold.get_input_port())
    builder.Connect(hold.get_output_port(), x.get_input_port())
    builder.ExportOutput(x.get_output_port(), "x")
    recording = simulate(builder.Build(), duration=2.0, engine="drake")
    times = np.arange(0.0137, 2.0, 0.0314)
    k = np.floor(times / PERIOD)
    expected = PERIOD**2 * k * (k - 1) / 2 + PERIOD * k * (times - PERIOD * k)
    assert_allclose(recording.Interpolate("x", times)[:, 0], expected, atol=1e-9)


@pytest.mark.parametrize("period", [None, 0.5])
def test_the_last_row_of_a_discrete_system_is_where_an_event_ends_the_run(period):
    class Ending(Counter):
        def Update(self, context, state):
            super().Update(context, state)
            if context.get_time() > 1.15:
                return EventStatus.ReachedTermination(self, "counted")
            return EventStatus.Succeeded()

    recording = simulate(Ending(), duration=5.0, engine="drake", publish_period=period)
    assert recording.termination == "terminated"
    assert recording.reason == "counted"
    if period:
        assert_allclose(recording.time, [0.0, 0.5, 1.0, 1.2], atol=1e-12)
        # Nothing looked at the step before the event; the last row is behind it.
        assert_array_equal(recording["y"][:, 0], [0, 4, 9, 12])
    else:
        assert recording.time[-1] == pytest.approx(1.2, abs=1e-12)


@pytest.mark.parametrize("has_kinks", [False, True])
@pytest.mark.parametrize("period", [0.013, 0.1, 0.7])
def test_rows_that_are_far_apart_are_those_of_the_closed_form(has_kinks, period):
    """Steps without a row are passed, in a loop with a sample each 0.1 s."""
    diagram = sampled_loop(has_kinks=has_kinks)
    context = diagram.CreateDefaultContext()
    context.SetContinuousState([1.0, 0.0])
    options = {"context": context, "duration": 2.05, "engine": "drake"}
    recording = simulate(diagram, publish_period=period, **options)
    times = np.append(period * np.arange(int(2.05 / period) + 1), 2.05)
    assert_allclose(recording.time, times, atol=1e-12)
    # Values at an event are those before it.
    x, v, u = solved(times[1:] - 1e-9).T
    assert_allclose(recording["plant.y0"][1:], np.transpose([x, v]), atol=1e-6)
    assert_allclose(recording["total.sum"][1:, 0], x - u, atol=1e-6)
    if has_kinks:
        assert_allclose(recording["limit.y0"][1:, 0], np.minimum(x, 0.3), atol=3e-4)
    everything = simulate(diagram, **options)
    state = everything.final_context.get_continuous_state_vector().CopyToVector()
    final = recording.final_context
    assert_array_equal(final.get_continuous_state_vector().CopyToVector(), state)
    assert recording.solver.steps == everything.solver.steps


class Stop(LeafSystem):
    """Ends the run where x' = 1 is 1.2345, by a witness function."""

    def __init__(self):
        LeafSystem.__init__(self)
        state = self.DeclareContinuousState(1)
        self.DeclareStateOutputPort("x", state)
        self.num_calls = 0
        self.DeclareVectorOutputPort("y", 1, self.CalcOutput)
        self.witness = self.MakeWitnessFunction(
            "stop",
            WitnessFunctionDirection.kNegativeThenNonNegative,
            lambda context: context.get_continuous_state_vector()[0] - 1.2345,
            PublishEvent(callback=lambda context, event: self.End()),
        )

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.SetFromVector([1.0])

    def CalcOutput(self, context, output):
        self.num_calls += 1
        output.SetFromVector([context.get_time() ** 2])

    def DoGetWitnessFunctions(self, context):
        return [self.witness]

    def End(self):
        return EventStatus.ReachedTermination(self, "far enough")


def test_the_last_row_is_where_an_event_ends_the_run():
    system = Stop()
    config = SimulatorConfig(max_step_size=0.001)
    recording = simulate(
        system, duration=5.0, publish_period=0.5, engine="drake", simulator=config
    )
    assert recording.termination == "terminated"
    end = recording.time[-1]
    assert end == pytest.approx(1.2345, abs=1e-6)
    assert_allclose(recording.time, [0.0, 0.5, 1.0, end], atol=1e-12)
    assert_allclose(recording["x"][:, 0], recording.time, atol=1e-9)
    assert_allclose(recording["y"][:, 0], recording.time**2, atol=1e-9)
    # Steps without a row need no output: they are 1230 of 1235.
    assert system.num_calls < 100

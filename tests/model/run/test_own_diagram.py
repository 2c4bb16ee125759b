"""Runs of a user's own Diagrams, against closed forms."""

import math
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import (
    DiagramBuilder,
    LeafSystem,
    UnrestrictedUpdateEvent,
    WitnessFunctionDirection,
)
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Gain,
    Integrator,
    Sine,
)
from wired import Wired

from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.kernel import FixedBlock, Kernel
from teleop_drake.loops.run.recording import UnknownSignal
from teleop_drake.model.run.compile import Compile
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.tasks.metrics import RunMetrics, RunSummary
from teleop_drake.study.figures.runs import PlotRun
from teleop_drake.study.figures.scene import MakeReplay


class Halver(LeafSystem):
    """A block that offers no kernel."""

    def __init__(self):
        LeafSystem.__init__(self)
        signal = self.DeclareVectorInputPort("signal", 1)

        def Calc(context, output):
            output.SetFromVector(0.5 * signal.Eval(context))

        tickets = {signal.ticket()}
        self.DeclareVectorOutputPort("half", 1, Calc, prerequisites_of_calc=tickets)


def LateLoop(gain, *, exports=True):
    """Returns x' = -x(t - 1) from x = 1; the block `gain` halves the delayed signal."""
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", Integrator([1.0]))
    delay = TransportDelay(delay=1.0, size=1, initial_value=[1.0])
    builder.AddNamedSystem("delay", delay)
    builder.AddNamedSystem("gain", gain)
    minus = builder.AddNamedSystem("minus", Gain(-2.0, 1))
    builder.Connect(plant.get_output_port(), delay.get_input_port())
    builder.Connect(delay.get_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), minus.get_input_port())
    builder.Connect(minus.get_output_port(), plant.get_input_port())
    if exports:
        builder.ExportOutput(plant.get_output_port(), "x")
    diagram = builder.Build()
    diagram.set_name("loop")
    return diagram


def Exact(t):
    """Returns the solution of x' = -x(t - 1) by the method of steps."""
    return sum(
        (-1) ** k * np.maximum(t - k + 1, 0) ** k / math.factorial(k)
        for k in range(math.ceil(t.max()) + 2)
    )


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("gain", "engine", "used"),
    [
        (partial(Gain, 0.5, 1), "auto", "compiled"),
        (partial(Gain, 0.5, 1), "drake", "drake"),
        (Halver, "auto", "compiled"),
    ],
)
def test_a_delay_is_exact_in_both_engines(gain, engine, used):
    recording = simulate(LateLoop(gain()), duration=2.1, engine=engine)
    assert recording.solver.engine == used
    is_read = any("gain: machine code of" in note for note in recording.notes)
    assert is_read == (gain is Halver)
    assert list(recording) == ["x"] and recording.time[-1] == 2.1
    assert_allclose(recording["x"][:, 0], Exact(recording.time), atol=1e-6)


def test_without_exported_outputs_all_of_its_systems_are_recorded():
    recording = simulate(LateLoop(Halver(), exports=False), duration=1.5)
    late = recording["delay.delayed_signal"]
    assert_allclose(recording["gain.half"], 0.5 * late, rtol=1e-12)
    assert set(recording) == {
        *("plant.y0", "delay.delayed_signal", "gain.half", "minus.y0")
    }


@pytest.mark.parametrize("engine", ["compiled", "drake"])
def test_jumps_are_where_they_are(engine):
    """A sine is held for 0.3 s and integrated; each jump of the hold has two rows."""
    diagram = Wired(
        {
            "source": Sine(1.0, 2.0, 0.0, 1),
            "hold": SampledDelay(size=1, delay=0.5, sample_period=0.3),
            "plant": Integrator(1),
        },
        {"hold": "source.y0", "plant": "hold"},
        {"held": "plant"},
    )
    recording = simulate(diagram, duration=2.0, engine=engine)
    sent = np.arange(0, 1.5, 0.3)
    shown = np.append(sent + 0.5, 2.0)
    exact = np.concatenate(([0], np.cumsum(np.sin(2 * sent) * np.diff(shown))))
    held = np.interp(recording.time, shown, exact)
    assert_allclose(recording["held"][:, 0], held, atol=1e-6)
    twice = recording.time[1:][np.diff(recording.time) == 0]
    assert np.abs(shown[:-1, None] - twice).min(axis=1).max() < 1e-9


def test_a_recording_without_scenario_shows_itself_or_refuses(subtests):
    recording = simulate(LateLoop(Gain(0.5, 1)), duration=1.5)
    assert repr(recording).startswith("<Recording of a diagram: 1.5 s in ")
    assert "1.5 s" in recording._repr_html_()
    (ax,) = PlotRun(recording, time=(0.5, 1.0)).axes
    assert ax.get_ylabel() == "x" and ax.lines[1].get_xdata()[-1] == 1.0
    table = recording.to_dataframe()
    assert_array_equal(table["x", 0], recording["x"][:, 0])
    with pytest.raises(UnknownSignal, match="signal 'y': must be"):
        PlotRun(recording, signals=["y"])
    for refused in (
        partial(MakeReplay, recording),
        partial(MakeReplay, {"a": recording}),
        *(partial(RunMetrics, recording), partial(RunSummary, recording)),
    ):
        with (
            subtests.test(refused=refused),
            pytest.raises(
                ScenarioError, match=r"^recordings?.scenario = null: must be"
            ),
        ):
            refused()


def Open():
    builder = DiagramBuilder()
    builder.ExportInput(builder.AddSystem(Integrator(1)).get_input_port(), "force")
    diagram = builder.Build()
    diagram.set_name("open")
    return diagram


def NoOutputs():
    diagram = Wired({"leafsystem": LeafSystem()}, {})
    diagram.set_name("silent")
    return diagram


@pytest.mark.parametrize(
    ("make", "options", "message"),
    [
        (Halver, {}, "input of Halver = 'signal': must be connected to a source, or"),
        (Open, {}, "input of open = 'force': must be connected to a source, or fixed"),
        (NoOutputs, {"duration": None}, "duration = null: must be"),
        (NoOutputs, {"duration": -1.0}, "duration = -1.0: must be"),
        (NoOutputs, {"engine": "fast"}, "engine = 'fast': must be"),
        (NoOutputs, {"teleoperator": 1}, "teleoperator = 'given': must be left out"),
    ],
)
def test_bad_input(make, options, message):
    with pytest.raises(ScenarioError) as info:
        simulate(make(), **{"duration": 1.0} | options)
    assert str(info.value).startswith(message) and "\n" not in str(info.value)


class Poses(LeafSystem):
    """A clock x' = 1 whose only output is abstract."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareContinuousState(1)
        self.DeclareAbstractOutputPort(
            "pose", lambda: AbstractValue.Make({}), lambda context, value: None
        )

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.SetFromVector([1.0])


@pytest.mark.parametrize(
    ("make", "engine"), [(NoOutputs, "drake"), (Poses, "compiled")]
)
def test_a_system_without_vector_outputs_runs(make, engine):
    run = simulate(make(), duration=1.0)
    assert (run.solver.engine, list(run), run.time[-1]) == (engine, [], 1.0)
    x = run.final_context.get_continuous_state_vector().CopyToVector()
    assert_allclose(x, np.ones(len(x)))


def test_numbers_that_leave_the_finite_end_a_run():
    config = SimulatorConfig(use_error_control=False, max_step_size=0.01)
    diagram = Wired(
        {"plant": Integrator([1.0]), "gain": Gain(800.0, 1)},
        {"gain": "plant", "plant": "gain"},
        {"x": "plant"},
    )
    recording = simulate(diagram, duration=9.0, simulator=config)
    assert recording.reason == "a signal is not finite"
    assert np.isfinite(recording["x"]).all() and recording["x"][-1] > 1e300


def no_number(u):
    return (u - 1) / (u - 1)


@pytest.mark.filterwarnings("ignore:invalid value encountered")
@pytest.mark.parametrize("engine", ["compiled", "drake"])
def test_a_law_without_a_number_at_the_start_is_refused_in_both_engines(engine):
    """This includes machine code, where two NaN are equal in the comparison."""
    kernel = Kernel(outputs={"y": (no_number, "u")})
    law = FixedBlock("law", kernel, inputs={"u": 1}, outputs={"y": 1})
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("source", ConstantVectorSource([1.0]))
    builder.AddSystem(law)
    builder.Connect(source.get_output_port(), law.get_input_port())
    with pytest.raises(ValueError, match="the run has no start: a signal is not fin"):
        simulate(builder.Build(), duration=0.1, engine=engine)


def test_the_duration_of_a_scenario_can_be_given():
    scenario = LoadScenario("one_dof")
    recording = simulate(scenario, duration=0.1)
    assert recording.time[-1] == recording.scenario.duration == 0.1
    assert scenario.duration != 0.1


class Switch(LeafSystem):
    """A block with x' = 1 until x is 0.25, then x' = -2."""

    def __init__(self):
        LeafSystem.__init__(self)
        self._state = self.DeclareContinuousState(1)
        self._mode = self.DeclareDiscreteState([1.0])
        self.DeclareVectorOutputPort("rate", 1, self._CalcRate, {self.xd_ticket()})
        self._witness = self.MakeWitnessFunction(
            "full",
            WitnessFunctionDirection.kNegativeThenNonNegative,
            lambda x: x.get_continuous_state_vector()[0] - 0.25,
            UnrestrictedUpdateEvent(
                lambda context, event, state: state.get_mutable_discrete_state(
                    self._mode
                ).SetAtIndex(0, -2.0)
            ),
        )

    def DoGetWitnessFunctions(self, context):
        return [self._witness]

    def _CalcRate(self, context, output):
        output.SetFromVector(context.get_discrete_state(self._mode).CopyToVector())

    def DoCalcTimeDerivatives(self, context, derivatives):
        rate = context.get_discrete_state(self._mode).CopyToVector()
        derivatives.get_mutable_vector().SetFromVector(rate)


def test_an_event_of_a_users_own_stands_twice():
    diagram = Wired(
        {"system": Switch(), "plant": Integrator(1)},
        {"plant": "system"},
        {"rate": "system", "y": "plant"},
    )
    recording = simulate(diagram, duration=1.0, engine="drake")
    (place,) = np.flatnonzero(np.diff(recording.time) == 0)
    assert recording.time[place] == pytest.approx(0.25, abs=1e-6)
    assert recording["rate"][place : place + 2, 0].tolist() == [1.0, -2.0]
    times = np.linspace(0, 1, 1001)
    exact = np.where(times < 0.25, times, 0.75 - 2 * times)
    y = recording.Interpolate("y", times)[:, 0]
    assert_allclose(y, exact, atol=1e-6)


@pytest.mark.parametrize("engine", ["drake", "compiled"])
def test_publish_period_thins_the_rows_and_nothing_else(engine):
    """x = t^2 / 2 of two integrators, with rows at 0, 0.3, 0.6, 0.9 and the end."""
    builder = DiagramBuilder()
    speed = builder.AddNamedSystem("speed", Integrator(1))
    builder.Connect(
        builder.AddSystem(ConstantVectorSource([1.0])).get_output_port(),
        speed.get_input_port(),
    )
    way = builder.AddNamedSystem("way", Integrator(1))
    builder.Connect(speed.get_output_port(), way.get_input_port())
    builder.ExportOutput(way.get_output_port(), "x")
    diagram = builder.Build()
    full = simulate(diagram, duration=1.0, engine=engine)
    thin = simulate(diagram, duration=1.0, engine=engine, publish_period=0.3)
    assert thin.time == pytest.approx([0.0, 0.3, 0.6, 0.9, 1.0])
    assert thin["x"][:, 0] == pytest.approx(thin.time**2 / 2, abs=1e-12)
    assert thin.Interpolate("x", [0.75])[0, 0] == pytest.approx(0.2925)
    assert thin.solver.steps == full.solver.steps
    assert any("publish_period" in note for note in thin.notes)
    if engine == "compiled":
        program = Compile(diagram, duration=1.0)
        assert len(program.Run(publish_period=0.5).time) == 3
        assert len(program.Run().time) == len(full.time)
    with pytest.raises(ScenarioError, match="publish_period"):
        simulate(diagram, duration=1.0, publish_period=0.0)

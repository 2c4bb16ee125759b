"""Tests of steps that fail: a shorter step is tried, or the run ends."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import DiagramBuilder, EventStatus, LeafSystem

from teleop_drake.loops.engine import run as compiled_runs
from teleop_drake.loops.kernel import Kernel
from teleop_drake.loops.kernel.block import FixedBlock
from teleop_drake.loops.run import run as simulation_run
from teleop_drake.loops.run.simulator import MakeSimulator
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError

SCHEMES = ["runge_kutta3", "runge_kutta5"]

K = 2000.0  # 1/s


class Decay(LeafSystem):
    """Three states with dx/dt = -K (x - cos t), and rates that may fail."""

    def __init__(self, fail):
        LeafSystem.__init__(self)
        self.fail = fail
        self.num_calls = 0
        self.DeclareContinuousState(3)
        # The number of events, one every 0.1 s.
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self.count)

    def count(self, context, values):
        number = context.get_discrete_state_vector().GetAtIndex(0)
        values.set_value(np.array([number + 1]))
        return EventStatus.Succeeded()

    def DoCalcTimeDerivatives(self, context, derivatives):
        self.num_calls += 1
        assert self.num_calls < 50_000, "it never ends"
        x = context.get_continuous_state_vector().CopyToVector()
        rate = -K * (x - np.cos(context.get_time()))
        derivatives.get_mutable_vector().SetFromVector(
            self.fail(context.get_time(), x, rate)
        )


def make_simulator(fail, scheme, **config):
    builder = DiagramBuilder()
    system = builder.AddNamedSystem("decay", Decay(fail))
    # A block of the package checks each step.
    kernel = Kernel(outputs={"time": "time"})
    builder.AddSystem(FixedBlock("watcher", kernel, inputs={}, outputs={"time": 1}))
    diagram = builder.Build()
    config = {"integration_scheme": scheme, "max_step_size": 0.05} | config
    simulator = MakeSimulator(diagram, SimulatorConfig(accuracy=1e-6, **config))
    context = system.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    context.SetContinuousState(np.full(3, 1.4))
    return simulator, context


def raise_far_away(time, x, rate):
    """Fails at states that only a step that is too long tries."""
    if np.abs(x).max() > 1.5:
        raise np.linalg.LinAlgError("too far away")
    return rate


def not_finite_far_away(time, x, rate):
    rate[1] = rate[1] if np.abs(x).max() <= 1.5 else np.nan
    return rate


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("fail", [raise_far_away, not_finite_far_away])
def test_a_step_that_fails_is_tried_again_as_a_shorter_one(fail, scheme):
    simulator, context = make_simulator(fail, scheme)
    simulator.AdvanceTo(0.25)
    x = context.get_continuous_state_vector().CopyToVector()
    expected = (K * np.cos(0.25) + np.sin(0.25)) * K / (K**2 + 1)
    assert_allclose(x, expected, rtol=0, atol=1e-5)
    # Events at the start of a step happen once.
    assert context.get_discrete_state_vector().GetAtIndex(0) == 3


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("number", [np.nan, np.inf])
@pytest.mark.parametrize("index", [0, 1])
def test_rates_that_are_not_finite_end_the_run(index, number, scheme):
    """Drake by itself would not end (index 0), or would report no error (index 1)."""

    def fail(time, x, rate):
        rate[index] = number if time > 0.05 else rate[index]
        return rate

    simulator, context = make_simulator(fail, scheme)
    with pytest.raises((ArithmeticError, RuntimeError)):
        simulator.AdvanceTo(0.45)
    assert context.get_time() == pytest.approx(0.05, abs=1e-6)


def test_a_step_of_fixed_length_is_not_tried_again():
    simulator, context = make_simulator(
        raise_far_away, "runge_kutta3", use_error_control=False
    )
    with pytest.raises(np.linalg.LinAlgError):
        simulator.AdvanceTo(0.45)
    assert context.get_time() <= 0.05


RATE = {"controller.adaptation_rate": 1e8, "duration": 1e-6}


def test_the_longest_step_does_not_decide_whether_a_run_diverges():
    """The first steps that are tried are too long for the law; shorter ones succeed."""
    runs = [
        simulate(LoadScenario("two_dof_combined", RATE | step))
        for step in ({}, {"simulator.max_step_size": 1e-6})
    ]
    for run in runs:
        assert run.termination == "completed"
        assert run.solver.derivative_evaluations > 6 * run.solver.steps
    ends = [run["control_force"][-1] for run in runs]
    assert np.abs(ends[0]).max() > 1e-3
    assert_allclose(*ends, rtol=1e-3)


@pytest.mark.mostly_slow
@pytest.mark.parametrize("engine", ["drake", "compiled"])
def test_steps_without_end_are_refused(engine, monkeypatch):
    """A run is refused after about a hundredth of the steps that are allowed."""
    monkeypatch.setattr(simulation_run, "_MOST_STEPS", 3000)
    monkeypatch.setattr(simulation_run, "_STRETCH", 30)
    monkeypatch.setattr(compiled_runs, "_ROOM", 30)
    scenario = LoadScenario("two_dof_combined", RATE | {"duration": 1.0})
    match = r"duration = 1: must be at most .* s here, which took [3-7]\d steps;"
    with pytest.raises(ScenarioError, match=match):
        simulate(scenario, engine=engine)


@pytest.mark.parametrize("is_stuck", [False, True])
def test_a_slow_stretch_is_no_crawl(is_stuck):
    """10 000 steps may cover a hundredth of the time, between faster stretches."""
    pace = simulation_run.Pace(10.0)
    pace.Check(9_000, 2.0)
    pace.Check(10_000, 2.1)
    if is_stuck:
        with pytest.raises(
            ScenarioError, match="the last 10000 steps advanced it by 0 s"
        ):
            pace.Check(20_000, 2.1)
    else:
        for num_steps, time in ((20_000, 2.2), (30_000, 9.0), (40_000, 9.99)):
            pace.Check(num_steps, time)

"""Tests of MakeSimulator() and its Simulator."""

import gc
import runpy
import warnings
import weakref
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator, SimulatorConfig, SimulatorStatus
from pydrake.systems.framework import EventStatus
from scipy.interpolate import CubicHermiteSpline
from surfaces import Border

from teleop_drake.loops.kernel import Kernel, KernelBlock, Transition
from teleop_drake.loops.kernel.block import LongestStep
from teleop_drake.loops.run.simulator import CountsOf, MakeSimulator
from teleop_drake.model.run.simulate import MakeDiagram, simulate
from teleop_drake.model.scenario import LoadScenario

DIAGRAMS = Path(__file__).parents[3] / "diagrams"
REACHED = SimulatorStatus.ReturnReason.kReachedBoundaryTime
DRAKE = tuple(map(int, version("drake").split(".")[:2]))


def by_hand(script, maker, *arguments):
    """Returns the diagram that a function of a script in diagrams/ makes."""
    return runpy.run_path(str(DIAGRAMS / f"{script}.py"))[maker](*arguments)


def record(simulator, diagram, names):
    """Returns a list to which a monitor appends time and signals at each step."""
    robot = diagram.GetSubsystemByName("robot")
    ports = [robot.GetOutputPort(name) for name in names]
    rows = []

    def monitor(root_context):
        context = robot.GetMyContextFromRoot(root_context)
        values = [port.Eval(context) for port in ports]
        rows.append((root_context.get_time(), np.concatenate(values)))

    simulator.set_monitor(monitor)
    return rows


@pytest.mark.slow
def test_an_arm_wired_by_hand_runs_as_simulate_does():
    """With Drake's Simulator, the penetration of the bone is 1.7 % off."""
    overrides = {"robot.start": [0.985, 0.0], "duration": 0.4}
    scenario = LoadScenario("two_dof_collision", overrides)
    names = ["tool_position", "tool_velocity", "joint_torque"]
    recording = simulate(scenario, engine="drake")

    diagram = by_hand("two_dof_arm", "MakeTwoDofArm", scenario)
    simulator = MakeSimulator(diagram, scenario.simulator)
    rows = record(simulator, diagram, names)
    # A stop changes the run only within the accuracy.
    for time in (0.2, 0.4):
        assert simulator.AdvanceTo(time).return_time() == time

    times = np.array([time for time, _ in rows])
    signals = np.array([values for _, values in rows])
    expected = np.hstack([recording[name] for name in names])
    grid = np.linspace(0.0, 0.4, 4001)
    times, first = np.unique(times, return_index=True)
    ours = CubicHermiteSpline(times, *signals[first][:, [0, 2]].T)(grid).max()
    theirs = recording.Interpolate("tool_position", grid)[:, 0].max()
    assert theirs - Border(scenario, "contact") > 1e-3
    assert ours == pytest.approx(theirs, abs=1e-7)
    assert_allclose(signals[-1], expected[-1], rtol=0, atol=1e-7)


@pytest.mark.slow
def test_no_step_is_longer_than_the_shortest_delay():
    scenario = LoadScenario(
        "one_dof", {"forward_channel.delay": 0.02, "return_channel.delay": 0.013}
    )
    diagram = MakeDiagram(scenario)
    assert LongestStep(diagram, diagram.CreateDefaultContext()) == 0.013
    simulator = MakeSimulator(diagram, scenario.simulator)
    rows = record(simulator, diagram, ["tool_position"])
    simulator.AdvanceTo(0.5)
    # Drake stretches a step by up to one per cent to end it on an event.
    assert np.diff([time for time, _ in rows]).max() < 1.011 * 0.013


@pytest.mark.parametrize(
    ("channel", "longest"),
    [
        ({"kind": "transport", "delay": 0.0}, 0.1),
        ({"kind": "sampled", "delay": 0.02, "sample_period": 0.001}, 0.1),
        ({"kind": "variable", "sinusoid": {"amplitude": 0.095}}, 0.005),
    ],
)
def test_only_the_kinds_of_delay_that_need_it_limit_the_step(channel, longest):
    changes = {f"forward_channel.{key}": x for key, x in channel.items()}
    diagram = MakeDiagram(LoadScenario("one_dof", changes))
    found = LongestStep(diagram, diagram.CreateDefaultContext())
    assert found == pytest.approx(longest)


def test_a_monitor_of_the_users_own_ends_the_run():
    diagram = MakeDiagram(LoadScenario("one_dof"))
    simulator = MakeSimulator(diagram, SimulatorConfig(max_step_size=0.01))
    seen = []

    def monitor(root_context):
        seen.append(root_context.get_time())
        if seen[-1] >= 0.25:
            return EventStatus.ReachedTermination(diagram, "enough")
        return None

    simulator.set_monitor(monitor)
    assert simulator.get_monitor() is monitor
    status = simulator.AdvanceTo(1.0)
    assert status.reason() == SimulatorStatus.ReturnReason.kReachedTerminationCondition
    assert status.message() == "enough"
    assert seen[-1] == simulator.get_context().get_time() < 0.27
    simulator.clear_monitor()
    assert simulator.AdvanceTo(0.4).reason() == REACHED
    assert simulator.get_context().get_time() == 0.4


def test_a_run_can_begin_again():
    diagram = MakeDiagram(LoadScenario("one_dof", {"surgeon.stop_time": 0.1}))
    simulator = MakeSimulator(diagram, SimulatorConfig(max_step_size=0.05))
    start = simulator.get_context().Clone()
    ends = []
    for _ in range(2):
        simulator.get_mutable_context().SetTimeStateAndParametersFrom(start)
        simulator.Initialize()
        simulator.AdvanceTo(0.5)
        state = simulator.get_context().get_continuous_state_vector()
        ends.append(state.CopyToVector())
    # Not exactly equal, because Drake begins with the length of the last step.
    assert_allclose(ends[0], ends[1], rtol=0, atol=1e-8)


def test_a_step_that_is_set_later_counts():
    simulator = MakeSimulator(MakeDiagram(LoadScenario("one_dof")), SimulatorConfig())
    integrator = simulator.get_mutable_integrator()
    longest = []
    for step in (None, None, 0.03, None, 0.5):
        if step is not None:
            integrator.set_maximum_step_size(step)
        simulator.get_mutable_context().SetTime(0.0)
        simulator.Initialize()
        longest.append(simulator._stepping.longest_step)
        simulator.AdvanceTo(0.01)
    assert longest == [0.1, 0.1, 0.03, 0.03, 0.1]


@pytest.mark.skipif(
    DRAKE < (1, 56), reason="this Drake keeps every Diagram with a block in Python"
)
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("two_dof_combined", "adaptive_backstepping"),
        ("two_dof_combined", "time_domain_passivity"),
        ("two_dof_combined", "smith_predictor"),
        ("network_tracking_linear", None),
    ],
)
def test_nothing_stays_of_a_run(name, kind):
    overrides = {"duration": 0.01} | ({"controller.kind": kind} if kind else {})
    scenario = LoadScenario(name, overrides)
    diagram = MakeDiagram(scenario)
    reference = weakref.ref(diagram)
    simulate(scenario, teleoperator=diagram)
    del diagram
    gc.collect()
    assert reference() is None


def test_the_plain_simulator_warns_once_that_no_event_is_located():
    diagram = MakeDiagram(LoadScenario("one_dof"))
    simulator = Simulator(diagram)
    simulator.get_mutable_integrator().set_maximum_step_size(0.05)
    with pytest.warns(UserWarning, match="no event is located") as found:
        simulator.AdvanceTo(0.1)
    messages = [str(x.message) for x in found]
    assert any("::environment: no event" in x for x in messages)
    assert len(messages) == len(set(messages))
    assert all(".SetAccuracy(1e-4)" in x and "MakeSimulator" in x for x in messages)


def test_no_warning_where_events_are_located():
    diagram = MakeDiagram(LoadScenario("one_dof"))
    simulator = Simulator(diagram)
    simulator.get_mutable_context().SetAccuracy(1e-4)
    simulator.get_mutable_integrator().set_maximum_step_size(0.05)
    with warnings.catch_warnings(action="error"):
        simulator.AdvanceTo(0.1)


class Thermostat(KernelBlock):
    """dx/dt = mode (1 + x); the mode changes its sign where x is 1 or 0."""

    def __init__(self):
        KernelBlock.__init__(self)
        self.DeclareContinuousState(1)
        self.DeclareDiscreteState([1.0])
        self.DeclareOutputs(x=1)

    def Kernel(self):
        distance = (beyond, "mode", "state")
        step = Transition(mode=(np.negative, "mode"), guard=distance)
        return Kernel(
            outputs={"x": "state"},
            rate=(curved_rate, "mode", "state"),
            transitions={"switches": step},
        )


def curved_rate(mode, x):
    return mode * (1.0 + x)


def beyond(mode, x):
    return mode * (x - 0.5) - 0.5


def test_short_steps_lead_to_the_guards_of_any_block():
    """dx/dt = 1 + x takes log 2 from 0 to 1, and as long for the way back."""
    diagram = Thermostat()
    config = SimulatorConfig(
        integration_scheme="runge_kutta5", max_step_size=0.05, accuracy=1e-6
    )
    simulator = MakeSimulator(diagram, config)
    modes = []

    def monitor(context):
        mode = context.get_discrete_state_vector().CopyToVector().item()
        if not modes or modes[-1][1] != mode:
            modes.append((context.get_time(), mode))

    simulator.set_monitor(monitor)
    simulator.AdvanceTo(2.0)
    times = [time for time, _ in modes[1:]]
    assert times == pytest.approx([np.log(2), 2 * np.log(2)], abs=1e-6)
    # Without the short steps, Drake's bisection takes 1449 evaluations.
    assert CountsOf(simulator).evaluations < 600

"""Compiled runs agree with runs in Drake's Simulator."""

import re
import signal

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem

from teleop_drake.loops.engine import run as engine
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.kernel import Kernel
from teleop_drake.loops.run import compiled_run
from teleop_drake.model.blocks.architectures.direct_force import DirectForce
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.tasks.metrics import RunSummary
from teleop_drake.model.teleoperator import MakeTeleoperator

# The tests share the machine code on the disk.
pytestmark = pytest.mark.xdist_group("machine_code")


@pytest.mark.slow
def test_a_run_that_is_too_fast_ends_at_its_limit():
    scenario = LoadScenario(
        "one_dof",
        ["duration=9", "controller.kind=direct_force", "divergence_speed_ratio=1.2"],
    )
    drake, compiled = (simulate(scenario, engine=x) for x in ("drake", "compiled"))
    assert compiled.termination == drake.termination == "diverged"
    assert compiled.time[-1] == pytest.approx(drake.time[-1], abs=1e-4)
    assert RunSummary(compiled)["metrics"]["diverged"]


@pytest.fixture
def in_python(monkeypatch):
    """The compiled engine with an evaluator that is interpreted."""
    monkeypatch.setattr(
        compiled_run,
        "Evaluator",
        lambda diagram, context, **options: Evaluator(diagram, context),
    )


class Wall(LeafSystem):
    """An environment with a force that depends on the velocity."""

    def __init__(self, law):
        LeafSystem.__init__(self)
        self.set_name("environment")
        self._law = law
        self.DeclareVectorInputPort("tool_position", 1)
        self._v = self.DeclareVectorInputPort("tool_velocity", 1)
        self.DeclareVectorOutputPort(
            "environment_force", 1, self._CalcForce, {self._v.ticket()}
        )

    def _CalcForce(self, context, output):
        output.SetFromVector(self._law(self._v.Eval(context)))

    def Kernel(self):
        return Kernel(
            outputs={"environment_force": (self._law, "tool_velocity")},
            unused=("tool_position",),
        )


def chattering(v):
    return 1e16 * np.sign(v - 0.02)


def dividing(v):
    """Fails at a speed that the tool reaches on its way to 1 mm/s."""
    if v[0] > 0.0011:
        raise ZeroDivisionError("nobody divides")
    return 0 * v


def mistaken(v):
    if v[0] > 0.0011:
        raise KeyError("a mistake")
    return 0 * v


def run_against(law, kind):
    scenario = LoadScenario(
        "one_dof",
        ["duration=1", "controller.kind=direct_force", "divergence_speed_ratio=1000"],
    )
    teleoperator = MakeTeleoperator(scenario, environment=Wall(law))
    return simulate(scenario, teleoperator=teleoperator, engine=kind)


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    "law, reason, step",
    [
        (chattering, "Error control wants to select step smaller than minimum", 0),
        (dividing, "however short the step is: nobody divides", 1e-6),
    ],
)
def test_a_run_that_blows_up_does_so_in_both_engines(in_python, law, reason, step):
    drake, compiled = (run_against(law, kind) for kind in ("drake", "compiled"))
    for run in (drake, compiled):
        assert run.termination == "diverged"
        assert reason in run.reason
    assert compiled.time[-1] == pytest.approx(drake.time[-1], abs=step)


def test_a_mistake_comes_out_as_it_is(in_python):
    with pytest.raises(KeyError, match="a mistake"):
        run_against(mistaken, "compiled")


def test_ctrl_c_keeps_what_there_is(in_python, monkeypatch):
    monkeypatch.setattr(engine, "_ROOM", 30)
    times = []

    def interrupt(time):
        times.append(time)
        signal.raise_signal(signal.SIGINT)

    scenario = LoadScenario(
        "one_dof", ["controller.kind=direct_force", "simulator.max_step_size=1e-3"]
    )
    run = simulate(scenario, progress=interrupt, engine="compiled")
    assert (run.termination, run.reason) == ("interrupted", "interrupted by the user")
    assert len(times) == 1 and run.time[-1] == times[0] < scenario.duration
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.slow
def test_what_cannot_be_compiled_says_why():
    scenario = LoadScenario(
        "one_dof", ["duration=0.05", "simulator.integration_scheme=runge_kutta3"]
    )
    with pytest.raises(ScenarioError, match="compiled runs use runge_kutta5"):
        simulate(scenario, engine="compiled")
    recording = simulate(scenario)
    assert recording.solver.engine == "drake"
    (note,) = recording.notes
    assert note.startswith("Run in Drake's Simulator: compiled runs use runge_kutta5")
    assert RunSummary(recording)["notes"] == [note]
    assert simulate(scenario, engine="drake").notes == []


class Measured(DirectForce):
    """A law with an output that its kernel lacks."""

    def __init__(self):
        super().__init__(num_axes=1)
        time = {self.time_ticket()}
        self.DeclareVectorOutputPort("clock", 1, self._CalcClock, time)

    def _CalcClock(self, context, output):
        output.SetFromVector([context.get_time()])


class Restless(DirectForce):
    """A law with time derivatives that its kernel lacks."""

    def DoCalcTimeDerivatives(self, context, derivatives):
        pass


@pytest.mark.parametrize(
    "law, reason",
    [
        (Measured(), "its kernel has no output 'clock'"),
        (Restless(num_axes=1), "Restless has a DoCalcTimeDerivatives\\(\\) that its"),
    ],
)
def test_what_a_subclass_adds_is_not_lost(law, reason):
    scenario = LoadScenario("one_dof", {"duration": 0.05})
    teleoperator = MakeTeleoperator(scenario, control_law=law)
    recording = simulate(scenario, teleoperator=teleoperator)
    assert recording.solver.engine == "drake"
    assert re.search(reason, recording.notes[0])

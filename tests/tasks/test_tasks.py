"""Tasks: the package's, and those of a user's own."""

import json
from typing import ClassVar

import numpy as np
import pytest

from teleop_drake.architectures.direct_force import DirectForce
from teleop_drake.cli import main
from teleop_drake.environments import CONTACT
from teleop_drake.figures.runs import PlotComparison, PlotRun
from teleop_drake.recording import Event
from teleop_drake.scenario import LoadScenario, Scenario
from teleop_drake.simulation import MakeDiagram, simulate
from teleop_drake.sweep import MetricUnits
from teleop_drake.tasks import TASKS, Insertion, SpeedLimit, TaskOf, Tracking
from teleop_drake.tasks.metrics import RunMetrics, RunSummary
from teleop_drake.teleoperator import MakeTeleoperator

SHORT = "duration=0.2"


class Reach(Insertion):
    """An insertion with a law, a limit, an event, a metric and a figure of its own."""

    units: ClassVar = {**Insertion.units, "path_length": "m"}

    def MakeDiagram(self, scenario):
        return MakeTeleoperator(scenario, control_law=DirectForce(num_axes=1))

    def MakeSpeedLimit(self, scenario):
        return SpeedLimit(speed=1.0, name="1 m/s")

    def FindEvents(self, recording):
        halfway = Event(name="halfway", time=float(recording.time[-1]) / 2)
        return sorted(
            [*super().FindEvents(recording), halfway], key=lambda event: event.time
        )

    def Metrics(self, recording):
        steps = np.linalg.norm(np.diff(recording["tool_position"], axis=0), axis=1)
        return {**super().Metrics(recording), "path_length": float(steps.sum())}

    def Particulars(self, recording):
        return {**super().Particulars(recording), "stretch": "short"}

    def Panels(self, recordings):
        return super().Panels(recordings)[:1]


class Slow(Insertion):
    """An insertion that nothing is fast enough for."""

    def MakeSpeedLimit(self, scenario):
        return SpeedLimit(speed=1e-6, name="a snail")


def test_each_scenario_has_its_task():
    class MyScenario(Scenario):
        pass

    assert isinstance(TaskOf(LoadScenario("one_dof")), Insertion)
    assert isinstance(TaskOf(LoadScenario("network_tracking_linear")), Tracking)
    assert isinstance(TaskOf(MyScenario()), Insertion)
    with pytest.raises(TypeError, match=r"^scenario = str: must be a scenario$"):
        TaskOf("one_dof")


@pytest.mark.parametrize("name", ["one_dof", "network_tracking_linear"])
def test_a_task_makes_the_systems_that_it_needs(name):
    scenario = LoadScenario(name)
    diagram = MakeDiagram(scenario)
    for system in TaskOf(scenario).systems:
        assert diagram.HasSubsystemNamed(system)


def test_a_task_of_ones_own():
    scenario = LoadScenario("one_dof", [SHORT])
    task = Reach()
    recording = simulate(scenario, task=task)
    assert "psi" not in recording.signals  # The scenario's law would have it.
    assert recording.EventTimes("halfway") == [0.1]
    assert recording.FindSurface(CONTACT) is not None
    x = recording["tool_position"][:, 0]
    summary = RunSummary(recording, task=task)
    assert summary["metrics"] == RunMetrics(recording, task=task)
    assert summary["metrics"]["path_length"] == pytest.approx(np.abs(np.diff(x)).sum())
    assert summary["stretch"] == "short"
    others = {**summary["metrics"]}
    del others["path_length"]
    assert others == RunMetrics(recording)
    for figure in (
        PlotRun(recording, task=task),
        PlotComparison({"a": recording}, task=task),
    ):
        assert len(figure.axes) == 2


@pytest.mark.parametrize("engine", ["drake", "compiled"])
def test_a_task_limits_the_speed(engine):
    if engine == "compiled":
        pytest.importorskip("llvmlite")
    recording = simulate(LoadScenario("one_dof", [SHORT]), task=Slow(), engine=engine)
    assert recording.termination == "diverged"
    assert recording.reason.endswith("m/s, exceeds a snail")


def test_a_task_of_ones_own_for_a_class_of_scenarios(monkeypatch, capsys):
    """Entered in the table it is the task wherever a scenario is run."""
    monkeypatch.setitem(TASKS, Scenario, Reach())
    assert MetricUnits(LoadScenario("one_dof"))["path_length"] == "m"
    arguments = ["run", "one_dof", "--quiet", "--set", SHORT]
    assert main([*arguments, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["metrics"]["path_length"] > 0
    assert main(arguments) == 0
    rows = capsys.readouterr().out.splitlines()
    (row,) = (row for row in rows if row.startswith("path length"))
    assert row.endswith(" m")


def test_runs_of_a_tracking_are_not_compared():
    recording = simulate(LoadScenario("network_tracking_linear", [SHORT]))
    with pytest.raises(ValueError, match=r"^recordings\.scenario = 'network_tracking"):
        PlotComparison({"a": recording})

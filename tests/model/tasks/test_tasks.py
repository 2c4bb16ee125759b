"""Tests of the package's tasks and of a user's own tasks."""

import csv
import json

import numpy as np
import pytest
from own_kinds import Reach

from teleop_drake.cli import main
from teleop_drake.model.blocks.environments import CONTACT
from teleop_drake.model.run.simulate import MakeDiagram, simulate
from teleop_drake.model.scenario import LoadScenario, Scenario, ScenarioNames
from teleop_drake.model.tasks import (
    ComparedControllers,
    Insertion,
    SpeedLimit,
    TaskOf,
    Tracking,
)
from teleop_drake.model.tasks.metrics import RunMetrics, RunSummary
from teleop_drake.study.figures.runs import PlotComparison, PlotRun
from teleop_drake.study.sweep import MetricUnits

SHORT = "duration=0.2"


class Slow(Insertion):
    """An insertion with a very low speed limit."""

    def MakeSpeedLimit(self, scenario):
        return SpeedLimit(speed=1e-6, name="a snail")


def test_each_scenario_has_its_task():
    class MyScenario(Scenario):
        pass

    assert isinstance(TaskOf(LoadScenario("one_dof")), Insertion)
    assert isinstance(TaskOf(LoadScenario("network_tracking_linear")), Tracking)
    assert isinstance(TaskOf(MyScenario()), Insertion)
    with pytest.raises(TypeError, match=r"^scenario = a str: must be a scenario$"):
        TaskOf("one_dof")


@pytest.mark.parametrize("name", ["one_dof", "network_tracking_linear"])
def test_a_task_makes_the_systems_that_it_needs(name):
    scenario = LoadScenario(name)
    diagram = MakeDiagram(scenario)
    for system in TaskOf(scenario).systems:
        assert diagram.HasSubsystemNamed(system)


def test_no_switch_is_found_in_a_step_that_was_cut():
    """The modes in such a step are interpolated, with rounding errors."""
    wave = {"kind": "variable", "drift": 0.01}
    wave["sinusoid"] = {"amplitude": 0.02, "frequency": 3.0, "phase": 0.4}
    changes = {"controller.kind": "direct_force"}
    changes |= dict.fromkeys(("forward_channel", "return_channel"), wave)
    recording = simulate(LoadScenario("one_dof", changes))
    assert recording.termination == "diverged"
    assert len(recording.EventTimes("surgeon_force")) == 1
    assert recording.EventTimes("surgeon_stop") == []


def test_a_task_of_ones_own():
    scenario = LoadScenario("one_dof", [SHORT])
    task = Reach()
    recording = simulate(scenario, task=task)
    assert "psi" not in recording.signals  # It is a signal of the scenario's law.
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
    recording = simulate(LoadScenario("one_dof", [SHORT]), task=Slow(), engine=engine)
    assert recording.termination == "diverged"
    assert recording.reason.endswith("m/s, exceeds a snail")


@pytest.mark.slow
def test_a_scenario_names_a_task_of_ones_own(capsys, tmp_path):
    """The task's metrics are those of runs and sweeps."""
    options = ["one_dof", "--set", SHORT, "--set", "task=own_kinds:Reach", "--quiet"]
    assert main(["run", *options, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["metrics"]["path_length"] > 0
    assert main(["sweep", *options, "--delay", "0.1", "--out", str(tmp_path)]) == 0
    header, *rows = csv.DictReader((tmp_path / "runs.csv").read_text().splitlines())
    assert float(header["path_length"]) > 0 and len(rows) == 1
    assert MetricUnits(LoadScenario("one_dof", options[4:5]))["path_length"] == "m"
    capsys.readouterr()
    assert main(["run", *options]) == 0
    rows = capsys.readouterr().out.splitlines()
    (row,) = (row for row in rows if row.startswith("path length"))
    assert row.endswith(" m")
    for task, allowed in (
        ("own_kinds:Puck", "a class that derives from teleop_drake.model.tasks.Task"),
        ("own_kinds:Nothing", "importable (AttributeError"),
    ):
        assert main(["run", "one_dof", "--set", f"task={task}"]) == 2
        assert f"task = '{task}': must be {allowed}" in capsys.readouterr().err


def test_runs_of_a_tracking_are_not_compared():
    recording = simulate(LoadScenario("network_tracking_linear", [SHORT]))
    with pytest.raises(ValueError, match=r"^recordings\.scenario = 'network_tracking"):
        PlotComparison({"a": recording})


@pytest.mark.parametrize("name", ScenarioNames())
def test_the_controllers_of_a_comparison_can_be_had(name):
    """A leader and a follower have no gains for the thesis's controllers."""
    scenario = LoadScenario(name)
    kinds = ComparedControllers(scenario)
    for kind in kinds:
        LoadScenario(name, {"controller.kind": kind})
    if name == "leader_follower":
        assert kinds == ["proportional_damping"]
    else:
        assert kinds == list(TaskOf(scenario).controllers)

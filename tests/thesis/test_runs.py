import dataclasses

import pytest

import teleop_drake.thesis.runs
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import ScenarioError
from teleop_drake.thesis.runs import ThesisRuns

SHORT = {"duration": 0.3}


def test_each_run_is_simulated_once():
    lines = []
    runs = ThesisRuns(lines.append)
    first = runs("one_dof", SHORT)
    assert runs("one_dof", {"duration": 0.1}, SHORT) is first
    assert runs("one_dof", SHORT, {"robot.mass": 1.0}) is not first
    assert first.recording.time[-1] == pytest.approx(0.3)
    (one, other) = lines
    command = "teleop-drake run one_dof --set duration=0.3"
    assert one.startswith(f"{command}: completed, ")
    assert list(runs.used) == [command, f"{command} --set robot.mass=1.0"]
    assert other.startswith(f"{command} --set robot.mass=1.0: ")


def test_bad_scenario():
    runs = ThesisRuns()
    with pytest.raises(ScenarioError, match="duration = -1"):
        runs("one_dof", {"duration": -1})
    with pytest.raises(ScenarioError, match="no_such_task"):
        runs("no_such_task")


def test_an_interrupted_run_is_not_a_result(monkeypatch):
    def Interrupted(scenario):
        return dataclasses.replace(simulate(scenario), termination="interrupted")

    monkeypatch.setattr(teleop_drake.thesis.runs, "simulate", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        ThesisRuns()("one_dof", SHORT)

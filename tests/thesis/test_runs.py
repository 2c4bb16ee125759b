import dataclasses

import numpy as np
import pytest

import teleop_drake.thesis.runs
from teleop_drake.scenario import LoadScenario, ScenarioError, ScenarioToYaml
from teleop_drake.simulation import simulate
from teleop_drake.thesis.runs import ThesisRuns

SHORT = {"duration": 0.3}

# The worker processes are forks of one server.
pytestmark = pytest.mark.xdist_group("sweep")


def test_each_run_is_simulated_once():
    lines = []
    with ThesisRuns(jobs=2, progress=lines.append) as runs:
        runs.Prefetch([("one_dof", SHORT), ("two_dof_puncture", SHORT)])
        first = runs("one_dof", **SHORT)
        # Equal to the scenario's own value, so the same run.
        assert runs("one_dof", **SHORT, **{"controller.G2": 20.0}) is first
        runs.Prefetch([("one_dof", SHORT)])
        runs("two_dof_puncture", **SHORT)
        assert runs.num_simulated == 2
    assert sorted(line.split(":")[0] for line in lines) == [
        "one_dof, duration=0.3",
        "two_dof_puncture, duration=0.3",
    ]


def test_a_run_is_the_same_in_any_process():
    scenario = LoadScenario("two_dof_combined", SHORT)
    expected = simulate(scenario)
    for jobs in (1, 2):
        with ThesisRuns(jobs=jobs) as runs:
            recording = runs("two_dof_combined", **SHORT)
        assert ScenarioToYaml(recording.scenario) == ScenarioToYaml(scenario)
        assert recording.events == expected.events
        np.testing.assert_array_equal(recording.time, expected.time)
        for name, samples in expected.signals.items():
            np.testing.assert_array_equal(recording[name], samples)


def test_one_job_simulates_on_demand():
    lines = []
    runs = ThesisRuns(jobs=1, progress=lines.append)
    runs.Prefetch([("one_dof", SHORT)])
    assert lines == []
    runs("one_dof", **SHORT)
    runs("one_dof", **SHORT)
    assert len(lines) == 1


def test_bad_scenario():
    runs = ThesisRuns(jobs=1)
    with pytest.raises(ScenarioError, match="duration = -1"):
        runs.Prefetch([("one_dof", {"duration": -1})])
    with pytest.raises(ScenarioError, match="no_such_task"):
        runs("no_such_task")


def test_a_run_that_fails_in_a_worker(tmp_path):
    path = tmp_path / "task.yaml"
    path.write_text(ScenarioToYaml(LoadScenario("one_dof", SHORT)))
    with ThesisRuns(jobs=2) as runs:
        runs.Prefetch([(str(path), {})])
        # The workers are not up yet.
        path.unlink()
        with pytest.raises(RuntimeError, match=r"the run .*task.yaml failed: .*task"):
            runs(str(path))


@pytest.mark.parametrize("jobs", [0, -1])
def test_bad_jobs(jobs):
    with pytest.raises(ValueError, match=f"jobs = {jobs}: must be"):
        ThesisRuns(jobs=jobs)


def test_an_interrupted_run_is_not_a_result(monkeypatch):
    def Interrupted(scenario, engine):
        return dataclasses.replace(simulate(scenario), termination="interrupted")

    monkeypatch.setattr(teleop_drake.thesis.runs, "simulate", Interrupted)
    runs = ThesisRuns(jobs=1)
    with pytest.raises(KeyboardInterrupt):
        runs("one_dof", **SHORT)
    assert runs.num_simulated == 0

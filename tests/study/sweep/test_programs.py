"""Runs of a sweep that share a program have the results of simulate()."""

import pytest

from teleop_drake.model.run.compiled_scenario import CompiledScenario
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import RunSummary
from teleop_drake.study.sweep import PlanSweep

SHORT = {"duration": 0.5, "controller.kind": "damped_force"}
# A delay of 0 needs another program.
POINTS = [{"delay": 0.1}, {"delay": 0.02}, {"delay": 0.0}, {"delay": 0.05}]


def Summary(recording):
    summary = RunSummary(recording)
    del summary["solver"]["wall_time_s"], summary["solver"]["real_time_factor"]
    return summary


def Plan(points=POINTS, **overrides):
    grid = {"delay": [point["delay"] for point in points]}
    return PlanSweep("one_dof", grid, overrides=SHORT | overrides)


@pytest.mark.slow
def test_runs_are_those_of_simulate():
    programs = {}
    for point in POINTS:
        recording = Plan().Simulate(point, programs)
        scenario = LoadScenario("one_dof", {**SHORT, **point})
        assert Summary(recording) == Summary(simulate(scenario))


def test_runs_of_one_structure_share_a_program(monkeypatch):
    changes = []
    run = CompiledScenario.Run

    def Run(program, **values):
        changes.append(values)
        return run(program, **values)

    monkeypatch.setattr(CompiledScenario, "Run", Run)
    programs = {}
    for point in POINTS[:2]:
        Plan().Simulate(point, programs)
    assert changes == [{}, {"delay": 0.02}]


def test_what_cannot_be_compiled_runs_in_drake():
    changes = {"simulator.integration_scheme": "runge_kutta3", "duration": 0.05}
    recording = Plan(**changes).Simulate({"delay": 0.1}, {})
    assert recording.solver.engine == "drake"
    assert any("runge_kutta3" in note for note in recording.notes)


def test_what_is_not_valid_is_refused_by_its_own_message():
    programs = {}
    Plan().Simulate({"delay": 0.1}, programs)
    with pytest.raises(ValueError, match=r"forward_channel\.delay = -1"):
        Plan().Simulate({"delay": -1.0}, programs)

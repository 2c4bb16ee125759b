"""Long work shows its progress on stderr; a file gets a line every 10 s."""

import re

import pytest

import teleop_drake.model.run.simulate
from teleop_drake.cli.progress import Simulate, SweepProgress
from teleop_drake.model.scenario import LoadScenario


@pytest.fixture
def clock(monkeypatch):
    """The time in s that tqdm sees: its only element."""
    now = [100.0]
    monkeypatch.setattr("tqdm.std.time", lambda: now[0])
    return now


@pytest.mark.parametrize("is_quiet", [False, True])
def test_runs_and_sweeps(is_quiet, clock, monkeypatch, capsys):
    class Done(Exception):
        pass

    def SlowSimulate(scenario, *, progress, engine):
        for simulated, real in [(1.0, 101), (5.0, 111), (6.0, 113), (10.0, 122)]:
            clock[0] = real
            progress(simulated)
        raise Done

    monkeypatch.setattr(teleop_drake.model.run.simulate, "simulate", SlowSimulate)
    with pytest.raises(Exception, match="Done"):
        Simulate(LoadScenario("one_dof"), is_quiet, "auto")
    with SweepProgress(is_quiet) as show:
        for finished in (4, 5, 6, 7, 8):  # Four are those of an interrupted sweep.
            clock[0] += 6
            show(finished, 10)
    assert re.findall(r"\S.*", capsys.readouterr().err) == (
        []
        if is_quiet
        else [
            "one_dof, adaptive_backstepping: 5 of 25 s, 00:44 left",
            "one_dof, adaptive_backstepping: 10 of 25 s, 00:33 left",
            "6 of 10 runs, 00:24 left",
            "8 of 10 runs, 00:12 left",
        ]
    )

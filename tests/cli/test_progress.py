"""What long work shows on stderr."""

import time

from teleop_drake.cli import progress
from teleop_drake.scenario import LoadScenario


def test_a_run_says_what_takes_long(monkeypatch, capsys):
    monkeypatch.setattr(progress, "_PATIENCE", 0.05)
    scenario = LoadScenario("one_dof")
    with progress._Progress(scenario) as show:
        show.Say("compiling ...")
        time.sleep(0.3)
        show(1.5)
        show.Say("compiling ...")  # This time it is there at once.
        show(1.6)
        time.sleep(0.2)
    assert capsys.readouterr().err.splitlines() == [
        "one_dof, adaptive_backstepping: compiling ...",
        "one_dof, adaptive_backstepping: 1.5 of 25 s",
    ]

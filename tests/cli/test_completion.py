"""Tests of teleop_drake.cli.commands.completion."""

import shutil
import subprocess
import sys

import pytest

from teleop_drake.cli import main
from teleop_drake.cli.commands.completion import Complete
from teleop_drake.scenario import ARCHITECTURES, ScenarioNames


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["co"], ["compare", "completion"]),
        (["--v"], ["--version"]),
        (["run", "two_dof_co"], ["two_dof_collision", "two_dof_combined"]),
        (["run", "one_dof", "--eng"], ["--engine"]),
        (["run", "one_dof", "--engine", "c"], ["compiled"]),
        (["run", "one_dof", "--controller", "direct"], ["direct_force"]),
        (["run", "one_dof", "--out", ""], []),
        (["run", "one_dof", ""], []),
        (["completion", "z"], ["zsh"]),
        (["sow", ""], []),
    ],
)
def test_words(words, expected):
    assert Complete(words) == expected


def test_every_scenario_and_controller_is_offered():
    assert Complete(["show", ""]) == ScenarioNames()
    offered = Complete(["compare", "one_dof", "--controllers", ""])
    assert offered == sorted([*ARCHITECTURES, "all"])


def test_words_come_without_drake():
    code = (
        "import sys; from teleop_drake.cli import main; "
        "main(['completion', 'words', 'run', 'one']); "
        "print('pydrake' in sys.modules)"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert run.stdout == "one_dof\nFalse\n"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_is_one_of_its_shell(shell, capsys):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert "teleop-drake completion words" in script
    if shutil.which(shell):
        subprocess.run([shell, "-n", "-c", script], check=True)

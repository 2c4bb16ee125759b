"""Tests of teleop_drake.cli.commands.completion."""

import os
import shutil
import subprocess
import sys

import pytest

from teleop_drake.cli import main
from teleop_drake.model.scenario import ARCHITECTURES, ScenarioNames


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("show ", ScenarioNames()),
        ("sweep one_dof --controllers ", [*ARCHITECTURES, "all"]),
    ],
)
def test_what_a_shell_is_told(words, expected, tmp_path):
    code = (
        "import atexit, sys; from teleop_drake.cli import main\n"
        "atexit.register(lambda: print('pydrake' in sys.modules)); main()"
    )
    line = f"teleop-drake {words}"
    asked = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "words"),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | asked,
        check=True,
        capture_output=True,
        text=True,
    )
    assert sorted((tmp_path / "words").read_text().split()) == sorted(expected)
    assert done.stdout == "False\n"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_is_one_of_its_shell(shell, capsys):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert "teleop-drake" in script
    if shutil.which(shell):
        subprocess.run([shell, "-n", "-c", script], check=True)

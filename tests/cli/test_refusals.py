"""Each refusal of the command line is one line that says what is allowed.

    python tests/cli/test_refusals.py

writes refusals.txt, the table of them, for a person to read.
"""

import contextlib
import io
import os
import re
import shlex
import tempfile
from pathlib import Path

import pytest

from teleop_drake.cli import main

TABLE = Path(__file__).with_name("refusals.txt")

FILES = {
    "empty.csv": "",
    "words.csv": "these are words\n",
    "words.npz": "these are words\n",
    "words.key": "these are words\n",
    "broken.yaml": "a: [1",
    "twice.yaml": "name: a\nname: b\n",
}
"""What the commands find in their folder."""

LONGEST = 700
"""Letters of a refusal. The longest ones list what there is."""

# A refusal says what is allowed, or what to do.
MENDS = re.compile(
    r"must (be|begin|end|have|name)|did you mean|--help|no model of|must not|unknown"
)


def Commands():
    """The commands of the table."""
    lines = TABLE.read_text("utf-8").splitlines()
    return [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]


def Refusals():
    """The refusals of the table by their commands."""
    lines = TABLE.read_text("utf-8").splitlines()
    return dict(zip(Commands(), (x for x in lines if x[:1] not in "$"), strict=True))


def Refusal(command):
    """What a command prints on stderr in a folder that has FILES, and its code."""
    for name, text in FILES.items():
        Path(name).write_text(text)
    os.chmod("words.key", 0o600)
    out = io.StringIO()
    err = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(shlex.split(command))
    assert out.getvalue() == ""
    return code, err.getvalue()


@pytest.mark.mostly_slow
@pytest.mark.usefixtures("in_an_empty_folder")
@pytest.mark.parametrize("command", Commands())
def test_a_refusal_is_that_of_the_table(command):
    code, text = Refusal(command)
    assert code == 2
    (line,) = text.splitlines()
    assert line.isprintable()
    line = line.removeprefix("teleop-drake: error: ")
    assert line == Refusals()[command]
    assert MENDS.search(line)


def test_a_line_of_the_table_is_no_riddle():
    """No name of an error of Python's, no number of one, not too long."""
    for command, line in Refusals().items():
        assert not re.search(r"Errno|Traceback|<class|object at|\w+Error\b", line) or (
            "importable" in line
        ), command
        names = "one of" in line
        assert len(line) <= (10 * LONGEST if names else LONGEST), command


if __name__ == "__main__":
    commands = Commands()
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        rows = []
        for command in commands:
            _, text = Refusal(command)
            rows.append(f"$ {command}\n{text.removeprefix('teleop-drake: error: ')}")
    TABLE.write_text("".join(rows), "utf-8")

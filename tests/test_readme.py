"""The README: its commands run as they are printed, and its numbers come out."""

import re
import shlex
import webbrowser
from pathlib import Path

import pytest
from documentation import README

from teleop_drake.cli import main

TEXT = README.read_text(encoding="utf-8")
COMMANDS = list(dict.fromkeys(re.findall(r"`(teleop-drake [a-z][^`]*)`", TEXT)))
ROWS = re.findall(r"^\| ([^|]+) \| ([^|]+) \| (`[^|]+`) \|$", TEXT, re.MULTILINE)

SCALES = {"mm/s": 1e-3, "s": 1.0, "N": 1.0}

# Others take a minute, or are there in words only.
SLOW = ["teleop-drake reproduce --check"]
# thesis/test_live.py makes the whole report by this command.
ELSEWHERE = ["teleop-drake reproduce"]
QUICK = [x for x in COMMANDS if x not in SLOW + ELSEWHERE and "COMMAND" not in x]

pytestmark = pytest.mark.usefixtures("in_an_empty_folder")


@pytest.fixture(autouse=True)
def opened(monkeypatch):
    """The pages that a browser is asked to open."""
    urls = []
    monkeypatch.setattr(webbrowser, "open", lambda url: urls.append(url) or True)
    return urls


def Printed(command, capsys):
    """What a command prints; it has to succeed."""
    capsys.readouterr()
    assert main(shlex.split(command)[1:]) == 0, command
    return capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("command", [*QUICK, *SLOW])
def test_a_command_runs_as_it_is_printed(command, capsys):
    """It prints something, or writes the file that it names."""
    printed = Printed(command, capsys)
    words = shlex.split(command)
    if "-o" in words:
        assert Path(words[words.index("-o") + 1]).stat().st_size > 0
    else:
        assert printed


def test_all_commands_are_looked_at():
    assert len(COMMANDS) > 10
    assert {*SLOW, *ELSEWHERE} <= set(COMMANDS)
    parts = [cell for row in ROWS for cell in re.findall("`([^`]+)`", row[2])]
    assert len(ROWS) == 5 and set(parts) <= set(COMMANDS)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("claim", "numbers", "commands"), ROWS, ids=[row[0][:30] for row in ROWS]
)
def test_a_number_of_the_results_is_printed(claim, numbers, commands, capsys):
    """To as many digits as the README has, in SI units as the commands print it."""
    outputs = [Printed(x, capsys) for x in re.findall("`([^`]+)`", commands)]
    words = re.split(r"[\s,;:]+", " ".join(outputs))
    found = [float(x) for x in words if re.fullmatch(r"-?\d+\.?\d*(e-?\d+)?", x)]
    expected = re.findall(r"([\d.]+) (mm/s|s|N)\b", numbers)
    assert expected
    for number, unit in expected:
        half = 0.5001 * 10.0 ** -len(number.partition(".")[2]) * SCALES[unit]
        value = float(number) * SCALES[unit]
        assert any(abs(x - value) <= half for x in found), (number, unit)
    if "never" in numbers:
        rests = [x for x in "\n".join(outputs).splitlines() if "rest time" in x]
        assert len(rests) == 2 and all(x.split()[3] == "never" for x in rests)


def test_the_moving_picture_can_be_read_at_the_width_of_the_page():
    from PIL import Image

    name = re.search(r"\]\((diagrams/[^)]+\.gif)\)", TEXT)[1]
    with Image.open(README.parent / name) as picture:
        assert picture.width == 830
        assert picture.n_frames >= 40
    assert (README.parent / name).stat().st_size < 400_000
    assert (README.parent / "diagrams/scene/make_motion.py").is_file()
    assert TEXT.index(name) < 400


def test_words_that_only_insiders_know_do_not_occur(subtests):
    for word in ("league", "held-out", "living diagram", "case III", "case II"):
        with subtests.test(word=word):
            assert word not in TEXT

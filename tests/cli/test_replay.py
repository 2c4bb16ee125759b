"""The command `teleop-drake replay`, and --html of the others."""

import json
import re
import webbrowser
from pathlib import Path

import numpy as np
import pytest
from scene_recordings import MakeRecording

import teleop_drake.study.figures.runs
from teleop_drake.cli import main
from teleop_drake.cli.commands import compare, replay, run

pytestmark = pytest.mark.usefixtures("in_an_empty_folder")


@pytest.fixture
def recording(tmp_path):
    MakeRecording().Save(tmp_path / "a.npz")
    return "a.npz"


def Refused(capsys, *arguments):
    """Returns the one line with which a command is refused."""
    assert main([*arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1
    return captured.err


def Runs(path):
    text = Path(path).read_text(encoding="utf-8")
    return re.findall(r'<b style="color: [^"]*">(.*?)</b>', text)


def test_controllers_stand_in_one_scene():
    short = ["--duration", "0.05", "--quiet", "--out", "a.html"]
    kinds = "direct_force,proportional_damping"
    assert main(["replay", "one_dof", *short, "--controllers", kinds]) == 0
    assert Runs("a.html") == ["direct force", "proportional damping"]


@pytest.mark.slow
def test_recordings_stand_in_one_scene(recording, capsys):
    MakeRecording(kind="adaptive_backstepping").Save("b.npz")
    assert main(["replay", recording, "b.npz", "--out", "c.html"]) == 0
    assert capsys.readouterr().out == "Written: c.html\n"
    assert Runs("c.html") == ["direct force", "adaptive backstepping"]
    # Where the controllers are the same, the files are the names.
    MakeRecording().Save("d.npz")
    assert main(["replay", recording, "d.npz", "--out", "c.html"]) == 0
    assert Runs("c.html") == ["a", "d"]


@pytest.mark.slow
def test_run_and_compare_write_a_page(monkeypatch, capsys):
    for command in (run, compare):
        monkeypatch.setattr(
            command, "Simulate", lambda x, *_: MakeRecording(kind=x.controller.kind)
        )
    for name in ("PlotComparison", "SaveFigure"):  # Tested elsewhere, and slow.
        monkeypatch.setattr(
            teleop_drake.study.figures.runs, name, lambda *_, **options: None
        )
    short = ["one_dof", "--html", "scene.html"]
    assert main(["run", *short]) == 0
    assert "Written: scene.html" in capsys.readouterr().out
    assert Runs("scene.html") == ["adaptive backstepping"]
    assert main(["compare", *short, "--out", "out"]) == 0
    assert Runs("scene.html") == ["direct force", "adaptive backstepping"]


def test_a_page_without_a_name_is_opened(recording, monkeypatch, capsys):
    opened = []
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(url) or True)
    assert main(["replay", recording]) == 0
    path = opened.pop().removeprefix("file://")
    assert Runs(path) == ["direct force"]
    assert capsys.readouterr().out == f"Opened: {path}\n"


@pytest.mark.parametrize("out", [[], ["--out", "a.html"]])
def test_an_interrupted_run_is_written_and_not_opened(out, monkeypatch):
    recording = MakeRecording()
    recording.termination = "interrupted"
    monkeypatch.setattr(replay, "Simulate", lambda *_: recording)
    kinds = "direct_force,damped_force"
    assert main(["replay", "one_dof", "--controllers", kinds, *out]) == 130
    assert not out or Runs("a.html") == ["direct force"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["one_dof", "--controllers", "all"], "replay of 9 runs: must be of 4 at most"),
        (["a.npz", "--out", "a.gif"], "--out = 'a.gif': must end in .html or .htm"),
        (["a.npz", "--out", "no/a.html"], "--out = 'no/a.html': must be where"),
        (["a.npz", "--delay", "1"], "--delay = '1': must be left out with a recording"),
        (["a.npz", "a.npz"], "FILE.npz = 'a.npz': must be different files"),
        (["b.npz"], "FILE.npz = 'b.npz': must be a file that can be read (No such"),
        (["one_dof", "a.npz"], "FILE.npz = 'a.npz': must be left out after a scenario"),
        (["one_dof", "--controllers", "a,a"], "--controllers = 'a,a': must be diff"),
    ],
)
def test_bad_input(arguments, message, recording, capsys):
    assert message in Refused(capsys, "replay", *arguments)


def test_half_a_recording_is_none(recording, capsys):
    whole = Path(recording).read_bytes()
    Path(recording).write_bytes(whole[: len(whole) // 2])
    message = Refused(capsys, "replay", recording, "--out", "a.html")
    assert "FILE.npz = a.npz: must be a recording of teleop-drake" in message


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 2}, "it has format 2"),
        ({"events": [{"name": "contact", "when": 1}]}, "unexpected keyword"),
        ({"solver": {}}, "SolverStatistics"),
        ({"scenario": "robot: {model: hexapod}"}, "robot"),
    ],
)
def test_recordings_of_another_version(change, message, recording, capsys):
    with np.load(recording) as data:
        arrays = dict(data)
    written = json.loads(str(arrays["description"]))
    arrays["description"] = np.array(json.dumps(written | change))
    np.savez(recording, **arrays)
    line = Refused(capsys, "replay", recording, "--out", "a.html")
    assert "must be a recording of format 3, as this version" in line
    assert message in line

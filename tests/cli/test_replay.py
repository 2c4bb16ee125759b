"""The command `teleop-drake replay`, and --html of the others."""

import json
import webbrowser
from pathlib import Path

import numpy as np
import pytest
from scene_recordings import MakeRecording

import teleop_drake.figures.runs
from teleop_drake.cli import main
from teleop_drake.cli.commands import compare, replay, run

pytestmark = pytest.mark.usefixtures("in_an_empty_folder")

SHORT = ["--duration", "0.05", "--accuracy", "1e-4", "--quiet"]


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
    data = text.split("<script>const replay = ")[1].split(";</script>")[0]
    return [run["name"] for run in json.loads(data)["runs"]]


def test_controllers_stand_in_one_scene(tmp_path):
    kinds = "direct_force,proportional_damping"
    assert (
        main(["replay", "one_dof", *SHORT, "--controllers", kinds, "--out", "a.html"])
        == 0
    )
    assert Runs("a.html") == ["direct force", "proportional damping"]


def test_recordings_stand_in_one_scene(recording, tmp_path, capsys):
    MakeRecording(kind="adaptive_backstepping").Save(tmp_path / "b.npz")
    assert main(["replay", recording, "b.npz", "--out", "c.html"]) == 0
    assert capsys.readouterr().out == "Written: c.html\n"
    assert Runs("c.html") == ["direct force", "adaptive backstepping"]
    # Where the controllers are the same, the files are the names.
    MakeRecording(duration=1.0).Save(tmp_path / "d.npz")
    assert main(["replay", recording, "d.npz", "--out", "c.html"]) == 0
    assert Runs("c.html") == ["a", "d"]


def test_run_and_compare_write_a_page(monkeypatch, capsys):
    for command in (run, compare):
        monkeypatch.setattr(
            command,
            "Simulate",
            lambda scenario, *_: MakeRecording(kind=scenario.controller.kind),
        )
    for name in ("PlotComparison", "SaveFigure"):  # Tested elsewhere, and slow.
        monkeypatch.setattr(teleop_drake.figures.runs, name, lambda *_, **options: None)
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
    (url,) = opened
    path = url.removeprefix("file://")
    assert Runs(path) == ["direct force"]
    assert capsys.readouterr().out == f"Opened: {path}\n"


@pytest.mark.parametrize("out", [[], ["--out", "a.html"]])
def test_an_interrupted_run_is_written_and_not_opened(out, monkeypatch):
    def Interrupted(scenario, *_):
        recording = MakeRecording(kind=scenario.controller.kind)
        recording.termination = "interrupted"
        return recording

    monkeypatch.setattr(replay, "Simulate", Interrupted)
    assert main(["replay", "one_dof", "--controllers", "all", *out]) == 130
    assert not out or Runs("a.html") == ["direct force"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.npz", "--out", "a.gif"], "--out = 'a.gif': must end in .html"),
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


def test_recordings_that_cannot_be_read(recording, tmp_path, capsys):
    def Write(name, content):
        (tmp_path / name).write_bytes(content)
        return name

    whole = (tmp_path / recording).read_bytes()
    for content in (b"", b"no recording", whole[: len(whole) // 2]):
        file = Write("bad.npz", content)
        message = Refused(capsys, "replay", file, "--out", "a.html")
        assert "FILE.npz = bad.npz: must be a recording of teleop-drake" in message
    np.savez(tmp_path / "other.npz", x=1)
    message = Refused(capsys, "replay", "other.npz", "--out", "a.html")
    assert "must be a recording of teleop-drake" in message


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 2}, "it has format 2"),
        ({"events": [{"name": "contact", "when": 1}]}, "unexpected keyword"),
        ({"solver": None}, "it has no 'solver'"),
        ({"scenario": "robot: {model: hexapod}"}, "robot"),
    ],
)
def test_recordings_of_another_version(change, message, recording, capsys):
    with np.load(recording) as data:
        arrays = dict(data)
    description = json.loads(str(arrays["description"])) | change
    description = {k: v for k, v in description.items() if v is not None}
    arrays["description"] = np.array(json.dumps(description))
    np.savez(recording, **arrays)
    line = Refused(capsys, "replay", recording, "--out", "a.html")
    assert "must be a recording of format 3, as this version" in line
    assert message in line

"""Tests of studies: sweeps of several scenarios, described by a file."""

import json
import re
from pathlib import Path

import pytest

from teleop_drake.cli import main
from teleop_drake.model.scenario import LoadScenario, ScenarioToYaml
from teleop_drake.study.sweep import Execution, RunSweeps, study

pytestmark = pytest.mark.usefixtures("in_this_process", "in_an_empty_folder")

STUDY = """
scenarios: [one_dof, mine.yaml]
controllers: [direct_force]
grid:
  delay: 0:0.04:3
overrides: {duration: 0.02}
engine: drake
"""


def Write(text=STUDY, name="study.yaml"):
    Path(name).write_text(text, encoding="utf-8")
    return name


def Mine(capsys):
    assert main(["show", "one_dof", "--set", "robot.mass=2"]) == 0
    Write(capsys.readouterr().out, "mine.yaml")


@pytest.mark.slow
def test_a_study_has_a_folder_for_each_scenario(capsys, unrendered):
    """A study that was interrupted and resumed has the same bytes."""
    Mine(capsys)
    file = Write(STUDY + "metrics: [velocity_rms_error]\n")
    command = ["sweep", file, "--jobs", "1", "--quiet", "--json", "records.json"]
    assert main(command) == 0
    assert "one_dof: 3 runs, 3 completed" in capsys.readouterr().out
    records = json.loads(Path("records.json").read_text())
    assert {name: len(runs) for name, runs in records.items()} == {
        "one_dof": 3,
        "mine": 3,
    }
    for name in ("one_dof", "mine"):
        files = {path.name for path in Path("out", name).iterdir()}
        assert files == {"sweep.json", "runs.jsonl", "runs.csv", "metrics.png"}
    told = json.loads(Path("out/one_dof/sweep.json").read_text())
    assert told["engine"] == "drake" and set(told) >= {"versions", "axes"}
    assert set(told["versions"]) == {"teleop-drake", "drake", "numpy", "llvmlite"}

    journal = Path("out/mine/runs.jsonl")
    whole = journal.read_bytes()
    journal.write_bytes(whole[: whole.index(b"\n") + 1])
    assert main([*command, "--resume"]) == 0
    assert journal.read_bytes() == whole


@pytest.mark.slow
def test_the_progress_of_a_study_is_that_of_all_its_runs():
    plan = study.LoadStudy(Write(STUDY.replace(", mine.yaml", ""))).plans["one_dof"]
    seen = []
    progress = Execution(progress=lambda *counts: seen.append(counts))
    RunSweeps({"a": plan, "b": plan}, progress)
    expected = [0, 1, 2, 3, 3, 4, 5, 6]
    assert seen == [(finished, 6) for finished in expected]


def test_sweeps_have_what_all_have_and_their_own():
    own = """
scenarios:
  slow: {scenario: one_dof, grid: {robot.mass: [1, 2]}, overrides: {duration: 9}}
  wifi:
    {scenario: mine.yaml, seeds: 2, grid: {delay: [0.05]},
     overrides: {return_channel.kind: wifi}}
"""
    text = STUDY.replace("scenarios: [one_dof, mine.yaml]\n", own)
    Path("mine.yaml").write_text(ScenarioToYaml(LoadScenario("one_dof")))
    slow, wifi = study.LoadStudy(Write(text)).plans.values()
    delays = {"controller": ["direct_force"], "delay": [0.0, 0.02, 0.04]}
    assert slow.axes == delays | {"robot.mass": [1, 2]}
    assert slow.overrides == [("duration", 9)] and slow.engine == "drake"
    assert wifi.axes == delays | {"delay": [0.05], "seed": [0, 1]}
    assert wifi.overrides == [("duration", 0.02), ("return_channel.kind", "wifi")]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("grid:", "grids:", "key = 'grids': must be one of scenarios, .*'grid'"),
        ("[one_dof, mine.yaml]", "one_dof", "scenarios = 'one_dof': must be a list"),
        ("[one_dof, mine.yaml]", "{a: 1}", "scenarios.a.sweep = 1: must be a mapping"),
        ("[one_dof, mine.yaml]", "{a: {grid: {}}}", "a.scenario = null: must be the"),
        ("[one_dof, mine.yaml]", "{a: {metrics: x}}", "a.key = 'metrics': must be one"),
        ("mine.yaml", "one_dof", "scenarios = .*: must be scenarios whose"),
        (", mine.yaml", ", none.yaml", "none.yaml"),
        ("[direct_force]", "direct", "controllers = 'direct': must be `all` or"),
        ("[direct_force]", "[]", r"controllers = \[\]: must be `all` or"),
        ("0:0.04:3", "0:0.04:x", "grid.delay = '0:0.04:x': must be START"),
        ("0:0.04:3", "[-1]", "forward_channel.delay = -1"),
        ("0:0.04:3", "{a: 1}", "grid.delay = .*must be a list of values or START"),
        ("{duration: 0.02}", "7", "overrides = 7: must be a mapping"),
        ("engine: drake", "engine: steam", "engine = 'steam': must be one of"),
        ("engine: drake", "seeds: -1", "seeds = -1: must be 1 to"),
        ("engine: drake", "metrics: speed", "metrics = 'speed': must be a list"),
        ("engine: drake", "metrics: [speed]", "metric 'speed': must be one of"),
    ],
)
def test_bad_studies(old, new, message, capsys):
    text = STUDY.replace(old, new)
    assert text != STUDY
    if "mine.yaml" in text and "none" not in new:
        text = text.replace(", mine.yaml", "")
    assert main(["sweep", Write(text), "--quiet"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(message, line), line
    assert not Path("out").exists()


@pytest.mark.parametrize(
    "option", [["--delay", "0.1"], ["--engine", "drake"], ["--seeds", "2"]]
)
def test_a_study_takes_no_options_of_a_scenario(option, capsys):
    file = Write(STUDY.replace(", mine.yaml", ""))
    assert main(["sweep", file, *option]) == 2
    expected = f"{option[0]} = .*: must be left out with a study, which has it"
    assert re.search(expected, capsys.readouterr().err)

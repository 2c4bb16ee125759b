"""Studies: several scenarios from a file, whole or in parts."""

import json
import re
from pathlib import Path

import pytest

from teleop_drake.cli import main
from teleop_drake.scenario import LoadScenario, ScenarioToYaml
from teleop_drake.sweep import SweepError, study

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


def Files(folder):
    """The files of a study but for those of its parts."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in Path(folder).rglob("*")
        if path.is_file() and "part-" not in str(path)
    }


def test_parts_make_the_whole(capsys, unrendered):
    """Byte for byte, also from two folders; a part can be missing until it is done."""
    Mine(capsys)
    one = ["--jobs", "1", "--quiet"]
    file = Write(STUDY + "metrics: [velocity_rms_error]\n")
    assert main(["sweep", file, *one, "--out", "whole"]) == 0
    out = capsys.readouterr().out
    assert "one_dof: 3 runs, 3 completed" in out
    assert main(["sweep", file, *one, "--out", "parts", "--shard", "1/2"]) == 0
    assert main(["sweep", file, "--merge", "parts", "--out", "parts"]) == 2
    assert "lack part-2-of-2" in capsys.readouterr().err
    assert main(["sweep", file, *one, "--out", "others", "--shard", "2/2"]) == 0
    capsys.readouterr()
    merge = ["sweep", file, "--merge", "parts", "others", "--json", "-"]
    merge += ["--out", "parts"]
    assert main(merge) == 0
    records = json.loads(capsys.readouterr().out)
    assert {name: len(runs) for name, runs in records.items()} == {
        "one_dof": 3,
        "mine": 3,
    }
    whole = Files("whole")
    assert Files("parts") == whole
    assert "mine/runs.csv" in whole and any(name.endswith(".png") for name in whole)
    told = json.loads(whole["one_dof/sweep.json"])
    assert told["engine"] == "drake" and set(told) >= {"versions", "commit", "axes"}
    assert set(told["versions"]) == {"teleop-drake", "drake", "numpy", "llvmlite"}


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
    assert slow.overrides == ["duration=9"] and slow.engine == "drake"
    assert wifi.axes == delays | {"delay": [0.05], "seed": [0, 1]}
    assert wifi.overrides == ["duration=0.02", "return_channel.kind=wifi"]


def test_a_part_of_another_study_is_noticed(capsys):
    text = STUDY.replace(", mine.yaml", "")
    one = ["--jobs", "1", "--quiet"]
    assert main(["sweep", Write(text), *one, "--shard", "1/1"]) == 0
    other = Write(text.replace("0.04:3", "0.02:3"), "other.yaml")
    assert main(["sweep", other, "--merge", "out"]) == 2
    assert "holds a sweep with other parameters (axes" in capsys.readouterr().err


def test_bad_studies(capsys):
    for old, new, message in [
        ("grid:", "grids:", "key = 'grids': must be one of scenarios, .*'grid'"),
        ("[one_dof, mine.yaml]", "one_dof", "scenarios = 'one_dof': must be a list"),
        ("[one_dof, mine.yaml]", "{a: 1}", "scenarios.a.sweep = 1: must be a mapping"),
        ("[one_dof, mine.yaml]", "{a: {grid: {}}}", "a.scenario = null: must be the"),
        ("[one_dof, mine.yaml]", "{a: {metrics: x}}", "a.key = 'metrics': must be one"),
        ("mine.yaml", "one_dof", "scenarios = .*: must be scenarios whose"),
        (", mine.yaml", ", none.yaml", "none.yaml"),
        ("[direct_force]", "direct", "controllers = 'direct': must be `all` or"),
        ("0:0.04:3", "0:0.04:x", "grid.delay = '0:0.04:x': must be START"),
        ("0:0.04:3", "[-1]", "forward_channel.delay = -1"),
        ("0:0.04:3", "{a: 1}", "grid.delay = .*must be a list of values or START"),
        ("{duration: 0.02}", "7", "overrides = 7: must be a mapping"),
        ("engine: drake", "engine: steam", "engine = 'steam': must be one of"),
        ("engine: drake", "seeds: -1", "seeds = -1: must be 1 to"),
        ("engine: drake", "metrics: speed", "metrics = 'speed': must be a list"),
        ("engine: drake", "metrics: [speed]", "metric 'speed': must be one of"),
    ]:
        text = STUDY.replace(old, new)
        assert text != STUDY
        if "mine.yaml" in text and "none" not in new:
            text = text.replace(", mine.yaml", "")
        assert main(["sweep", Write(text), "--quiet"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert re.search(message, line), line
        assert not Path("out").exists()


def test_bad_options(capsys):
    file = Write(STUDY.replace(", mine.yaml", ""))
    for arguments, message in {
        ("--shard", "0/3"): "'0/3': must be I/N with 1 <= I <= N",
        ("--shard", "4/3"): "'4/3': must be I/N",
        ("--shard", "1/2", "--json", "-"): "--json: must be left out with --shard",
        ("--merge", "out", "--jobs", "2"): "--jobs: must be left out where parts are",
        (
            "--merge",
            "out",
        ): "parts in out/one_dof: must be those of one N",
        ("--delay", "0.1"): "--delay: must be left out with a study, which says it",
        ("--engine", "drake"): "--engine: must be left out with a study",
    }.items():
        assert main(["sweep", file, *arguments]) == 2
        assert message in capsys.readouterr().err
    assert study.ParsePart("3/20") == (3, 20)
    with pytest.raises(SweepError):
        study.ParsePart("three/20")

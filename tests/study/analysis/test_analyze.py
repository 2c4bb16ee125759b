"""Tests of `teleop-drake analyze`."""

import json
import os
import re
from pathlib import Path

import pytest

from teleop_drake.cli import main
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.study.analysis.stability import AnalyzeStability

pytestmark = pytest.mark.usefixtures("in_an_empty_folder")


def test_table(capsys):
    assert main(["analyze", "one_dof", "--controller", "direct_force"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    headline, head, *rows, held, first, now, remedy, passive = out.splitlines()
    assert headline == (
        "one_dof, direct_force: delay 0.1 s forward, 0.1 s back; "
        "round-trip delays up to 2 s"
    )
    assert head.split("  ")[-1] == "root at 0.2 s [1/s]"
    tissue, free, bone, force = (row.split() for row in rows)
    assert free[:5] == ["free", "0.01125", "2.529", "50.4", "0.34788"]
    assert tissue[-1] == free[-1] == "stable"
    assert bone[-1] == "UNSTABLE" and "..." in bone
    assert " ".join(force) == (
        "bone, force held 0.015033 - - - 0-2+ -0.1 ± 17.32j stable"
    )
    assert held == (
        "In bone the operator commands a velocity until it perceives contact, and "
        "holds a force from then on: bone, force held."
    )
    assert first == (
        "It fails first in bone, at 0.05269 s: the delay turns the phase at 18.15 "
        "rad/s by all of its margin, 54.8 deg."
    )
    assert now == "At 0.2 s, in bone, a motion of 16.72 rad/s doubles every 1.9 s."
    assert remedy == (
        "In bone: stable with less than 0.226 times the gain, or 0 to 0.05269, 0.2356 "
        "to 0.3989, 0.6163 to 0.7452 s of round-trip delay."
    )
    assert passive == (
        "Not stable with every passive operator and environment: Llewellyn's parameter "
        "falls below 1 (tissue, free, bone)."
    )
    assert os.listdir() == []


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--controller", "wave_variables"], "Llewellyn's parameter is 1 or more ever"),
        (["--controller", "time_domain_passivity"], "are taken to inject nothing"),
        (["--controller", "smith_predictor"], "predictor is taken to be the round tr"),
        (["--set", "forward_channel={kind: variable, sinusoid: {amplitude: 0.02}}"],
         "forward_channel: the delay varies from 0.08 to 0.12 s; the margins hold"),
        (["--set", "return_channel={kind: sampled, sample_period: 0.01}"],
         "return_channel: packets are held for 0.01 s, on average half of that; the"),
    ],
)  # fmt: skip
def test_what_was_assumed_is_said(options, text, capsys):
    assert main(["analyze", "one_dof", *options]) == 0
    assert text in capsys.readouterr().out


@pytest.mark.slow
def test_json_on_stdout(capsys):
    command = ["analyze", "one_dof", "--delay", "0.05", "--json", "-"]
    assert main([*command, "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    record = json.loads(out)
    scenario = LoadScenario(
        "one_dof",
        {"forward_channel.delay": 0.05, "return_channel.delay": 0.05},
    )
    transparency = record.pop("transparency")
    units = record.pop("units")
    point = record["operating_points"][0]
    assert set(units) <= {*record, *point}
    assert units["phase_margin"] == "rad" and units["delay_margin"] == "s"
    assert record == AnalyzeStability(scenario).ToRecord()
    assert [point["name"] for point in transparency] == ["tissue", "free", "bone"]
    assert not any(point["absolutely_stable"] for point in transparency)
    assert record["notes"] == [
        "The weights of the adaptive law are frozen at their initial values."
    ]
    assert record["forward_delay"] == 0.05


@pytest.mark.slow
def test_files(capsys, unrendered):
    command = ["analyze", "one_dof", "--out", "here", "--max-delay", "0.5"]
    vary = ["--vary", "robot.mass=0.4:0.8:2", "--quiet"]
    assert main([*command, *vary, "--set", "controller.kind=direct_force"]) == 0
    stem = "one_dof_direct_force"
    names = [
        f"{stem}_{name}"
        for name in (
            "analysis.json",
            "bode.png",
            "chart.png",
            "felt_stiffness.png",
            "nyquist.png",
            "stable_delays.png",
            "transparency.png",
        )
    ]
    assert sorted(os.listdir("here")) == names
    record = json.loads(Path(f"here/{stem}_analysis.json").read_text())
    assert record["max_delay"] == 0.5
    assert record["chart"]["key"] == "robot.mass"
    assert record["chart"]["values"] == [0.4, 0.8]
    margins = [
        analysis["operating_points"][1]["delay_margin"]
        for analysis in record["chart"]["analyses"]
    ]
    assert len(set(margins)) == 2 and margins == sorted(margins)
    out = capsys.readouterr().out
    assert "Delay margins\nrobot.mass  tissue [s]  free [s]  bone [s]" in out
    assert f"here/{stem}_chart.png" in out
    # The overrides hold for the analysis of each value.
    assert record["chart"]["analyses"][0]["controller"] == "direct_force"


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("one_dof --max-delay 0", "max_delay = 0.0: must be a finite number > 0 (s)"),
        ("one_dof --max-delay soon", "argument --max-delay: invalid float value: 'so"),
        ("one_dof --vary robot.mass", "--vary = 'robot.mass': must be PATH=START:"),
        ("one_dof --vary robot.mass=a", "--vary robot.mass = 'a': must be finite nu"),
        ("one_dof --vary robot.mass=1:2", "--vary robot.mass = '1:2': must be START:"),
        ("one_dof --vary robot.mass=1", "--vary robot.mass = '1': must be two values"),
        ("one_dof --vary robot.mass=-1:1:2", "robot.mass = -1.0: must be a finite num"),
        ("one_dof --vary robot.maas=1:2:2", "robot.maas = 1.0: unknown key 'maas', mu"),
        ("two_dof_puncture --vary position=1,2", "position = 2: [2.0, 0.0]: must be 0"),
        ("one_dof --vary position=-1,2", "position = -1.0: must be on the tool's path"),
        ("network_tracking_linear", "scenario = 'network_tracking_linear': must be a"),
        ("one_dof --vary surgeon=0:1:2", "surgeon = 0.0: must be a mapping with the"),
        (
            "one_dof --set controller.kind=smith_predictor "
            "--set controller.smith_predictor.delay=0.1",
            "delay inside of a station = 0.1: must be the round trip, 0.2 s",
        ),
        ("one_dof --out file", "--out = 'file': must be a folder that can be"),
        ("one_dof --json no/a", "--json = 'no/a': must be where 'a' can be"),
    ],
)
def test_bad_input(command, message, capsys):
    Path("file").touch()
    command = ["analyze", *re.split(r"(?<![:,]) ", command), "--quiet"]
    assert main(command) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"teleop-drake: error: {message}")
    assert err.count("\n") == 1 and err.endswith("\n")
    assert os.listdir() == ["file"]


def Chart(capsys, *options):
    assert main(["analyze", "one_dof", "--quiet", *options]) == 0
    return capsys.readouterr().out.partition("Delay margins\n")[2].splitlines()


@pytest.mark.slow
def test_stable_and_absent_are_told_apart(capsys):
    vary = ["--vary", "surgeon.velocity.0=0.0001,0.1"]
    lines = Chart(capsys, "--controller", "four_channel", *vary)
    assert [line.split() for line in lines[1:3]] == [
        ["0.0001", "stable", "absent", "absent", "absent"],
        ["0.1", "stable", "stable", "stable", "windows"],
    ]
    assert lines[3:] == [
        "stable: at every delay",
        "windows: unstable without delay, and stable at some larger ones",
        "absent: the tool does not reach this layer",
    ]


@pytest.mark.slow
def test_unstable_at_every_delay_is_said(capsys):
    key = "controller.wave_variables.master_damping"
    lines = Chart(capsys, "--controller", "wave_variables", "--vary", f"{key}=0,2")
    assert lines[1].split()[1:] == ["unstable"] * 4
    assert lines[2].split()[1:] == ["stable"] * 4
    assert lines[3:] == [
        "stable: at every delay",
        "unstable: at every delay examined",
    ]


def test_a_wall_unstable_at_every_delay_is_said_first(capsys):
    wall = ["--set", "environment.layers.bone.stiffness=20000"]
    command = ["analyze", "one_dof", *wall, "--set", "controller.initial_psi=40"]
    assert main(command) == 0
    out = capsys.readouterr().out
    assert (
        "\nNot stable even without delay: bone, bone, force held.\n"
        "With a delay it fails first in free, at 0.622 s" in out
    )


def test_an_undamped_tool_under_a_held_force_is_said(capsys):
    assert main(["analyze", "two_dof_collision", "--controller", "direct_force"]) == 0
    out = capsys.readouterr().out
    held = next(x for x in out.splitlines() if x.startswith("bone, force held"))
    assert held.endswith("none           0 ± 24.23j  NOT DAMPED")
    assert "in bone, force held, a motion of 24.23 rad/s neither grows nor dec" in out
    assert "\nIn bone, force held: no gain up to 100 times as large or" in out


def test_operator_without_a_contact_force_is_said(capsys):
    assert main(["analyze", "one_dof", "--set", "surgeon.contact_force=null"]) == 0
    out = capsys.readouterr().out
    assert "The operator commands a velocity at every point shown." in out
    assert "force held" not in out


def test_neutral_modes_are_said(capsys):
    slow = ["--set", "surgeon.velocity=[0.002, 0]"]
    command = ["analyze", "two_dof_collision", "--controller", "smith_predictor"]
    assert main([*command, *slow]) == 0
    _, _, free, _, neutral, *_ = capsys.readouterr().out.splitlines()
    assert free.endswith("stable") and "UNSTABLE" not in free
    assert re.fullmatch(
        r"Roots slower than the tool's motion there are not counted: "
        r"below 0\.00\d+ \(free\) rad/s\.",
        neutral,
    )


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("key", "value"), [("duration", "1.0e-6"), ("surgeon.velocity.0", "1.0e-30")]
)
def test_path_of_no_length_has_a_model(key, value, capsys):
    command = ["analyze", "two_dof_combined", "--controller", "direct_force"]
    assert main([*command, "--set", f"{key}={value}"]) == 0
    assert " stable" in capsys.readouterr().out


@pytest.mark.slow
def test_the_map_of_all_connections(capsys):
    """The margins of the channels are those of the loop, less the delay of 0.2 s."""
    command = ["analyze", "one_dof", "--controller", "direct_force", "--map"]
    assert (
        main([*command, "--out", "out", "--format", "svg", "--json", "map.json"]) == 0
    )
    out = capsys.readouterr().out
    record = json.loads(Path("map.json").read_text())
    assert record["units"]["delay_map"] == "s"
    points = {x["name"]: x for x in record["operating_points"]}
    for name in ("tissue", "free"):
        own = record["delay_map"][name]
        more = points[name]["delay_margin"] - 0.2
        for wire in ("forward_channel.signal", "return_channel.signal"):
            assert own[wire] == pytest.approx(more, rel=1e-9)
    # The loop on the bone is unstable at 0.2 s. Under the held force, x'' + 0.2 x' +
    # 300 x = 0 in the bone tolerates a delay T of the spring with 300 T = 0.2.
    assert set(record["delay_map"]["bone"].values()) == {0.0}
    held = record["delay_map"]["bone, force held"]
    assert held["environment.tool_position"] == pytest.approx(0.2 / 300, rel=1e-3)
    assert held["forward_channel.signal"] is None
    row = next(x for x in out.splitlines() if x.startswith("forward_channel.signal"))
    assert row.split()[1:] == ["0.3327", "0.1479", "unstable", "any"]
    picture = Path("out/one_dof_direct_force_map_bone_force_held.svg").read_text()
    assert "667 µs" in picture

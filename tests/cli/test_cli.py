"""Tests of teleop_drake.cli, in this process except where that is the point."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import teleop_drake
import teleop_drake.model.run.simulate
from teleop_drake.cli import main
from teleop_drake.cli.main import MakeParser
from teleop_drake.cli.options import ControllersOf
from teleop_drake.model.blocks.environments import layered_force_field
from teleop_drake.model.blocks.environments.kinds import ENVIRONMENT_KINDS
from teleop_drake.model.blocks.operators import OPERATOR_KINDS
from teleop_drake.model.blocks.robots import ROBOT_KINDS
from teleop_drake.model.scenario import (
    ARCHITECTURES,
    CONTROLLERS,
    TRACKING_CONTROLLERS,
    LoadScenario,
    ScenarioNames,
    ScenarioToYaml,
)
from teleop_drake.model.task_recording import LoadRecording

pytestmark = pytest.mark.usefixtures("in_an_empty_folder")

NAMES = [
    ("compare one_dof", "--controllers"),
    ("compare one_dof", "--signals"),
    ("run one_dof", "--format"),
    ("sweep one_dof", "--controllers"),
    ("sweep one_dof", "--metrics"),
    ("tune one_dof --minimize a", "--gains"),
    ("page one_dof", "--controllers"),
    ("replay one_dof", "--controllers"),
    ("reproduce", "--only"),
    ("docs", "--parts"),
]

SHORT = ["--duration", "0.3", "--accuracy", "1e-5", "--quiet"]


@pytest.mark.parametrize(("command", "option"), NAMES)
def test_names_of_a_repeated_option_are_added(command, option):
    """They replace the default only."""
    words = [*command.split(), option, "a,b", option, "c"]
    args = vars(MakeParser().parse_args(words))
    assert args[option.removeprefix("--")] == ["a", "b", "c"]


def test_import_is_light():
    code = (
        "import sys, teleop_drake.cli; "
        "print([m for m in ('pydrake', 'numpy', 'matplotlib', 'yaml') "
        "if m in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert run.stdout == "[]\n"


@pytest.mark.parametrize("command", [[], ["run"]])
def test_help(command, capsys):
    with pytest.raises(SystemExit) as info:
        main([*command, "--help"])
    assert info.value.code == 0
    assert capsys.readouterr().out.startswith("usage: teleop-drake")


def test_only_commands_that_are_for_files_have_a_folder_unasked():
    folders = {}
    for name, parser in MakeParser()._subparsers._group_actions[0].choices.items():
        parser.AddOptionsOfCommand()
        for action in parser._actions:
            if "--out" in action.option_strings:
                folders[name] = action.default
                assert (action.default == "out") == ("(default: out)" in action.help)
    asked = {"run", "analyze", "replay", "docs"}
    assert {name for name, folder in folders.items() if folder is None} >= asked


def test_version(capsys):
    with pytest.raises(SystemExit) as info:
        main(["--version"])
    assert info.value.code == 0
    line = capsys.readouterr().out
    assert line.startswith(f"teleop-drake {teleop_drake.__version__} (drake 1.")


def test_module_runs_the_command():
    run = subprocess.run(
        [sys.executable, "-m", "teleop_drake", "sow"],
        capture_output=True,
        check=False,
        text=True,
    )
    assert run.returncode == 2
    assert run.stdout == ""
    assert run.stderr.startswith("teleop-drake: error: ")
    assert run.stderr.count("\n") == 1


def test_closed_pipe():
    command = f"{sys.executable} -m teleop_drake show one_dof | true"
    run = subprocess.run(
        command, shell=True, capture_output=True, check=False, text=True
    )
    assert run.stderr == ""


def test_list(capsys):
    assert main(["list"]) == 0
    out = capsys.readouterr().out
    for name in ScenarioNames():
        (line,) = [line for line in out.splitlines() if line.startswith(f"  {name} ")]
        assert f" {LoadScenario(name).title}. " in line
    studies = "league, league_held_out, passive_and_quick, sample_period, "
    studies += "sensitivity, tolerance, why_adaptive"
    assert f"Studies\n  {studies}\n" in out
    lines = out.splitlines()[-12:]
    titles = lines[::2]
    names = lines[1::2]
    kinds = dict(zip(titles, names, strict=True))
    for title, table in {
        "Environments": ENVIRONMENT_KINDS.names,
        "Operators": OPERATOR_KINDS.names,
        "Robots": ROBOT_KINDS.names,
        "Controllers": CONTROLLERS + TRACKING_CONTROLLERS,
        "Other architectures": ARCHITECTURES[2:],
    }.items():
        assert sorted(kinds[title].strip().split(", ")) == sorted(table)


def test_show(capsys):
    assert main(["show", "two_dof_combined"]) == 0
    out = capsys.readouterr().out
    assert out == ScenarioToYaml(LoadScenario("two_dof_combined"))


def test_options_are_overrides(capsys):
    options = [
        *("--controller", "direct_force"),
        *("--delay", "0.03"),
        *("--return-delay", "0.02"),
        *("--duration", "1"),
        *("--accuracy", "1e-6"),
        *("--set", "surgeon.velocity.0=0.2"),
        *("--set", "duration=2"),
        *("--set", "duration=3"),
    ]
    assert main(["show", "two_dof_combined", *options]) == 0
    expected = LoadScenario(
        "two_dof_combined",
        {
            "controller.kind": "direct_force",
            "forward_channel.delay": 0.03,
            "return_channel.delay": 0.02,
            "duration": 3,
            "simulator.accuracy": 1e-6,
            "surgeon.velocity": [0.2, 0],
        },
    )
    assert capsys.readouterr().out == ScenarioToYaml(expected)
    assert main(["show", "one_dof", "--forward-delay", "0.05"]) == 0
    expected = LoadScenario("one_dof", {"forward_channel.delay": 0.05})
    assert capsys.readouterr().out == ScenarioToYaml(expected)


def test_run_prints_a_table(capsys):
    assert main(["run", "one_dof", *SHORT, "--accuracy", "1e-8"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    headline, _, *rows = out.splitlines()
    assert headline == (
        "one_dof, adaptive_backstepping: delay 0.1 s forward, 0.1 s back, "
        "0.3 s simulated, completed"
    )
    assert any(row.startswith("start velocity overshoot ") for row in rows)
    assert any(
        row.startswith("control force peak x ") and row.endswith(" N") for row in rows
    )
    assert os.listdir() == []


def test_tracking(capsys, unrendered):
    name = "network_tracking_coupled"
    command = ["run", name, *SHORT]
    assert main([*command, "--out", "."]) == 0
    headline, _, *rows = capsys.readouterr().out.splitlines()
    assert headline == f"{name}, network_tracking: 0.3 s simulated, completed"
    for row, unit in (("max error x", "m"), ("disturbance rms error y", "N")):
        (line,) = [line for line in rows if line.startswith(row)]
        assert line.endswith(f" {unit}")
    stem = f"{name}_network_tracking"
    assert sorted(os.listdir()) == [f"{stem}.{end}" for end in ("json", "npz", "png")]
    record = json.loads(Path(f"{stem}.json").read_text())
    assert set(record["metrics"]) == {
        "max_error",
        "rms_error",
        "disturbance_rms_error",
    }
    assert main(["diagram", name]) == 0
    dot = capsys.readouterr().out
    assert all(system in dot for system in ("reference", "robot", "disturbance"))
    assert main(["show", name]) == 0
    assert capsys.readouterr().out == ScenarioToYaml(LoadScenario(name))


def test_run_writes_files(capsys, unrendered):
    command = ["run", "one_dof", *SHORT, "--json", "a.json", "--out", "new/folder"]
    assert main(command) == 0
    stem = "one_dof_adaptive_backstepping"
    names = [f"{stem}.{suffix}" for suffix in ("json", "npz", "png")]
    assert sorted(os.listdir("new/folder")) == names
    assert sorted(os.listdir()) == ["a.json", "new"]
    record = json.loads(Path("a.json").read_text())
    assert json.loads(Path(f"new/folder/{stem}.json").read_text()) == record
    recording = LoadRecording(f"new/folder/{stem}.npz")
    assert recording.time[-1] == record["duration"] == 0.3
    assert Path(f"new/folder/{stem}.png").read_bytes().startswith(b"\x89PNG")
    assert f"new/folder/{stem}.npz" in capsys.readouterr().out
    # Again: files are replaced, but devices and links stay what they are.
    Path("link.json").symlink_to("a.json")
    command[command.index("a.json")] = "link.json"
    assert main([*command, "--channel", "lte"]) == 0
    names.insert(2, f"{stem}_network.png")
    assert sorted(os.listdir("new/folder")) == sorted(names)
    assert Path("link.json").is_symlink()
    assert json.loads(Path("a.json").read_text()) != record
    assert main(["run", "one_dof", *SHORT, "--json", "/dev/null"]) == 0
    assert not Path("/dev/null").is_file()


@pytest.mark.slow
def test_compare(capsys, unrendered):
    every = MakeParser().parse_args(["compare", "one_dof", "--controllers", "all"])
    assert ControllersOf(every) == list(ARCHITECTURES)
    assert main(["compare", "one_dof", *SHORT, "--json", "a.json"]) == 0
    out = capsys.readouterr().out
    (header,) = [line for line in out.splitlines() if line.startswith(" ")]
    assert header.split() == ["direct_force", "adaptive_backstepping"]
    assert sorted(os.listdir("out")) == [
        "one_dof_adaptive_backstepping.npz",
        "one_dof_comparison.png",
        "one_dof_direct_force.npz",
    ]
    direct, adaptive = json.loads(Path("a.json").read_text())
    assert direct["controller"] == "direct_force"
    assert adaptive["controller"] == "adaptive_backstepping"
    (row,) = [line for line in out.splitlines() if line.startswith("control force pea")]
    assert row.split()[4:] == [
        f"{record['metrics']['control_force_peak'][0]:.5g}"
        for record in (direct, adaptive)
    ] + ["N"]


@pytest.mark.parametrize("command", ["diagram", "page"])
@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("return {}['x']", r"\(KeyError: 'x'; failing\.py:2\)"),
        ("raise SystemExit('contract')", r"\(SystemExit: contract; failing\.py:2\)"),
        ("return 3", "not a int"),
    ],
)
def test_a_function_that_fails_to_make_a_diagram(
    command, body, reason, capsys, monkeypatch
):
    """One line has the error and its place in the user's file."""
    Path("failing.py").write_text(f"def Make():\n    {body}\n")
    monkeypatch.delitem(sys.modules, "failing", raising=False)
    monkeypatch.syspath_prepend(os.getcwd())
    assert main([command, "failing:Make", "-o", "unused.html"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    allowed = "SCENARIO = 'failing:Make': must be a function that returns a Diagram"
    assert re.search(f"{re.escape(allowed)}.*{reason}$", line)


def test_diagram(capsys):
    assert main(["diagram", "one_dof"]) == 0
    dot = capsys.readouterr().out
    for name in ("master", "forward_channel", "controller", "robot", "return_channel"):
        assert name in dot
    assert main(["diagram", "one_dof", "-o", "loop.dot"]) == 0
    assert Path("loop.dot").read_text() == dot
    assert main(["diagram", "one_dof", "--depth", "2", "-o", "loop.dot"]) == 0
    assert len(Path("loop.dot").read_text()) > len(dot)
    assert os.listdir() == ["loop.dot"]


# Interruption and progress.


@pytest.fixture
def interrupted(monkeypatch):
    """Makes simulate() return what it had when Ctrl-C came."""
    simulate = teleop_drake.model.run.simulate.simulate

    def interrupted_simulate(scenario, progress=None, engine="drake"):
        recording = simulate(scenario)
        return replace(
            recording, termination="interrupted", reason="interrupted by the user"
        )

    monkeypatch.setattr(
        teleop_drake.model.run.simulate, "simulate", interrupted_simulate
    )


@pytest.mark.slow
def test_compare_values(capsys):
    """Trajectories at several values of any number, as wide as asked for."""
    options = ["--vary", "delay=0.05,0.1", "--controllers", "direct_force"]
    options += ["--format", "svg,pdf", "--columns", "1", "--window", "0.1:0.2"]
    options += ["--signals", "tool_velocity", "--out", "here", "--json", "a.json"]
    assert main(["compare", "one_dof", *SHORT, *options]) == 0
    assert sorted(os.listdir("here")) == [
        "one_dof_comparison.pdf",
        "one_dof_comparison.svg",
        "one_dof_direct_force_delay=0.05.npz",
        "one_dof_direct_force_delay=0.1.npz",
    ]
    records = json.loads(Path("a.json").read_text())
    assert [record["forward_delay"] for record in records] == [0.05, 0.1]
    text = Path("here/one_dof_comparison.svg").read_text()
    title = re.search("<title>(.*)</title>", text)[1]
    assert title.startswith("One panel: velocity v_x [mm/s]; against time [s]")
    assert "Legend: delay each way = 0.05 s, 0.1 s" in title
    width = float(re.search(r'<svg .*width="([\d.]+)pt"', text)[1])
    assert width < 3.5 * 72
    header = capsys.readouterr().out.splitlines()[4]
    assert re.split(r"\s{2,}", header)[1:] == [
        "delay each way = 0.05 s",
        "0.1 s",
    ]


def test_a_run_that_comes_no_further_ends_with_its_reason(capsys, monkeypatch):
    monkeypatch.setattr("teleop_drake.loops.run.run._MOST_STEPS", 3000)
    monkeypatch.setattr("teleop_drake.loops.run.run._STRETCH", 30)
    monkeypatch.setattr("teleop_drake.loops.engine.run._ROOM", 30)
    stiff = ["--set", "controller.adaptation_rate=1e8", "--duration", "1"]
    assert main(["run", "two_dof_combined", "--quiet", *stiff]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("teleop-drake: error: duration = 1: must be at most ")


@pytest.mark.parametrize(
    ("command", "options", "message"),
    [
        ("compare", ["--vary", "delay"], "--vary = 'delay': must be PATH=VALUES"),
        ("compare", ["--vary", "delay=a:b:c"], "grid.delay = 'a:b:c': must be START"),
        ("compare", ["--vary", "dely=1,2"], "dely = 1: unknown key 'dely'"),
        ("compare", ["--vary", "delay=0.1", "--seeds", "2"], "left out with --seeds"),
        ("run", ["--format", "gif"], "--format = 'gif': must be one of png, svg, pdf"),
        ("run", ["--window", "2:1"], "--window = '2:1': must be FROM:TO"),
        ("run", ["--signals", "psy", "--out", "."],
         "--signals = 'psy': must be one of"),
        ("run", ["--window", "1:2", "--out", "."], "time = [1.0, 2.0]: must be before"),
    ],
)  # fmt: skip
def test_what_a_figure_cannot_show_is_refused(command, options, message, capsys):
    assert main([command, "one_dof", *SHORT, *options]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert message in error


@pytest.mark.slow
def test_figures_of_sweeps_and_of_analyses_have_the_formats_asked_for():
    """Each figure in each format, and no other files of figures."""
    options = ["--delay", "0.1,0.2", "--controllers", "direct_force", "--jobs", "1"]
    options += ["--metrics", "control_force_peak", "--format", "pdf,svg"]
    assert main(["sweep", "one_dof", *SHORT, *options, "--out", "s"]) == 0
    figures = {
        name for name in os.listdir("s") if name.endswith((".pdf", ".svg", ".png"))
    }
    assert figures == {"metrics.pdf", "metrics.svg"}
    command = ["analyze", "one_dof", "--controller", "direct_force", "--quiet"]
    assert main([*command, "--format", "svg,png", "--out", "a"]) == 0
    stems = ("bode", "felt_stiffness", "nyquist", "stable_delays", "transparency")
    expected = {f"one_dof_direct_force_{x}.{y}" for x in stems for y in ("svg", "png")}
    assert set(os.listdir("a")) == {*expected, "one_dof_direct_force_analysis.json"}
    text = Path("a/one_dof_direct_force_nyquist.svg").read_text()
    assert text.count("<title>") == 1


@pytest.mark.slow
def test_what_is_interrupted_keeps_what_there_is(interrupted, capsys, unrendered):
    assert main(["run", "one_dof", *SHORT, "--out", "here", "--json", "a.json"]) == 130
    assert len(os.listdir("here")) == 3
    assert Path("a.json").exists()
    assert "interrupted by the user" in capsys.readouterr().out
    assert main(["compare", "one_dof", *SHORT, "--json", "a.json"]) == 130
    written = "out/one_dof_comparison.png, out/one_dof_direct_force.npz\n"
    assert capsys.readouterr().out.endswith(f"Written: {written}")
    assert sorted(os.listdir("out")) == [
        "one_dof_comparison.png",
        "one_dof_direct_force.npz",
    ]
    assert len(json.loads(Path("a.json").read_text())) == 1


@pytest.mark.parametrize("error", [None, ImportError, SystemError])
def test_an_interrupt_is_one_also_if_machine_code_made_another_error_of_it(
    error, monkeypatch, capsys
):
    def interrupt(scenario, **options):
        if error is None:
            raise KeyboardInterrupt
        raise error("initialization failed") from KeyboardInterrupt()

    monkeypatch.setattr(teleop_drake.model.run.simulate, "simulate", interrupt)
    assert main(["run", "one_dof", "--json", "a.json"]) == 130
    assert capsys.readouterr().err == "teleop-drake: error: interrupted\n"
    assert os.listdir() == []


def test_an_error_of_a_block_is_one_line(monkeypatch, capsys):
    def fail(layers, axis, mode, p_WT, v_WT):
        raise RuntimeError("my own bug")

    monkeypatch.setattr(layered_force_field, "force_in_layer", fail)
    assert main(["run", "one_dof", "--engine", "drake"]) == 1
    assert capsys.readouterr().err == (
        "teleop-drake: error: the run failed: RuntimeError: my own bug "
        "(in the block teleoperator::environment)\n"
    )


# Bad input: one line on stderr, and nothing simulated or written.


@pytest.fixture
def no_simulation(monkeypatch):
    def fail(*args, **kwargs):
        pytest.fail("a simulation was started")

    monkeypatch.setattr(teleop_drake.model.run.simulate, "simulate", fail)


@pytest.mark.parametrize(
    "command, message",
    [
        ("", "the following arguments are required: COMMAND"),
        ("rum one_dof", "COMMAND = 'rum': must be one of"),
        ("run", "the following arguments are required: SCENARIO"),
        ("run one_dot", "scenario = 'one_dot': must be one of "),
        ("run a.yaml", "scenario file 'a.yaml': must be readable"),
        ("run one_dof two_dof", "unrecognized arguments: two_dof"),
        ("run one_dof --delays 1", "unrecognized arguments: --delays 1"),
        ("run one_dof --delay", "argument --delay: expected one argument"),
        ("run one_dof --delay -0.1", "forward_channel.delay = -0.1: must be 0 or"),
        ("run one_dof --delay 1e-6", "duration = 25: must be at most 1 s with forward"),
        ("run one_dof --duration 0", "duration = 0.0: must be a finite number >= 1e"),
        ("run one_dof --accuracy 0", "simulator.accuracy = 0.0: must be a finite numb"),
        ("run one_dof --controller pid", "controller.kind = 'pid': must be one of dir"),
        ("run one_dof --set duration", "override 'duration': must be PATH=VALUE"),
        ("run one_dof --json no/a.json", "--json = 'no/a.json': must be where 'a.json"),
        ("run one_dof --json .", "--json = '.': must be where '' can be written"),
        ("run one_dof --out file", "--out = 'file': must be a folder that can be"),
        ("compare one_dof --controllers ,", "--controllers = ',': must be different"),
        ("compare network_tracking_linear",
         "scenario = 'network_tracking_linear': must be a teleoperation to compare"),
        ("run network_tracking_linear --delay 0.1",
         "forward_channel.delay = 0.1: unknown key 'forward_channel', must be one"),
        ("diagram one_dof --depth -1", "--depth = -1: must be 0 or positive"),
        ("diagram one_dof --depth x", "argument --depth: invalid int value: 'x'"),
        ("diagram one_dof -o a.txt",
         "--output: path = 'a.txt': must be a file that ends"),
        ("diagram one_dof -o no/a.dot", "--output: "),
    ],
)  # fmt: skip
def test_bad_input(command, message, no_simulation, capsys):
    Path("file").touch()
    assert main(command.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"teleop-drake: error: {message}")
    assert err.count("\n") == 1 and err.endswith("\n")
    assert os.listdir() == ["file"]


def test_failed_write_leaves_nothing(monkeypatch, capsys):
    Path("a.json").write_text("old")

    def full(path, *args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("teleop_drake.loops.framework.files.os.replace", full)
    assert main(["run", "one_dof", *SHORT, "--json", "a.json"]) == 1
    assert "No space left on device" in capsys.readouterr().err
    assert os.listdir() == ["a.json"]
    assert Path("a.json").read_text() == "old"

"""Tests of teleop_drake.study.sweep and of the command `sweep`."""

import csv
import fcntl
import functools
import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from runs import Run

from teleop_drake.cli import main
from teleop_drake.cli.commands.sweep import PlanOf
from teleop_drake.cli.main import MakeParser
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import (
    CONTROLLERS,
    LoadOverridden,
    LoadScenario,
    ScenarioError,
    ScenarioToYaml,
)
from teleop_drake.model.scenario.tree import ToTree
from teleop_drake.model.tasks.metrics import RunSummary
from teleop_drake.study.figures.runs import SaveFigure
from teleop_drake.study.figures.sweep_maps import PlotStability
from teleop_drake.study.figures.sweeps import PlotSweep
from teleop_drake.study.sweep import (
    FlattenMetrics,
    MetricUnits,
    ParseValues,
    PlanSweep,
    SelectMetrics,
    Sweep,
    SweepError,
    TaskSweepResult,
)

# The tests share worker processes.
pytestmark = [
    pytest.mark.xdist_group("sweep"),
    pytest.mark.usefixtures("in_an_empty_folder"),
]

SHORT = {"duration": 0.02, "simulator.accuracy": 1e-5}
OPTIONS = ["--duration", "0.02", "--accuracy", "1e-5", "--engine", "drake"]

# These runs are too short to be compiled.
Sweep, PlanSweep = (
    functools.partial(function, engine="drake") for function in (Sweep, PlanSweep)
)


def Files(folder):
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


# Grids and records.


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0:0.4:5", [0.0, 0.1, 0.2, 0.3, 0.4]),
        ("0:0.3:4", [0.0, 0.1, 0.2, 0.3]),
        ("-1:1e-3:2", [-1.0, 0.001]),
        ("2:5:1", [2.0]),
        ("0.1", [0.1]),
        ("1,2.5", [1, 2.5]),
        ("1e-2,+1e3,-.5,1.5e3,1_000", [0.01, 1000.0, -0.5, 1500.0, 1000]),
        ("1e-2x,'1e-2'", ["1e-2x", "1e-2"]),
        ("auto,4.3,null", ["auto", 4.3, None]),
        ("[0.1, 0],[0.2, 0]", [[0.1, 0], [0.2, 0]]),
        ("{kind: sampled, delay: 0.1}", [{"kind": "sampled", "delay": 0.1}]),
    ],
)
def test_parse_values(text, values):
    assert ParseValues(text) == values


@pytest.mark.parametrize(
    "text",
    [
        *("", "0:1", "0:1:2:3", "0:1:0", "0:1:2.5", "0:inf:3", "a:b:3", "::"),
        *("0:1:100001", "1,,2", "[", "2020-13-01"),
    ],
)
def test_parse_refuses(text):
    with pytest.raises(SweepError, match=re.escape(f"{text!r}: ")) as info:
        ParseValues(text)
    assert "\n" not in str(info.value)


@pytest.mark.slow
def test_records_are_those_of_single_runs(in_this_process):
    grid = {"controller": CONTROLLERS, "delay": np.array([0.0, 0.05])}
    result = Sweep("one_dof", grid, overrides=SHORT)
    assert result.axes == {"controller": list(CONTROLLERS), "delay": [0.0, 0.05]}
    for run, record in enumerate(result.records):
        varied = {"controller": CONTROLLERS[run // 2], "delay": [0.0, 0.05][run % 2]}
        expected = RunSummary(
            simulate(
                LoadScenario(
                    "one_dof",
                    {
                        "controller.kind": varied["controller"],
                        "forward_channel.delay": varied["delay"],
                        "return_channel.delay": varied["delay"],
                    }
                    | SHORT,
                ),
                engine="drake",
            )
        )
        del expected["solver"]["wall_time_s"], expected["solver"]["real_time_factor"]
        head = {"run": run, "varied": varied, "status": "completed", "reason": ""}
        assert record == head | expected
    assert result.shape == (2, 2)
    error = result.Values("velocity_rms_error.x")
    assert error[1, 0] == result.records[2]["metrics"]["velocity_rms_error"][0]
    assert np.isnan(result.Values("puncture.force")).all()
    assert (result.Status() == "completed").all()


@pytest.mark.slow
def test_a_file_with_a_trace_can_be_swept(in_this_process):
    os.mkdir("mine")
    Path("mine/lag.csv").write_text("time_s,delay_s\n0,0.01\n1,0.02\n")
    scenario = LoadScenario(
        "one_dof",
        SHORT
        | {
            "forward_channel.kind": "variable",
            "forward_channel.trace": "mine/lag.csv",
        },
    )
    scenario.forward_channel.trace = "lag.csv"  # Relative to the file.
    Path("mine/task.yaml").write_text(ScenarioToYaml(scenario))
    result = Sweep("mine/task.yaml", {"robot.mass": [0.4, 0.6]})
    assert [record["reason"] for record in result.records] == ["", ""]
    for record in result.records:
        assert record["scenario"] == "one_dof"
        mass = {"robot.mass": record["varied"]["robot.mass"]}
        one = simulate(LoadScenario("mine/task.yaml", mass), engine="drake")
        assert record["metrics"] == RunSummary(one)["metrics"]


def test_tracking_can_be_swept(in_this_process):
    grid = {"disturbance.gain": [1.0, 2.0]}
    name = "network_tracking_linear"
    result = Sweep(name, grid, overrides=SHORT)
    names = list(MetricUnits(result.scenario))
    assert set(FlattenMetrics(result.records[0]["metrics"])) == set(names)
    with pytest.raises(ScenarioError, match="forward_channel"):
        PlanSweep(name, {"delay": [0.1]})


def test_the_packets_of_network_channels_can_be_swept(in_this_process):
    channel = {"kind": "network", "delay": 0.1, "sample_period": 0.01}
    jitter = [{"kind": "gamma", "std": std} for std in (0.005, 0.02)]
    result = Sweep(
        "one_dof",
        {"channel": [channel | {"jitter": x} for x in jitter], "seed": [0, 1]},
        overrides={**SHORT, "duration": 1.0},
        engine="auto",
    )
    ends = [result.Values(f"forward_channel.delay_{x}") for x in ("p95", "minimum")]
    spread = ends[0] - ends[1]
    assert (spread[0] > 0).all() and (spread[0] < spread[1]).all()
    assert len(set(result.Values("velocity_rms_error.x").ravel())) == 4
    for record in result.records:
        assert record["forward_delay"] == record["return_delay"] == 0.1
    assert result.Table()[1]["forward_channel.age_mean"] > 0.05
    # If the kind of channel varies, some runs may depend on a seed.
    PlanSweep("one_dof", {"forward_channel.kind": ["transport"], "seed": [0, 1]})


def test_all_scalar_metrics_have_names():
    recording = Run("one_dof", "direct_force")
    flat = FlattenMetrics(RunSummary(recording)["metrics"])
    units = MetricUnits(recording.scenario)
    assert list(flat) == list(units)
    assert units["puncture.velocity_overshoot"] == "m/s"
    arm = MetricUnits(LoadScenario("two_dof_combined"))
    assert "force_rms_error.y" in arm and "force_rms_error.y" not in units


def test_select_metrics():
    scenario = LoadScenario("two_dof_combined")
    assert SelectMetrics(scenario, ["velocity_rms_error", "puncture.force"]) == [
        "velocity_rms_error.x",
        "velocity_rms_error.y",
        "puncture.force",
    ]
    assert len(SelectMetrics(scenario, ["collision"])) == 7
    assert "collision.peak_force" in SelectMetrics(scenario)
    with pytest.raises(SweepError, match=r"metric 'collisio': must be one of"):
        SelectMetrics(scenario, ["collisio"])


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        ({"delay": [0.1, -0.1]}, r"forward_channel.delay = -0.1: must be"),
        ({"delay": [0.1], "controller": ["direct", *CONTROLLERS]}, "controller.kind"),
        ({"delay": [1, 0.5, 1.0]}, "grid.delay: must have different values, and 1 is"),
        ({"delay": [1e-6, 0.1], "duration": [25]}, "grid.duration: must leave"),
        ({"delay": []}, "grid.delay = .*at least one"),
        ({"delay": "0:1"}, "grid.delay = '0:1': must be START:STOP:COUNT or A,B,..."),
        ({"delay": 0.1}, "grid.delay = 0.1: must be a list of values or START"),
        ({"delay": [float("nan")]}, "grid.delay: must have finite"),
        ({"delay": [0.1], "forward_delay": [0.1]}, "grid.forward_delay: must leave"),
        ({"duration": [1.0]}, "grid.duration: must leave duration alone, overrides"),
        ({"delay": range(1000), "robot.mass": range(1, 200)}, "199000 runs: must be"),
        ({"seed": [1, 2]}, "grid.seed = .*no channel is random"),
    ],
)
def test_bad_grids(grid, message):
    with pytest.raises(ValueError, match=message) as info:
        PlanSweep("one_dof", grid, overrides=SHORT)
    assert "\n" not in str(info.value)


def test_two_names_of_a_field_are_refused():
    """The earlier one would have no effect, but would be an axis of the figures."""
    bone = "environment.layers.bone.stiffness"
    values = {bone: [100.0, 200.0], "environment.layers.2.stiffness": [300.0]}
    message = f"grid.environment.layers.2.stiffness: must leave {bone} alone, grid."
    with pytest.raises(SweepError, match=re.escape(message)):
        PlanSweep("one_dof", values)
    layer = ToTree(LoadScenario("one_dof").environment.layers[2])
    whole = {bone: [100.0, 200.0], "environment.layers.bone": [layer]}
    with pytest.raises(SweepError, match=r"grid\.environment\.layers\.bone: must"):
        PlanSweep("one_dof", whole)
    message = "grid.return_delay: must leave return_channel.delay alone, overrides sets"
    with pytest.raises(SweepError, match=message):
        PlanSweep("one_dof", {"return_delay": [0.1, 0.2]}, overrides={"delay": 0.3})


def test_a_whole_and_then_a_part_can_be_varied():
    layers = ToTree(LoadScenario("one_dof").environment.layers)
    layers[0]["start"] = -1.0
    others = [*layers[:2], layers[2] | {"damping": 7.0}]
    grid = {"environment.layers": [layers, others]}
    grid["environment.layers.bone.stiffness"] = [100.0, 200.0]
    assert len(PlanSweep("one_dof", grid).points) == 4


@pytest.mark.slow
def test_large_grids_are_checked_quickly(monkeypatch):
    """Not every combination is tried, so that an error is found soon."""
    calls = []

    def Load(*args):
        calls.append(args)
        return LoadOverridden(*args)

    monkeypatch.setattr("teleop_drake.study.sweep.plan.LoadOverridden", Load)
    grid = {"robot.mass": range(1, 17), "robot.damping": range(16), "delay": [0.1, -1]}
    with pytest.raises(ScenarioError, match="-1"):
        PlanSweep("one_dof", grid)
    assert len(calls) < 100
    calls.clear()
    PlanSweep("one_dof", grid | {"delay": [0.1]})
    assert len(calls) < 40


# Runs that fail.


def test_any_exception_is_a_row(in_this_process, monkeypatch):
    def Simulate(scenario, engine):
        if scenario.robot.mass == 2:
            raise SystemExit("a contract of Drake\nis violated")
        if scenario.robot.mass == 3:
            raise ZeroDivisionError("division by zero")
        return simulate(scenario)

    monkeypatch.setattr("teleop_drake.study.sweep.plan.simulate", Simulate)
    grid = {"robot.mass": [1.0, 2.0, 3.0]}
    result = Sweep("one_dof", grid, overrides=SHORT)
    assert [record["reason"] for record in result.records] == [
        "",
        "SystemExit: a contract of Drake is violated",
        "ZeroDivisionError: division by zero",
    ]


def test_an_interrupt_in_a_worker_ends_the_sweep(in_this_process, monkeypatch):
    def Interrupt(scenario, engine):
        raise KeyboardInterrupt

    monkeypatch.setattr("teleop_drake.study.sweep.plan.simulate", Interrupt)
    with pytest.raises(KeyboardInterrupt):
        Sweep("one_dof", {"delay": [0.1]})


# The folder.


def test_files(in_this_process):
    grid = {"forward_channel.sample_period": [0.1, 0.02], "delay": [0.05, 0.2]}
    overrides = SHORT | {"forward_channel.kind": "sampled"}
    seen = []

    def Progress(finished, runs):
        lines = Path("a/b/runs.jsonl").read_text().count("\n")
        seen.append((finished, runs, lines))

    kwargs = {"overrides": overrides, "out": "a/b", "progress": Progress}
    result = Sweep("one_dof", grid, **kwargs)
    assert result.Status().tolist() == [["failed", "completed"], ["completed"] * 2]
    assert result.records[0]["reason"].startswith("forward_channel.sample_period = 0.1")
    assert result.records[0]["metrics"] is None
    assert np.isnan(result.Values("velocity_rms_error.x")).sum() == 1
    # Each line is written as soon as its run has ended.
    assert seen == [(k, 4, k) for k in range(5)]
    assert set(os.listdir("a/b")) == {"sweep.json", "runs.jsonl", "runs.csv"}
    lines = Path("a/b/runs.jsonl").read_text().splitlines()
    records = [json.loads(line) for line in lines]
    assert records == result.records
    with open("a/b/runs.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["failed", *["completed"] * 3]
    assert list(rows[0]) == list(result.Table()[0])
    assert [float(row["delay"]) for row in rows] == [0.05, 0.2, 0.05, 0.2]
    assert rows[0]["velocity_rms_error.x"] == rows[1]["puncture.time"] == ""
    error = result.Values("velocity_rms_error.x")
    assert float(rows[1]["velocity_rms_error.x"]) == error[0, 1]
    assert rows[1]["diverged"] == "false"


@pytest.mark.slow
def test_resume_does_only_the_rest(in_this_process):
    grid = {"robot.mass": [1.0, 2.0, 3.0, 4.0]}
    kwargs = {"overrides": SHORT, "engine": "auto", "jobs": 1}
    Sweep("one_dof", grid, out="whole", **kwargs)
    Sweep("one_dof", grid, out="torn", resume=True, **kwargs)
    expected = Files("whole")
    assert Files("torn") == expected

    lines = expected["runs.jsonl"].splitlines(keepends=True)
    for remains, num_left, is_torn in [
        (lines[3] + lines[0] + lines[1][:-20], 2, True),
        (lines[2] + lines[1][:-1], 1, True),  # The end of the line is missing.
        (b"".join(lines), 4, False),
        (b"", 0, False),
    ]:
        Path("torn/runs.jsonl").write_bytes(remains)
        Path("torn/runs.csv").unlink()
        counts = []
        notices = []
        Sweep(
            "one_dof",
            grid,
            out="torn",
            resume=True,
            progress=lambda finished, runs, counts=counts: counts.append(finished),
            notice=notices.append,
            **kwargs,
        )
        assert counts == list(range(num_left, 5))
        told = "out = 'torn': the run that was killed is done again"
        assert notices == [told] * is_torn
        assert Files("torn") == expected


@pytest.mark.slow
def test_another_trace_is_another_sweep(in_this_process):
    """The contents of the files that a run reads belong to the sweep."""
    trace = Path("trace.csv")
    trace.write_text("time_s,delay_s\n0,0.1\n1,0.1\n")
    channel = {"kind": "variable", "delay": 0.0, "trace": "trace.csv"}
    grid = {"forward_channel": [{"kind": "transport"}, channel]}
    kwargs = {"overrides": SHORT, "out": "out", "resume": True}
    Sweep("one_dof", grid, **kwargs)
    before = Files("out")
    trace.write_text("time_s,delay_s\n0,0.1\n1,0.2\n")
    with pytest.raises(SweepError, match=r"with other parameters \(traces\), which"):
        Sweep("one_dof", grid, **kwargs)
    trace.write_text("time_s,delay_s\n0,0.1\n1,0.1\n")
    Sweep("one_dof", grid, **kwargs)
    assert Files("out") == before


@pytest.mark.slow
def test_folders_that_are_refused(in_this_process):
    kwargs = {"out": "out"}
    Sweep("one_dof", {"robot.mass": [1.0]}, overrides=SHORT, **kwargs)
    before = Files("out")

    def Refused(message, mass=1.0, overrides=SHORT, **more):
        grid = {"robot.mass": [mass]}
        with pytest.raises(SweepError, match=message) as info:
            Sweep("one_dof", grid, overrides=overrides, **(kwargs | more))
        assert "\n" not in str(info.value)
        assert Files("out") == before

    Refused("out = 'out': holds a sweep already")
    Refused(r"other parameters \(axes, first_scenario\)", mass=2.0, resume=True)
    Refused(
        r"other parameters \(overrides, first_scenario\)",
        overrides=SHORT | {"duration": 0.1},
        resume=True,
    )
    descriptor = os.open("out", os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    Refused("in use by another sweep", resume=True)
    os.close(descriptor)

    Path("out/sweep.json").unlink()
    before = Files("out")
    Refused("without the runs.jsonl of something else", resume=True)
    Path("file").touch()
    Refused("out = 'file': must be a folder", out="file")


# The command.


COMMAND = [sys.executable, "-m", "teleop_drake", "sweep", "one_dof", *OPTIONS]


def Start(*options, duration="0.2"):
    """Starts the command `sweep` in a process, and waits for three runs."""
    process = subprocess.Popen(
        [*COMMAND, "--duration", duration, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    file = Path("out/runs.jsonl")
    deadline = time.monotonic() + 600  # In case the runs never end.
    while not file.exists() or file.read_bytes().count(b"\n") < 3:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.005)
    return process


def Children(pid):
    tasks = Path(f"/proc/{pid}/task")
    return [
        child for task in tasks.glob("*/children") for child in task.read_text().split()
    ]


def IsAlive(pid):
    try:
        status = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return status.rpartition(")")[2].split()[0] != "Z"


@pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc")
@pytest.mark.slow  # test_ctrl_c_keeps_what_is_finished() is faster.
def test_kill():
    """kill -9 loses only the present runs, and no worker survives its parent."""
    process = Start("--delay", "0.01:0.2:12", "--jobs", "2")
    children = Children(process.pid)
    assert len(children) >= 2
    process.kill()
    process.communicate()
    assert 3 <= Path("out/runs.jsonl").read_bytes().count(b"\n") < 24
    deadline = time.monotonic() + 20
    while any(map(IsAlive, children)):
        assert time.monotonic() < deadline, "a worker outlives its parent"
        time.sleep(0.01)


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_finished():
    process = Start("--delay", "0.01:0.2:20", "--jobs", "2", "--quiet")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    lines = Path("out/runs.jsonl").read_bytes().splitlines()
    assert 3 <= len(lines) < 40
    assert out == ""
    assert err == (
        f"teleop-drake: error: interrupted; {len(lines)} of 40 runs are in out, "
        "--resume does the rest\n"
    )


@pytest.mark.slow
def test_command(capsys, monkeypatch, in_this_process, unrendered):
    options = ["--vary", "environment.layers.tissue.stiffness=0.01,0.02", "--json", "-"]
    command = ["sweep", "one_dof", *OPTIONS, "--delay", "0:0.1:2", "--jobs", "1"]
    command.append("--quiet")  # A slow machine would print progress.
    assert main([*command, *options]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    records = json.loads(out)
    assert [record["run"] for record in records] == list(range(8))
    assert list(records[5]["varied"].items()) == [
        ("controller", "adaptive_backstepping"),
        ("environment.layers.tissue.stiffness", 0.01),
        ("delay", 0.1),
    ]
    assert records[5]["return_delay"] == 0.1
    assert set(os.listdir("out")) == {
        "sweep.json",
        "runs.jsonl",
        "runs.csv",
        *("metrics.png", "metrics_map.png", "stability.png"),
    }
    # Other metrics are drawn without any new run.
    monkeypatch.setattr("teleop_drake.study.sweep.run.Workers", None)
    options[2:] = ["--metrics", "collision.time", "--separate", "--resume"]
    assert main([*command, *options]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[0] == "one_dof: 8 runs, 8 completed, 0 diverged, 0 failed"
    assert {"collision_time.png", "collision_time_map.png"} < set(os.listdir("out"))


def test_a_sweep_without_a_good_run_fails(monkeypatch, capsys, in_this_process):
    failed = {"status": "failed", "reason": "the model is gone", "metrics": None}
    monkeypatch.setattr(
        "teleop_drake.study.sweep.run._SimulateOne", lambda *args: failed
    )
    command = ["sweep", "one_dof", *OPTIONS, "--delay", "0:0.1:2", "--quiet"]
    assert main(command) == 1
    assert "one_dof: all 4 runs failed: the model is gone" in capsys.readouterr().err


def test_a_sweep_is_machine_code_where_it_can_be(monkeypatch, in_this_process):
    """This is the default. A reason against it is reported once, not for each run."""
    from teleop_drake.study import sweep

    assert MakeParser().parse_args(["sweep", "one_dof"]).engine == "auto"
    assert MakeParser().parse_args(["run", "one_dof"]).engine == "auto"
    engines = []
    said = []

    def Simulate(plan, point, programs):
        engines.append(plan.engine)
        return {"status": "failed", "reason": "not run", "metrics": None}

    monkeypatch.setattr("teleop_drake.study.sweep.run._SimulateOne", Simulate)
    for overrides in (SHORT, {**SHORT, "simulator.integration_scheme": "runge_kutta3"}):
        grid = {"delay": [0.1, 0.2]}
        sweep.Sweep("one_dof", grid, overrides=overrides, notice=said.append)
    assert engines == ["auto"] * 4
    assert said == [
        "Run in Drake's Simulator: compiled runs use runge_kutta5 with error control, "
        "not runge_kutta3."
    ]
    with pytest.raises(SweepError, match="engine = 'steam': must be one of drake"):
        sweep.PlanSweep("one_dof", grid, engine="steam")


@pytest.mark.slow
def test_short_compiled_sweeps_need_no_worker_processes(monkeypatch):
    """Records are those of single runs, with and without worker processes."""
    grid = {"delay": [0.02, 0.05, 0.1, 0.15]}

    def Records():
        return Sweep("one_dof", grid, overrides=SHORT, engine="auto").records

    monkeypatch.setattr("teleop_drake.study.sweep.run.Workers", None)
    records = Records()
    for delay, record in zip(grid["delay"], records, strict=True):
        scenario = LoadScenario("one_dof", SHORT | {"delay": delay})
        expected = RunSummary(simulate(scenario, engine="compiled"))
        assert record["metrics"] == expected["metrics"]
        assert record["final"] == expected["final"]
    workers = []

    def Workers(jobs, preload):
        workers.append(jobs)
        return ThreadPoolExecutor(jobs)

    # If workers are faster, they do the runs after the first two; with `jobs`, all.
    monkeypatch.setattr("teleop_drake.study.sweep.run.Workers", Workers)
    monkeypatch.setattr("teleop_drake.study.sweep.run._START_OF_WORKERS", 1e-9)
    assert Records() == records and workers == [min(2, os.cpu_count())]
    threads = Sweep("one_dof", grid, overrides=SHORT, engine="auto", jobs=1).records
    assert threads == records and workers[1:] == [1]


def test_the_controllers_are_a_choice():
    """They are the thesis's two, unless options specify the controller."""

    def Axes(*options, scenario="one_dof"):
        args = MakeParser().parse_args(["sweep", scenario, *options])
        return PlanOf(args).axes

    assert Axes("--delay", "0.1") == {"controller": list(CONTROLLERS), "delay": [0.1]}
    assert Axes("--controllers", "direct_force") == {"controller": ["direct_force"]}
    assert Axes("--set", "controller.kind=direct_force") == {}
    assert Axes("--vary", "controller.kind=direct_force") == {
        "controller.kind": ["direct_force"]
    }
    assert Axes(
        *("--vary", "robot.mass=1:2:2", "--seeds", "2", "--forward-delay", "0"),
        *("--set", "return_channel.kind=lte"),
    ) == {
        "controller": list(CONTROLLERS),
        "robot.mass": [1.0, 2.0],
        "forward_delay": [0],
        "seed": [0, 1],
    }
    assert Axes(scenario="network_tracking_linear") == {}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--delay", "0:0.4"], "grid.delay = '0:0.4': must be START:STOP:COUNT or"),
        (["--vary", "robot.mass"], "--vary = 'robot.mass': must be PATH=VALUES"),
        (["--vary", "robot.mass=1", "--vary", "robot.mass=2"], "grid.robot.mass = '2'"),
        (["--delay", "0.1", "--set", "forward_channel.delay=1"], "grid.delay: must"),
        (["--delay", "0.1", "--vary", "delay=0.2"], "grid.delay = '0.1': must be left"),
        (["--seeds", "2", "--vary", "seed=3"], "grid.seed = [0, 1]: must be left out"),
        (
            ["--controllers", "all", "--vary", "controller=direct_force"],
            "grid.controller = 'direct_force': must be left out, because it is varied",
        ),
        (["--delay", "1e-6", "--set", "duration=25"], "duration = 25: must be at most"),
        (["--jobs", "0"], "jobs = 0: must be 1 or more"),
        (["--seeds", "0"], "seeds = 0: must be 1 to"),
        (["--out", "file"], "out = 'file': must be a folder that can be written"),
        (["--json", "no/a.json"], "--json = 'no/a.json': must be"),
    ],
)
def test_bad_input(options, message, capsys):
    Path("file").touch()
    assert main(["sweep", "one_dof", *OPTIONS, *options]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"teleop-drake: error: {message}")
    assert err.count("\n") == 1
    assert os.listdir() == ["file"]


# Figures.


def MakeResult(axes, make_record):
    """Returns a sweep of one_dof with invented records."""
    plan = PlanSweep("one_dof", axes)
    records = [
        {"run": run, "varied": point, "reason": ""} | make_record(**point)
        for run, point in enumerate(plan.points)
    ]
    return TaskSweepResult(scenario=plan.scenario, axes=plan.axes, records=records)


def Outcome(peak, settling_time=1.0, status="completed"):
    collision = {"time": 2.0, "peak_force": peak, "settling_time": settling_time}
    metrics = None if status == "failed" else {"collision": collision}
    return {"status": status, "metrics": metrics}


@pytest.mark.slow
def test_plot_against_delay():
    def MakeRecord(controller, delay):
        if delay == 0.3:
            status = "diverged" if controller == "direct_force" else "failed"
            return Outcome(9.0, None, status)
        return Outcome(0.001 + delay / 100, None if delay == 0.2 else 1.0)

    axes = {"controller": CONTROLLERS, "delay": [0.3, 0.1, 0.2]}
    result = MakeResult(axes, MakeRecord)
    figure = PlotSweep(result, "collision.peak_force")
    (ax,) = figure.axes
    assert ax.get_xlabel() == "delay each way [s]"
    assert ax.get_ylabel() == "collision peak force [mN]"
    lines = [line for line in ax.lines if len(line.get_xdata()) == 3]
    assert len(lines) == 2
    for line in lines:
        assert_allclose(line.get_xdata(), [0.1, 0.2, 0.3])
        assert_allclose(line.get_ydata(), [2.0, 3.0, np.nan])
    marks = {
        line.get_marker(): line.get_xdata().tolist()
        for line in ax.lines
        if line.get_marker() in "x^o" and len(line.get_xdata()) > 0
    }
    assert marks == {"x": [0.3], "^": [0.3]}
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["direct force", "adaptive backstepping", "diverges", "fails"]

    figure = PlotSweep(result, "collision.settling_time")
    marks = [line for line in figure.axes[0].lines if line.get_marker() == "o"]
    assert [line.get_xdata().tolist() for line in marks] == [[0.2], [0.2]]
    # A figure with both metrics has the same panels, and the marks of both.
    sheet = PlotSweep(result, "collision.peak_force", "collision.settling_time")
    assert [ax.get_ylabel() for ax in sheet.axes] == [
        "collision peak force [mN]",
        "collision settling time\n[s]",
    ]
    assert sheet.axes[0].get_ylim() == ax.get_ylim() != sheet.axes[1].get_ylim()
    labels = [text.get_text() for text in sheet.legends[0].get_texts()]
    assert labels[2:] == ["diverges", "fails", "no value"]
    for name in ("a.png", "b.png"):
        SaveFigure(PlotSweep(result, "collision.settling_time"), name)
    assert Path("a.png").read_bytes() == Path("b.png").read_bytes()
    with pytest.raises(ValueError, match="no second key"):
        PlotStability(result)
    with pytest.raises(SweepError, match="metric 'no': must be one of"):
        PlotSweep(result, "no")


def test_bands_over_seeds():
    plan = PlanSweep("one_dof", {"delay": [0.1, 0.2]})
    axes = {**plan.axes, "seed": [0, 1, 2]}
    forces = [[1.0, 5.0, 2.0], [4.0, 3.0, np.nan]]
    records = [
        Outcome(force, 1.0, "diverged" if np.isnan(force) else "completed")
        for row in forces
        for force in row
    ]
    result = TaskSweepResult(scenario=plan.scenario, axes=axes, records=records)
    (ax,) = PlotSweep(result, "collision.peak_force").axes
    (line,) = [
        line
        for line in ax.lines
        if line.get_linestyle() == "-" and line.get_marker() == "."
    ]
    assert_allclose(line.get_ydata(), [2.0, 3.5])
    band, bars = ax.collections
    corners = {tuple(x) for x in band.get_paths()[0].vertices.round(9).tolist()}
    assert corners == {(0.1, 1.1), (0.1, 4.7), (0.2, 3.05), (0.2, 3.95)}
    assert [path.vertices[:, 1].tolist() for path in bars.get_paths()] == [
        [1, 5],
        [3, 4],
    ]
    labels = [text.get_text() for text in ax.figure.legends[0].get_texts()]
    assert labels[-2:] == [
        "5 to 95 % of the seeds",
        "95 % interval of the median (bootstrap)",
    ]


@pytest.mark.slow
def test_more_that_varies():
    axes = {
        "controller": CONTROLLERS,
        "robot.mass": [1.0, 2.0, 3.0],
        "environment.layers.bone.stiffness": [100.0, 200.0],
        "delay": [0.1, 0.2],
    }

    def MakeRecord(controller, delay, **others):
        mass, stiffness = others.values()
        if delay == 0.2 and mass == 3.0:
            return Outcome(1.0, None, "diverged")
        return Outcome(mass * stiffness, None if delay == 0.2 else 1.0)

    result = MakeResult(axes, MakeRecord)
    figure = PlotSweep(result, "collision.peak_force")
    assert [ax.get_title() for ax in figure.axes] == [
        f"{controller.replace('_', ' ')}, robot mass = {mass} kg"
        for mass in (1, 2, 3)
        for controller in CONTROLLERS
    ]
    lines = [x for x in figure.axes[3].lines if x.get_marker() == "."]
    assert [line.get_ydata()[0] for line in lines] == [0.2, 0.4]  # kN

    sheet = PlotSweep(result, "collision.settling_time", "collision.peak_force")
    assert len(sheet.axes) == 12
    for own, ax in zip(figure.axes, sheet.axes[6:], strict=True):
        assert own.get_title() == ax.get_title()
        assert own.get_ylim() == pytest.approx(ax.get_ylim())

    figure = PlotStability(result)
    assert len(figure.axes) == 6
    assert figure.axes[0].get_ylabel() == "bone stiffness [N/m]"
    # The cells of each panel: a row for each stiffness, a column for each delay.
    cells = [ax.collections[0].get_array().tolist() for ax in figure.axes]
    assert cells == [[[1, 2], [1, 2]]] * 4 + [[[1, 3], [1, 3]]] * 2
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["settles", "not at rest within the run", "diverges"]

    with pytest.raises(ValueError, match="needs 15 x 2 panels"):
        PlotStability(
            MakeResult(
                axes | {"robot.mass": list(range(1, 16))},
                lambda **point: Outcome(1.0),
            )
        )


@pytest.mark.slow
def test_words_that_look_like_a_formula(tmp_path):
    """Matplotlib would parse a text between dollar signs as a formula."""
    value = r"$\frac{$ a $b^$ c"
    texts = {"source": [value, "else"], "description": [value, "other"]}
    result = MakeResult({"delay": [1, 2], **texts}, lambda **point: Outcome(1.0))
    SaveFigure(PlotSweep(result, "collision.peak_force"), tmp_path / "a.png")
    SaveFigure(PlotStability(result), tmp_path / "b.png")


def test_words_instead_of_numbers():
    axes = {"controller.initial_psi": ["auto", 4.3], "delay": [0.1, 0.2]}
    result = MakeResult(axes, lambda **point: Outcome(1.0))
    (ax,) = PlotStability(result).axes
    assert [label.get_text() for label in ax.get_yticklabels()] == ["auto", "4.3"]
    del axes["delay"]
    result = MakeResult(axes, lambda **point: Outcome(1.0))
    with pytest.raises(ValueError, match="no key with numbers"):
        PlotSweep(result, "collision.peak_force")

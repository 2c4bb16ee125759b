"""Tests of what the commands print, and of the files of signals."""

import csv
import json
import re
import webbrowser
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from teleop_drake import simulate
from teleop_drake.cli import main

pytestmark = pytest.mark.usefixtures("in_an_empty_folder", "unrendered")

SHORT = ("--duration", "0.3", "--quiet")
SOLVER = ("engine", "steps", "derivative evaluations", "wall time s")


def Printed(capsys, *arguments):
    assert main(list(arguments)) == 0
    return capsys.readouterr().out.splitlines()


@pytest.mark.slow
@pytest.mark.parametrize("command", ["run", "compare"])
def test_what_the_solver_did_is_printed_if_asked_for(command, capsys):
    plain = Printed(capsys, command, "one_dof", *SHORT)
    verbose = Printed(capsys, command, "one_dof", *SHORT, "--verbose")
    first = [re.split(r"\s{2,}", line)[0] for line in verbose]
    assert set(SOLVER) <= set(first)
    assert not any(line.startswith(SOLVER) for line in plain)


@pytest.mark.slow
def test_more_than_three_runs_have_a_row_each(capsys):
    kinds = ["direct_force", "damped_force", "wave_variables", "four_channel"]
    names = ",".join(kinds)
    lines = Printed(capsys, "compare", "one_dof", *SHORT, "--controllers", names)
    rows = [line.split() for line in lines[-5:-1]]
    assert [row[0] for row in rows] == kinds
    assert {row[-1] for row in rows} == {"completed"}
    assert max(map(len, lines[:-1])) < 140
    # One of them, by itself.
    record = json.loads(
        "\n".join(
            Printed(
                capsys,
                *("run", "one_dof", *SHORT, "--json", "-"),
                *("--controller", "direct_force"),
            )
        )
    )
    overshoot = record["metrics"]["start_velocity_overshoot"]
    assert float(rows[0][1]) == pytest.approx(overshoot, rel=1e-3)
    three = Printed(
        capsys, "compare", "one_dof", *SHORT, "--controllers", ",".join(kinds[:3])
    )
    assert sum(line.startswith("one_dof, ") for line in three) == 3


@pytest.mark.slow
def test_a_sweep_prints_its_runs(capsys, in_this_process):
    lines = Printed(
        capsys, "sweep", "one_dof", *SHORT, "--delay", "0.05,0.1", "--jobs", "1"
    )
    rows = [line.split() for line in lines if line.endswith("completed")]
    keys = [(row[0], row[1]) for row in rows if row[0] != "one_dof:"]
    kinds = ("direct", "adaptive")
    assert len(keys) == 4
    assert [key[0] for key in keys] == [kinds[0]] * 2 + [kinds[1]] * 2


@pytest.mark.slow
def test_a_long_table_of_a_sweep_ends_with_the_file(capsys, in_this_process):
    lines = Printed(
        capsys,
        *("sweep", "one_dof", *SHORT, "--delay", "0.05:0.1:21", "--jobs", "1"),
    )
    assert "... 2 more are in runs.csv" in lines
    assert sum(line.endswith("completed") for line in lines) == 40


def test_signals_are_written_as_a_table(capsys):
    Printed(capsys, "run", "one_dof", *SHORT, "--csv", "run.csv")
    with open("run.csv", newline="") as file:
        head = next(csv.reader(file))
    assert head[0] == "time_s" and "tool_velocity[0]" in head
    table = np.genfromtxt("run.csv", delimiter=",", skip_header=1)
    recording = simulate("one_dof", duration=0.3)
    assert_allclose(table[:, 0], recording.time, rtol=1e-9)
    column = head.index("tool_velocity[0]")
    velocity = recording["tool_velocity"][:, 0]
    assert_allclose(table[:, column], velocity, rtol=1e-8, atol=1e-12)


def test_a_table_that_cannot_be_written_is_refused_before_the_run(capsys):
    assert main(["run", "one_dof", "--csv", "no/run.csv"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--csv = 'no/run.csv': must be where 'run.csv' can be written" in line


@pytest.mark.slow
def test_a_page_without_a_name_is_opened(monkeypatch, capsys):
    opened = []
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(url) or True)
    lines = Printed(capsys, "page", "one_dof", "--controllers", "direct_force")
    path = opened.pop().removeprefix("file://")
    assert lines == [f"Opened: {path}"]
    assert "<title>" in Path(path).read_text("utf-8")


def test_what_ping_measured_is_halved_and_said(capsys):
    lines = [
        f"64 bytes from 192.0.2.1: icmp_seq={k} ttl=56 time={40 + k} ms"
        for k in range(3)
    ]
    Path("ping.txt").write_text("\n".join(lines))
    line, *_ = Printed(capsys, "run", "one_dof", *SHORT, "--channel", "ping.txt")
    assert "delay 0 s and ping.txt (half of its round trips) forward" in line
    Path("own.csv").write_text("time_s,delay_s\n0,0.02\n1,0.02\n")
    line, *_ = Printed(capsys, "run", "one_dof", *SHORT, "--channel", "own.csv")
    assert "halves" not in line and "half" not in line


def test_a_trace_that_is_not_there(capsys):
    assert main(["run", "one_dof", "--channel", "trace.csv"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(
        "'trace.csv': must be a YAML file, a trace or a kind (no such file)"
    )

"""Tests of the command `teleop-drake latency`."""

import json

import numpy as np
import pytest
import yaml
from runs import Run

from teleop_drake.cli import main
from teleop_drake.study.analysis.latency import EstimateLatency

pytestmark = pytest.mark.usefixtures("in_an_empty_folder")

TIME = np.arange(400) * 0.02
DELAY = 0.1537


def Signal(times):
    """Returns a sum of sines that are not commensurate, at times in s."""
    times = np.asarray(times)
    return np.sin(0.9 * times) + np.sin(2.3 * times + 1) + 0.5 * np.sin(5.9 * times + 3)


def WriteRecord(path, *, header="time_s,sent,received", response=None, time=TIME):
    response = Signal(TIME - DELAY) if response is None else response
    rows = zip(time, Signal(TIME), response, strict=True)
    lines = [",".join(f"{x:.9g}" for x in row) for row in rows]
    path.write_text("\n".join([header, *lines]) + "\n")


def Latency(capsys, *options, code=0):
    columns = ["--command", "sent", "--response", "received"]
    assert main(["latency", "record.csv", *columns, *options]) == code
    return capsys.readouterr().out


def test_prints_the_dead_time(tmp_path, capsys):
    WriteRecord(tmp_path / "record.csv")
    out = Latency(capsys, "--lag", "first", "--json", "a.json")
    assert "400 rows in 7.98 s" in out
    assert "Dead time 153.7 ms" in out
    record = json.loads((tmp_path / "a.json").read_text())
    assert record["delay"] == pytest.approx(DELAY, abs=1e-4)
    low, high = record["interval"]
    assert low <= DELAY <= high
    (row,) = [line for line in out.splitlines() if line.endswith("chosen")]
    assert row.split()[:2] == ["none", "153.7"]


def test_trace_is_a_channel(tmp_path, capsys):
    drifting = DELAY + 0.004 * (TIME - 4)
    WriteRecord(tmp_path / "record.csv", response=Signal(TIME - drifting))
    out = Latency(capsys, "--lag", "none", "--out", "t.csv", "--figure", "a.svg")
    assert "Written: t.csv, a.svg" in out
    assert "dead time" in (tmp_path / "a.svg").read_text()
    assert main(["show", "one_dof", "--channel", "t.csv"]) == 0
    channel = yaml.safe_load(capsys.readouterr().out)["forward_channel"]
    assert (channel["kind"], channel["trace"]) == ("network", "t.csv")
    times, delays = np.loadtxt("t.csv", delimiter=",", skiprows=1, unpack=True)
    arrived = (times + delays)[1:]
    expected = np.interp(arrived, TIME, drifting)
    assert delays[1:] == pytest.approx(expected, abs=1e-3)


def test_what_cannot_be_told_fails(tmp_path, capsys):
    WriteRecord(tmp_path / "record.csv", response=np.cos(77 * TIME**2))
    out = Latency(capsys, "--lag", "none", "--out", "t.csv", "--json", "-", code=1)
    record = json.loads(out)
    assert record["delay"] is None
    assert record["reason"] == "the response does not follow the command"
    assert not (tmp_path / "t.csv").exists()
    assert "cannot tell the dead time" in Latency(capsys, "--lag", "none", code=1)


def test_stamps_and_units_are_those_of_the_reader(tmp_path, capsys):
    stamps = 1.7e9 + TIME
    signals = zip(stamps, Signal(TIME), Signal(TIME - DELAY), strict=True)
    rows = [f"{stamp:.3f},{u},{y}" for stamp, u, y in signals]
    (tmp_path / "record.csv").write_text("\n".join(["stamp,sent,received", *rows]))
    assert "Dead time 153.7 ms" in Latency(capsys, "--lag", "none")
    WriteRecord(tmp_path / "record.csv", header="time,sent,received", time=1e3 * TIME)
    out = Latency(capsys, "--lag", "none", "--time-unit", "ms")
    assert "Dead time 153.7 ms" in out


BAD = [
    (["--command", "x"], "column 'x': must be one of time_s, sent, received"),
    (["--time", "4"], "column '4': must be one of"),
    (["--lag", "third"], "lag = 'third': must be one of none, first, second"),
    (["--maximum", "100"], "maximum = 100.0: must be a finite number > 0 and <= 3.99"),
    (["--figure", "a.txt"], "--figure = 'a.txt': must end in .png or .svg or .pdf"),
    (["--out", "no/t.csv"], "--out = 'no/t.csv'"),
]


@pytest.mark.parametrize(("options", "message"), BAD)
def test_bad_input(options, message, tmp_path, capsys):
    WriteRecord(tmp_path / "record.csv")
    columns = ["--command", "sent", "--response", "received"]
    assert main(["latency", "record.csv", *columns, *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


def test_a_time_without_a_unit_is_asked_for(tmp_path, capsys):
    WriteRecord(tmp_path / "record.csv", header="time,sent,received")
    columns = ["--command", "2", "--response", "3"]
    assert main(["latency", "record.csv", *columns]) == 2
    assert "--time-unit s" in capsys.readouterr().err
    WriteRecord(tmp_path / "record.csv", header="a,sent,received")
    assert main(["latency", "record.csv", *columns]) == 2
    assert "name it, for example --time 'a'" in capsys.readouterr().err


RUNS = {
    "transport": (["delay=0.123"], 0.123),
    # Held for 4 ms, a packet is 2 ms older on average.
    "sampled": (["delay=0.12", "kind=sampled", "sample_period=0.004"], 0.122),
}


@pytest.mark.parametrize("name", RUNS)
def test_a_run_whose_delay_is_known(name):
    """The operator's command arrives at the robot after the channel's delay."""
    fields, delay = RUNS[name]
    overrides = [f"forward_channel.{x}" for x in reversed(fields)]
    run = Run("one_dof", "direct_force", "duration=6", *overrides)
    times = np.arange(0, 6, 0.01)
    sent = run.Interpolate("forward_packet_sent", times)[:, 0]
    received = run.Interpolate("forward_packet_received", times)[:, 0]
    latency = EstimateLatency(times, sent, received, lag="none", maximum=1.0)
    assert latency.delay == pytest.approx(delay, abs=1e-3), latency.reason

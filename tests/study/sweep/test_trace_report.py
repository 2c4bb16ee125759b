"""Tests of teleop_drake.study.sweep.trace_report and of its figure and command."""

import json
import math

import numpy as np
import pytest

from teleop_drake.cli import main
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.channels.network import NetworkChannelConfig
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tables.packets import Packets
from teleop_drake.study.analysis.stability import AnalyzeStability
from teleop_drake.study.figures.trace_report import PlotTraceReport
from teleop_drake.study.sweep.trace_report import (
    AgeQuantile,
    DescribeDelays,
    ReportTrace,
)

pytestmark = [
    pytest.mark.usefixtures("in_an_empty_folder"),
    pytest.mark.xdist_group("trace report"),
]

SHORT = ["duration=0.4"]


def Measured(delays, *, step=0.02, kind="one way"):
    times = np.arange(len(delays)) * step
    return Packets(times=times, delays=np.array(delays), kind=kind, clock="seconds")


def Write(path, delays, step=0.02):
    rows = [
        f"{k * step:.3f},{'lost' if math.isnan(x) else f'{1e3 * x:.4f}'}"
        for k, x in enumerate(delays)
    ]
    path.write_text("\n".join(["time_s,delay_ms", *rows]) + "\n")
    return str(path)


def test_statistics_of_delays():
    draw = np.random.default_rng(1)
    delays = 0.05 + draw.exponential(0.01, 5000)
    delays[draw.random(5000) < 0.1] = np.nan
    found = DescribeDelays(Measured(delays, kind="from sent to received"))
    # Quantiles of an exponential distribution: -log(1 - p).
    for percent in (50.0, 90.0, 99.0):
        expected = 0.05 - 0.01 * math.log(1 - percent / 100)
        assert found.quantiles[percent] == pytest.approx(expected, rel=0.05)
    assert found.lost == np.isnan(delays).sum()
    assert found.bursts.mean() == pytest.approx(1 / 0.9, rel=0.05)
    assert found.correlation_time == pytest.approx(0.02)
    assert abs(found.drift) < 4 * found.drift_error
    assert found.has_two_clocks


def test_statistics_of_equal_delays():
    found = DescribeDelays(Measured([0.05] * 100))
    assert found.correlation_time is None
    assert found.drift == 0
    assert found.bursts.size == 0


def test_one_delay_is_not_enough():
    with pytest.raises(ScenarioError, match="must have two delays"):
        DescribeDelays(Measured([0.05, np.nan, np.nan]))


AGES = {
    # What is used is d to d + h old, evenly.
    "no loss": ([0.05] * 300, 0.05 + 0.999 * 0.01),
    # The age goes from d to d + 2 h.
    "every other lost": ([0.05, np.nan] * 150, 0.05 + 0.999 * 0.02),
}


@pytest.mark.parametrize("name", AGES)
def test_age_of_what_is_used(name, tmp_path):
    delays, age = AGES[name]
    trace = Write(tmp_path / "t.csv", delays, step=0.01)
    channel = NetworkChannelConfig(delay=0.0, sample_period=0.01, trace=trace)
    assert AgeQuantile(channel, 2.0) == pytest.approx(age, abs=1e-4)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    draw = np.random.default_rng(2)
    delays = 0.03 + draw.exponential(0.01, 400)
    delays[draw.random(400) < 0.05] = np.nan
    trace = Write(tmp_path_factory.mktemp("trace") / "t.csv", delays)
    controllers = ["direct_force", "wave_variables"]
    return ReportTrace(trace, "one_dof", controllers, overrides=SHORT, jobs=1)


@pytest.mark.slow
def test_margins_are_those_of_the_analysis(report):
    direct, waves = report.loops
    overrides = {"delay": report.age, "controller": "direct_force", "duration": 0.4}
    analysis = AnalyzeStability(LoadScenario("one_dof", overrides))
    margins = [x.margin.delay for x in analysis.Loops() if x.margin]
    assert direct.margin == pytest.approx(min(margins))
    assert waves.margin == math.inf


@pytest.mark.slow
def test_runs_are_those_of_each_policy(report):
    loop = report.loops[0]
    assert list(loop.outcomes) == ["newest", "playout", "extrapolate"]
    errors = {k: x.velocity_error for k, x in loop.outcomes.items()}
    assert len(set(errors.values())) == 3
    assert errors[loop.best_policy] == min(errors.values())


def test_a_run_that_fails_has_a_reason(report):
    """Waves over packets that overtake each other need a bound of the slope."""
    outcomes = report.loops[1].outcomes.values()
    assert {x.termination for x in outcomes} == {"failed"}
    assert all("max_slope" in x.reason for x in outcomes)
    assert report.loops[1].best_policy is None


def test_record_and_picture(report):
    record = report.ToRecord()
    json.dumps(record, allow_nan=False)
    assert record["loops"][0]["best_policy"] == report.loops[0].best_policy
    figure = PlotTraceReport(report)
    delays, exceeded, _, bursts, margins, runs = figure.axes
    arrived = np.sum(~np.isnan(report.packets.delays))
    assert len(delays.lines[0].get_xdata()) == arrived
    steps = exceeded.lines[0]
    share = np.interp(1e3 * report.delays.quantiles[90.0], *steps.get_data())
    assert share == pytest.approx(10, abs=0.5)
    heights = [bar.get_height() for bar in bursts.patches]
    assert sum(heights) == len(report.delays.bursts)
    assert margins.patches[0].get_width() == pytest.approx(report.loops[0].margin)
    points = [line.get_xdata()[0] for line in runs.lines]
    errors = [x.velocity_error for x in report.loops[0].outcomes.values()]
    assert points == pytest.approx([1e3 * x for x in errors])


@pytest.mark.slow
def test_command(tmp_path, capsys):
    Write(tmp_path / "t.csv", [0.03, 0.05, np.nan, 0.04] * 30)
    main(["show", "one_dof", "--duration", "0.3"])
    (tmp_path / "short.yaml").write_text(capsys.readouterr().out)
    options = ["--trace", "t.csv", "--scenario", "short.yaml", "--quiet"]
    options += ["--controllers", "direct_force", "--json", "a.json"]
    assert main(["latency", *options, "--figure", "a.svg"]) == 0
    out = capsys.readouterr().out
    assert "120 packets in 2.38 s, 30 lost" in out
    assert "Lost: 25 % of packets in 30 bursts, of 1 packets on average" in out
    record = json.loads((tmp_path / "a.json").read_text())
    (loop,) = record["loops"]
    assert f"policy {loop['best_policy']}" in out
    is_short = loop["margin"] <= record["round_trip"]
    assert ("shorter than the round trip: direct_force" in out) == is_short
    assert (tmp_path / "a.svg").exists()


BAD = [
    (
        ["--trace", "t.csv", "--lag", "none"],
        "--lag = 'none': must be left out with --tr",
    ),
    (["t.csv", "--scenario", "one_dof"], "--scenario = 'one_dof': must be left out wi"),
    (["t.csv", "--command", "1"], "--response: must name a column of t.csv"),
    (["t.csv", "--trace", "t.csv"], "not allowed with argument"),
    ([], "one of the arguments FILE --trace is required"),
    (["--trace", "none.csv"], "--trace = 'none.csv'"),
    (["--trace", "t.csv", "--controllers", "x"], "controller.kind = 'x'"),
    (["--trace", "t.csv", "--sample-period", "0"], "sample_period = 0.0: must be"),
    (["--trace", "t.csv", "--scenario", "network_tracking_linear"], "channel"),
]


@pytest.mark.parametrize(("options", "message"), BAD)
def test_bad_input(options, message, tmp_path, capsys):
    Write(tmp_path / "t.csv", [0.03, 0.05])
    assert main(["latency", *options, "--quiet"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line

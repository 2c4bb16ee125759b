"""Tests of statistics over the seeds of a sweep."""

import csv
import io
import json
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from teleop_drake.cli import main
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.study.figures.sweeps import PlotSweep
from teleop_drake.study.sweep import (
    Differences,
    Statistics,
    SweepError,
    TaskSweepResult,
    VariesSeedsOnly,
)
from teleop_drake.study.sweep.statistics import MedianInterval, ShareInterval

NUM_SEEDS = 40
METRIC = "collision.peak_force"


def Result(num_diverged=4, **other_axes):
    """Returns a sweep whose second controller has 1 N more than the first per seed."""
    rng = np.random.default_rng(1)
    noise = rng.normal(size=NUM_SEEDS)
    axes = {"controller": ["a", "b"], **other_axes, "seed": list(range(NUM_SEEDS))}
    records = []
    for shift in (5.0, 6.0):
        for seed in range(NUM_SEEDS):
            diverges = shift == 6.0 and seed < num_diverged
            collision = {"peak_force": shift + noise[seed], "settling_time": 1.0}
            records.append(
                {
                    "status": "diverged" if diverges else "completed",
                    "metrics": {"collision": collision},
                }
            )
    return TaskSweepResult(scenario=LoadScenario("one_dof"), axes=axes, records=records)


def Row(rows, **wanted):
    (row,) = [row for row in rows if wanted.items() <= row.items()]
    return row


def test_wilson_interval_by_hand():
    """Wilson 1927: the roots of (p - k/n)^2 = z^2 p (1 - p) / n."""
    k = 4
    n = 40
    z = 1.959963984540054
    low, high = ShareInterval(k, n)
    for p in (low, high):
        assert (p - k / n) ** 2 == pytest.approx(z**2 * p * (1 - p) / n, rel=1e-9)
    assert 0 < low < k / n < high
    assert ShareInterval(0, n)[0] == 0 < ShareInterval(0, n)[1]


def test_the_interval_of_a_median_is_the_same_each_time():
    values = np.random.default_rng(0).normal(size=20)
    low, high = MedianInterval(values)
    assert low < np.median(values) < high
    assert MedianInterval(values) == (low, high)
    assert all(map(math.isnan, MedianInterval(np.array([1.0]))))


def test_statistics():
    result = Result()
    rows = Statistics(result)
    share = Row(rows, controller="b", metric="diverged")
    assert (share["runs"], share["count"], share["value"]) == (40, 4, 0.1)
    assert (share["low"], share["high"]) == ShareInterval(4, 40)
    settles = Row(rows, controller="b", metric="collision.settles")
    assert settles["value"] == 0.9  # A run that ends early does not settle.
    values = result.Values(METRIC)
    row = Row(rows, controller="b", metric=METRIC)
    assert row["count"] == 36 and row["unit"] == "N"
    assert row["value"] == np.median(values[1, 4:])
    assert [row["p5"], row["p95"]] == list(np.quantile(values[1, 4:], [0.05, 0.95]))
    assert row["low"] < row["value"] < row["high"]


def test_differences_are_taken_seed_by_seed():
    rows = Differences(Result())
    row = Row(rows, controller="b", metric=METRIC)
    assert (row["baseline"], row["count"], row["runs"]) == ("a", 36, 40)
    for key in ("value", "low", "high"):  # The noise, which is equal for both, cancels.
        assert row[key] == pytest.approx(1.0, abs=1e-9)
    without = TaskSweepResult(
        scenario=LoadScenario("one_dof"), axes={"delay": [0.1]}, records=[]
    )
    with pytest.raises(SweepError, match="with the key seed"):
        Statistics(without)


def test_figure_without_any_other_key():
    result = Result()
    assert VariesSeedsOnly(result)
    (ax,) = PlotSweep(result, METRIC).axes
    labels = [label.get_text() for label in ax.get_xticklabels()]
    assert labels == ["a", "b"]
    (marks,) = [line for line in ax.lines if line.get_marker() == "x"]
    assert marks.get_xdata().tolist() == [1.0]  # Some of its runs diverge.
    middle, *runs = [line.get_ydata() for line in ax.lines if line.get_marker() == "."]
    values = result.Values(METRIC)
    values[1, :4] = np.nan
    assert_allclose(np.transpose(runs), values)
    assert_allclose(middle, np.nanmedian(values, axis=1))
    assert not VariesSeedsOnly(Result(delay=[0.1, 0.2]))


def Csv(path):
    return list(csv.DictReader(io.StringIO(Path(path).read_text("utf-8"))))


NETWORK = (
    "{kind: network, delay: 0.02, sample_period: 0.005, "
    "jitter: {kind: uniform, std: 0.004}}"
)


@pytest.mark.slow
def test_the_commands(tmp_path, monkeypatch, capsys, in_this_process, unrendered):
    """Seeds work with a single random channel, in `sweep` and in `compare`."""
    monkeypatch.chdir(tmp_path)
    channel = ["--set", f"forward_channel={NETWORK}", "--duration", "0.4", "--quiet"]
    channel += ["--engine", "auto"]
    seeds = ["--seeds", "3"]
    sweep = ["sweep", "one_dof", *channel, *seeds, "--jobs", "1"]
    assert main(sweep) == 0
    out = capsys.readouterr().out
    assert "Medians over 3 seeds" in out and "No figures" not in out
    rows = Csv("out/statistics.csv")
    row = Row(rows, controller="direct_force", metric="velocity_rms_error.x")
    errors = [
        float(run["velocity_rms_error.x"])
        for run in Csv("out/runs.csv")
        if run["controller"] == "direct_force"
    ]
    assert float(row["value"]) == np.median(errors) and len(set(errors)) == 3
    assert Path("out/metrics.png").exists()
    assert Path("out/differences.csv").exists()

    arguments = ["compare", "one_dof", *channel, *seeds, "--out", "of", "--json", "-"]
    assert main(arguments) == 0
    records = json.loads(capsys.readouterr().out)
    assert [record["varied"]["seed"] for record in records] == [0, 1, 2] * 2
    assert Path("of/one_dof_seeds.png").exists()
    assert len(Csv("of/one_dof_seeds_runs.csv")) == 6
    assert Path("of/one_dof_seeds_differences.csv").exists()

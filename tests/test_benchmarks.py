"""The benchmarks measure what they say. No test asserts a time."""

import importlib
import math

import pytest
from benchmarks import accuracy
from benchmarks.channel_oracle import ChannelOracle
from benchmarks.contenders import CONTENDERS, PEER
from benchmarks.measuring import Options
from grids import Slow

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import CONTROLLERS, LoadScenario

ADAPTIVE = "adaptive_backstepping"
QUICK = Options(quick=True)


@pytest.fixture(autouse=True)
def _WithoutCollecting(monkeypatch):
    """Before each measurement would come a second of what other tests have left."""
    monkeypatch.setattr("benchmarks.measuring.gc.collect", lambda: 0)


@pytest.mark.parametrize(
    "name",
    Slow(
        [
            "evaluation",
            "bars",
            "in_drake",
            "comparison",
            "delays",
            "delay_problems",
            "state_delays",
        ]
    ),
)
def test_quick_tables_have_finite_numbers(name):
    tables = list(importlib.import_module(f"benchmarks.{name}").Measure(QUICK))
    assert tables
    for table in tables:
        cells = [cell for row in table.rows for cell in row.values()]
        numbers = [cell for cell in cells if isinstance(cell, (int, float))]
        assert len(numbers) > 3, table.title
        assert all(map(math.isfinite, numbers)), table.title
        assert table.Markdown().count("\n|") == len(table.rows) + 2
        assert all(row.get("largest error", 0) < 1e-2 for row in table.rows)


@pytest.mark.slow
def test_the_table_of_the_delay_standard_has_a_verdict_in_each_cell():
    (table,) = importlib.import_module("benchmarks.delay_standard.table").Measure(QUICK)
    assert len(table.rows) == 4
    for row in table.rows:
        assert all(
            cell.startswith(("inside", "outside")) for cell in list(row.values())[1:]
        )


@pytest.mark.slow  # A benchmark's contender; channels/ has the delays.
@pytest.mark.parametrize("task", ["one_dof", "two_dof_combined"])
def test_sampled_delays_are_about_right(task):
    arguments = (task, ADAPTIVE, 0.1, 1.0)
    solution = CONTENDERS["1 kHz DiscreteTimeDelay"](*arguments)
    error = accuracy.LargestError(accuracy.Oracle(*arguments), solution)
    # Half a millisecond of mean delay too much: wrong, but not by much.
    assert 1e-4 < error < 1e-2


# Both ways; the delay is the thesis's 0.1 s.
CHANNELS: dict[str, dict] = {
    "variable": {"sinusoid": {"amplitude": 0.03, "frequency": 2.0, "phase": 0.0}},
    "sampled": {"sample_period": 0.01},
    "network": {
        "sample_period": 0.01,
        "jitter": {"kind": "gamma", "std": 0.02, "minimum": 0.05},
        "loss": {"kind": "independent", "probability": 0.05},
        "seed": 1,
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", Slow(list(CHANNELS)))
@pytest.mark.parametrize("controller", Slow(CONTROLLERS, but=[1]))
def test_channels_agree_with_their_oracle(controller, kind):
    # Long enough for the puncture, the contact and the operator's switch.
    channel = {"kind": kind, "delay": 0.1, **CHANNELS[kind]}
    changes = {"controller.kind": controller, "duration": 2.8}
    changes |= {f"{way}_channel": channel for way in ("forward", "return")}
    scenario = LoadScenario("two_dof_combined", changes)
    oracle = ChannelOracle(scenario)
    assert len(oracle.jumps) >= 2
    assert math.isfinite(oracle.perceived)
    recording = simulate(scenario, engine="compiled")
    signals = {name: recording[name] for name in accuracy.SIGNALS}
    if kind != "variable" and controller == "direct_force":
        del signals["control_force"]
    errors = accuracy.Errors(oracle, recording.time, signals)
    assert max(errors.values()) < 1e-4


@pytest.mark.slow  # JiTCDDE compiles for a minute.
def test_the_peer_solves_the_same_model():
    pytest.importorskip("jitcdde")
    arguments = ("one_dof", ADAPTIVE, 0.1, 0.5)
    solution = CONTENDERS[PEER](*arguments)
    assert accuracy.LargestError(accuracy.Oracle(*arguments), solution) < 1e-2

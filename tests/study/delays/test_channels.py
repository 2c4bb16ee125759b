"""Tests of network and variable channels, from the scenario to the recording."""

import dataclasses
import math

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose
from runs import Run

from teleop_drake import simulate
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Jitter, Loss
from teleop_drake.model.scenario import (
    LoadScenario,
    ScenarioError,
    ScenarioFromYaml,
    ScenarioToYaml,
)
from teleop_drake.model.task_recording import LoadRecording
from teleop_drake.model.tasks.metrics import RunSummary
from teleop_drake.study.sweep import MetricUnits

WAYS = ("forward", "return")
H = 0.02
JITTER = "jitter: {kind: gamma, std: 0.02, minimum: 0.05}"
LOSS = "loss: {kind: burst, probability: 0.1, burst_length: 3}"


def channels(text, *ways):
    return [f"{way}_channel={{delay: 0.1, {text}}}" for way in ways or WAYS]


def network(text="", h=H):
    return channels(f"kind: network, sample_period: {h}, {text}".rstrip(", "))


def run(*overrides, duration=1.0):
    overrides = (f"duration={duration}", *overrides)
    return Run("two_dof_collision", "direct_force", *overrides)


def test_arrivals_have_both_sides():
    recording = run(*network(f"{JITTER}, {LOSS}, seed: 3"))
    for way in WAYS:
        received = recording[f"{way}_packet_received"]
        changes = np.any(np.diff(received, axis=0) != 0, axis=1)
        # A held packet is replaced at an instant only.
        assert np.all(np.diff(recording.time)[changes] == 0)
        config = recording.scenario.forward_channel
        arrivals = PacketNetwork(
            profile=config.Profile(1.0),
            sample_period=H,
            jitter=Jitter(kind="gamma", std=0.02, minimum=0.05),
            loss=Loss(kind="burst", probability=0.1, burst_length=3),
            seed=3,
            stream=f"{way}_channel",
        ).Arrivals(50)
        newest = [
            a for k, a in enumerate(arrivals) if a < min(arrivals[k + 1 :], default=9)
        ]
        expected = [a for a in newest if a < 1.0]
        assert set(recording.time[:-1][changes]) <= set(expected)
        assert len(expected) > 20
        assert set(expected) <= set(recording.time)


def test_statistics_are_recorded_for_each_direction(tmp_path):
    recording = run(*network(f"{JITTER}, {LOSS}, seed: 3"))
    assert set(recording.channels) == {"forward_channel", "return_channel"}
    forward, back = (recording.channels[f"{way}_channel"] for way in WAYS)
    assert forward != back
    assert forward.sent == back.sent == 50
    received = recording["forward_packet_received"]
    num_changes = np.sum(np.any(np.diff(received, axis=0) != 0, axis=1))
    assert num_changes == forward.received - forward.reordered
    recording.Save(tmp_path / "run.npz")
    assert LoadRecording(tmp_path / "run.npz").channels == recording.channels
    summary = RunSummary(recording)["channels"]
    assert summary == {
        "forward_channel": dataclasses.asdict(forward),
        "return_channel": dataclasses.asdict(back),
    }
    units = MetricUnits(recording.scenario)
    assert {f"forward_channel.{name}" for name in dataclasses.asdict(back)} < set(units)


@pytest.mark.mostly_slow
@pytest.mark.parametrize("engine", ["drake", "compiled"])
def test_packets_are_counted_until_a_run_ends_early(engine):
    scenario = LoadScenario(
        "one_dof",
        ["controller=direct_force", "divergence_speed_ratio=2", *network(h=0.01)],
    )
    scenario.forward_channel.delay = scenario.return_channel.delay = 0.4
    recording = simulate(scenario, engine=engine)
    assert recording.termination == "diverged"
    sent = math.ceil(recording.time[-1] / 0.01)
    assert recording.channels["forward_channel"].sent == sent < 200


def test_other_channels_have_no_statistics():
    recording = run(*channels("kind: transport"))
    assert recording.channels == {} and "channels" not in RunSummary(recording)
    assert not [x for x in MetricUnits(recording.scenario) if "channel" in x]


# Traces.


def write_trace(path, num_rows=21, spacing=0.1):
    rows = [f"{1e6 + i * spacing},{0.05 + 0.01 * math.sin(i)}" for i in range(num_rows)]
    path.write_text("time_s,delay_s\n# measured\n\n" + "\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("kind", ["variable", "network"])
def test_trace_of_a_file_beside_the_scenario(kind, tmp_path):
    write_trace(tmp_path / "trace.csv")
    scenario = LoadScenario("one_dof", ["duration=0.5", "controller.kind=direct_force"])
    tree = yaml.safe_load(ScenarioToYaml(scenario))
    tree["return_channel"] = {
        "kind": kind,
        "delay": 0.0,
        "sample_period": 0.02 if kind == "network" else None,
        "trace": "trace.csv",
    }
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(tree))
    scenario = LoadScenario(path, ["simulator.max_step_size=0.01"])
    recording = simulate(scenario)
    t = np.array([0.23, 0.31, 0.4444])
    times = np.arange(21) * 0.1
    values = 0.05 + 0.01 * np.sin(np.arange(21))
    if kind == "variable":
        origin = t - np.interp(t, times, values)
    else:
        k = np.arange(25) * 0.02
        arrivals = k + np.interp(k, times, values)
        origin = [k[arrivals <= time].max() for time in t]
    assert_allclose(
        recording.Interpolate("return_packet_received", t),
        recording.Interpolate("return_packet_sent", np.asarray(origin)),
        atol=1e-10,
    )
    # A recording can be read where the trace is not.
    recording.Save(tmp_path / "run.npz")
    (tmp_path / "trace.csv").unlink()
    assert LoadRecording(tmp_path / "run.npz").scenario == scenario
    with pytest.raises(ScenarioError, match="must be readable"):
        scenario.Validate()


# Scenarios.


def test_round_trip():
    scenario = LoadScenario("one_dof", network(f"{JITTER}, {LOSS}, seed: 3"))
    text = ScenarioToYaml(scenario)
    assert ScenarioFromYaml(text) == scenario
    assert scenario.forward_channel.jitter == Jitter(
        kind="gamma", std=0.02, minimum=0.05
    )
    assert scenario.return_channel.seed == 3
    assert type(scenario.return_channel.seed) is int


BAD = {
    "kind: network": "sample_period = null: must be a finite number >= 1e-06",
    "kind: variable, sample_period: 0.1": "sample_period = 0.1: must be null",
    "seed: 0.5": "seed = 0.5: must be a whole number",
    "jitter: {kind: uniform}": "jitter.kind = 'uniform': must be 'none' for the tra",
    "trace: x.csv": "trace = 'x.csv': must be null for the transport channel",
    "kind: variable, receiver: {depth: 1}": "receiver.depth = 1.0: must be 0.0 for",
    "kind: sampled, sample_period: 0.01, sinusoid: {amplitude: 0.1}":
        "sinusoid.amplitude = 0.1: must be 0.0 for the sampled channel",
    "kind: network, sample_period: 0.01, receiver: {depht: 1}":
        "receiver.depht = 1: unknown key 'depht'",
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), BAD.items())
def test_bad_channels(text, message):
    delay = "" if "delay:" in text else "delay: 0.1, "
    with pytest.raises(ScenarioError) as e:
        LoadScenario("one_dof", [f"forward_channel={{{delay}{text}}}"])
    assert str(e.value).startswith(f"forward_channel.{message}")

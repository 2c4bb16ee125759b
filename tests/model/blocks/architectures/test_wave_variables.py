"""The wave line against its closed forms, and its energy in simulated runs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from block_checks import AssertFeedthroughIsReal, Block, Feedthrough, RandomInputs
from energies import ChannelEnergy
from grids import Slow
from numpy.testing import assert_allclose, assert_array_equal
from runs import TASKS
from scipy.linalg import sqrtm

from teleop_drake.model.blocks.architectures.wave_variables import (
    WaveMaster,
    WaveSlave,
    WaveVariablesConfig,
)
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.stations import ResolveController
from teleop_drake.model.tasks.metrics import RunMetrics

b = np.array([[2.0, 0.3], [0.3, 1.0]])
D = np.diag([0.4, 0.1])
CONFIG = WaveVariablesConfig(
    impedance=b, master_damping=D, forward_scaling=0.9, return_scaling=0.9
)
START = [0.5, -0.2]


def test_the_master_by_its_equation():
    block = WaveMaster(CONFIG, start=START)
    inputs = RandomInputs(block, 1)
    F_h = inputs["haptic_force"]
    received, p = inputs["return_packet"].reshape(2, 2)
    x_m = np.array([0.1, 0.2])
    w = 0.9 * received
    now = Block(block, inputs, x_m)
    root = sqrtm(2 * b)
    v = np.linalg.solve(b + D, F_h + root @ w)
    assert_allclose(now["felt_velocity"], v, rtol=1e-12)
    sent = np.concatenate([root @ v - w, x_m])
    assert_allclose(now["forward_packet"], sent, rtol=1e-12)
    assert_allclose(now["master_power"], (F_h - D @ v) * v, rtol=1e-12)
    assert_array_equal(now["felt_position"], p)
    assert_array_equal(now["master_position"], x_m)
    assert_allclose(now.Rate(), v, rtol=1e-12)
    start = Block(block, RandomInputs(block, 0))
    assert_array_equal(start["master_position"], START)
    # Matched to the line, it sends nothing of what arrives on.
    for damping in (D, b):
        block = WaveMaster(replace(CONFIG, master_damping=damping), start=START)
        AssertFeedthroughIsReal(block)
        expected = {"haptic_force", *(["return_packet"] if damping is D else [])}
        assert Feedthrough(block)["forward_packet"] == expected


def test_the_slave_by_its_equation():
    block = WaveSlave(CONFIG, num_axes=2)
    inputs = RandomInputs(block, 1)
    received, _ = inputs["forward_packet"].reshape(2, 2)
    p = inputs["tool_position"]
    v = inputs["tool_velocity"]
    u = 0.9 * received
    now = Block(block, inputs)
    root = sqrtm(2 * b)
    force = root @ u - b @ v
    assert_allclose(now["control_force"], force, rtol=1e-12)
    sent = np.concatenate([root @ v - u, p])
    assert_allclose(now["return_packet"], sent, rtol=1e-12)
    assert_allclose(now["slave_power"], force * v, rtol=1e-12)
    AssertFeedthroughIsReal(block)
    expected = {"forward_packet", "tool_velocity"}
    assert Feedthrough(block)["control_force"] == expected


def Wave(name, *overrides):
    scenario = LoadScenario(name, ["controller.kind=wave_variables", *overrides])
    return simulate(scenario, engine="auto")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("impedance", np.zeros((2, 2))),
        ("master_damping", -1.0),
        ("return_scaling", 1.1),
    ],
)
def test_bad_parameters_of_the_master(name, value):
    with pytest.raises(ValueError, match=name):
        WaveMaster(replace(CONFIG, **{name: value}), start=START)


def test_bad_parameters_of_the_slave():
    with pytest.raises(ValueError, match=r"forward_scaling = 0\.0"):
        WaveSlave(replace(CONFIG, forward_scaling=0.0), num_axes=2)


# Runs.


GROWING = (
    "duration=6.0",
    "surgeon.stop_time=2.0",
    "forward_channel={kind: variable, delay: 0.1, drift: 0.4}",
    "return_channel={kind: variable, delay: 0.1, drift: 0.4}",
)


def test_a_growing_delay_makes_energy_unless_the_waves_are_scaled():
    """Waves die out after the stop: what is left of the energy was lost or made."""
    unscaled = [
        f"controller.wave_variables.{way}_scaling=1" for way in ("forward", "return")
    ]
    made = ChannelEnergy(Wave("two_dof_puncture", *GROWING, *unscaled)).sum(axis=1)
    scaled = ChannelEnergy(Wave("two_dof_puncture", *GROWING)).sum(axis=1)
    peak = scaled.max()
    assert made[-1] < -0.1 * peak
    assert scaled.min() > -1e-6 * peak
    config = ResolveController(
        LoadScenario("two_dof_puncture", ["controller.kind=wave_variables", *GROWING])
    )
    assert config.forward_scaling == pytest.approx(math.sqrt(0.6))


def test_lost_and_late_packets_make_no_energy():
    """Through tissue into free space, and a stop: nothing is left to be stored."""
    network = "{kind: network, delay: 0.1, jitter: {kind: gamma, std: 0.02}, "
    network += "sample_period: 0.01, loss: {kind: burst, probability: 0.1}}"
    ways = [f"{way}_channel={network}" for way in ("forward", "return")]
    recording = Wave("two_dof_puncture", *GROWING[:2], *ways)
    energy = ChannelEnergy(recording).sum(axis=1)
    assert energy.max() > 0
    assert energy.min() > -1e-6 * energy.max()


@pytest.mark.parametrize(
    ("name", "delay"),
    Slow([("two_dof_collision", 0.4), *zip(TASKS, (0.0, 0.4, 0.1, 0.4), strict=True)]),
)
def test_thesis_tasks_are_stable_whatever_the_delay(name, delay):
    recording = Wave(
        name,
        f"forward_channel.delay={delay}",
        f"return_channel.delay={delay}",
        "simulator.accuracy=1e-6",
    )
    metrics = RunMetrics(recording)
    assert not metrics["diverged"]
    if metrics["collision"]:
        assert metrics["collision"]["settling_time"] < 10
        final = recording["environment_force"][-1, 0]
        expected = recording.scenario.surgeon.contact_force[0]
        assert final == pytest.approx(expected, rel=0.05)


def test_nothing_jumps_but_events_and_their_echoes():
    recording = Wave("two_dof_combined")
    jumps = recording.time[1:][np.diff(recording.time) == 0]
    delay = 0.1
    causes = [0.0, *(event.time for event in recording.events)]
    assert len(jumps) >= len(causes)
    for jump in jumps:
        echoes = [
            (jump - cause) / delay for cause in causes if cause < jump + delay / 2
        ]
        assert min(abs(echo - round(echo)) for echo in echoes) < 1e-5, jump


def test_defaults_match_the_operator():
    scenario = LoadScenario("two_dof_combined", ["controller.kind=wave_variables"])
    config = ResolveController(scenario)
    assert config.impedance == pytest.approx(0.92 * np.eye(2))
    assert config.master_damping == pytest.approx(config.impedance)
    assert (config.forward_scaling, config.return_scaling) == (1.0, 1.0)

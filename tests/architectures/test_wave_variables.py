"""The wave line against its closed forms, and its energy in simulated runs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from blocks import AssertFeedthroughIsReal, Block, Feedthrough, RandomInputs
from grids import Slow
from runs import TASKS
from scipy.linalg import sqrtm

from teleop_drake.architectures.wave_variables import (
    WaveMaster,
    WaveSlave,
    WaveVariablesConfig,
)
from teleop_drake.scenario import LoadScenario, ScenarioError
from teleop_drake.simulation import simulate
from teleop_drake.stations import ResolveController
from teleop_drake.tasks.metrics import RunMetrics

b, D = np.array([[2.0, 0.3], [0.3, 1.0]]), np.diag([0.4, 0.1])
CONFIG = WaveVariablesConfig(
    impedance=b, master_damping=D, forward_scaling=0.9, return_scaling=0.9
)
START = [0.5, -0.2]


@pytest.mark.parametrize("bandwidth", [None, 30.0])
def test_the_master_by_its_equation(bandwidth):
    config = replace(CONFIG, return_bandwidth=bandwidth)
    block = WaveMaster(config, start=START)
    inputs = RandomInputs(block, 1)
    F_h = inputs["haptic_force"]
    received, p = inputs["return_packet"].reshape(2, 2)
    x_m = np.array([0.1, 0.2])
    w = np.array([0.3, -0.4]) if bandwidth else 0.9 * received
    now = Block(block, inputs, np.concatenate([x_m, w]) if bandwidth else x_m)
    root = sqrtm(2 * b)
    v = np.linalg.solve(b + D, F_h + root @ w)
    np.testing.assert_allclose(now["felt_velocity"], v, rtol=1e-12)
    sent = np.concatenate([root @ v - w, x_m])
    np.testing.assert_allclose(now["forward_packet"], sent, rtol=1e-12)
    np.testing.assert_allclose(now["master_power"], (F_h - D @ v) * v, rtol=1e-12)
    np.testing.assert_array_equal(now["felt_position"], p)
    np.testing.assert_array_equal(now["master_position"], x_m)
    rate = [*v, *30.0 * (0.9 * received - w)] if bandwidth else v
    np.testing.assert_allclose(now.Rate(), rate, rtol=1e-12)
    start = Block(block, RandomInputs(block, 0))
    np.testing.assert_array_equal(start["master_position"], START)
    # Matched to the line, or behind a filter, it sends nothing of what arrives on.
    for damping in (D, b):
        block = WaveMaster(replace(config, master_damping=damping), start=START)
        AssertFeedthroughIsReal(block)
        reflects = bandwidth is None and damping is D
        expected = {"haptic_force", *(["return_packet"] if reflects else [])}
        assert Feedthrough(block)["forward_packet"] == expected


@pytest.mark.parametrize("rate", [0.0, 2.0])
@pytest.mark.parametrize("bandwidth", [None, 30.0])
def test_the_slave_by_its_equation(bandwidth, rate):
    config = replace(CONFIG, forward_bandwidth=bandwidth, drift_correction=rate)
    block = WaveSlave(config, num_axes=2)
    inputs = RandomInputs(block, 1)
    received, x_m = inputs["forward_packet"].reshape(2, 2)
    p, v = inputs["tool_position"], inputs["tool_velocity"]
    u = np.array([0.3, -0.4]) if bandwidth else 0.9 * received
    now = Block(block, inputs, u if bandwidth else None)
    if bandwidth:
        expected = 30.0 * (0.9 * received - u)
        np.testing.assert_allclose(now.Rate(), expected, rtol=1e-12)
    # |u| does not grow on any axis.
    correction = rate * sqrtm(b / 2) @ (x_m - p)
    u = np.clip(u + correction, -np.abs(u), np.abs(u))
    root = sqrtm(2 * b)
    force = root @ u - b @ v
    np.testing.assert_allclose(now["control_force"], force, rtol=1e-12)
    sent = np.concatenate([root @ v - u, p])
    np.testing.assert_allclose(now["return_packet"], sent, rtol=1e-12)
    np.testing.assert_allclose(now["slave_power"], force * v, rtol=1e-12)
    found, packet, velocity = Feedthrough(block), "forward_packet", "tool_velocity"
    if rate:
        assert len(found) == 3
        assert all(x == {packet, "tool_position", velocity} for x in found.values())
    else:
        AssertFeedthroughIsReal(block)
        expected = {velocity} if bandwidth else {packet, velocity}
        assert found["control_force"] == expected


def Wave(name, *overrides):
    scenario = LoadScenario(name, ["controller.kind=wave_variables", *overrides])
    return simulate(scenario, engine="auto")


def test_bad_parameters_of_the_blocks():
    bad = {"impedance": np.zeros((2, 2)), "master_damping": -1.0}
    for name, value in (bad | {"return_scaling": 1.1, "return_bandwidth": 0.0}).items():
        with pytest.raises(ValueError, match=name.partition("_")[2] or name):
            WaveMaster(replace(CONFIG, **{name: value}), start=START)
    with pytest.raises(ValueError, match=r"drift_correction = -1\.0"):
        WaveSlave(replace(CONFIG, drift_correction=-1.0), num_axes=2)


# Runs.


def Integral(time, y):
    return np.concatenate([[0.0], np.cumsum(np.diff(time) * (y[1:] + y[:-1]) / 2)])


def LineEnergy(recording):
    """Energy that went into the line and did not come out, at each sample (J)."""
    time = recording.time
    return sum(
        sign * Integral(time, recording[name].sum(axis=1))
        for name, sign in (("master_power", 1), ("slave_power", -1))
    )


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
    made = LineEnergy(Wave("two_dof_puncture", *GROWING, *unscaled))
    scaled = LineEnergy(Wave("two_dof_puncture", *GROWING))
    peak = scaled.max()
    assert made[-1] < -0.1 * peak
    assert scaled.min() > -1e-6 * peak
    config = ResolveController(
        LoadScenario("two_dof_puncture", ["controller.kind=wave_variables", *GROWING])
    )
    assert config.forward_scaling == pytest.approx(math.sqrt(0.6))


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


def test_filters_and_drift_correction_act():
    across = ("duration=2.5", "robot.start=[0.0065]")  # The border of the tissue.
    plain = Wave("one_dof", *across)
    for override in ("forward_bandwidth=20", "return_bandwidth=20"):
        filtered = Wave("one_dof", *across, f"controller.wave_variables.{override}")
        error = filtered["tool_velocity"][-1] - plain["tool_velocity"][-1]
        assert 1e-6 < abs(error[0]) < 5e-4, override

    def Drift(*more):
        """How far the tool is from where the master was a delay ago, at the end."""
        # A third of the packets is lost, so the waves do not arrive complete.
        recording = Wave(
            "one_dof",
            "duration=4.0",
            "forward_channel={kind: network, delay: 0.1, sample_period: 0.01, "
            "loss: {kind: independent, probability: 0.3}}",
            *more,
        )
        x_m = recording["forward_packet_received"][-1, 1]
        return x_m - recording["tool_position"][-1, 0]

    corrected = Drift("controller.wave_variables.drift_correction=2.0")
    assert abs(corrected) < abs(Drift())


def test_defaults_match_the_operator():
    scenario = LoadScenario("two_dof_combined", ["controller.kind=wave_variables"])
    config = ResolveController(scenario)
    assert config.impedance == pytest.approx(0.92 * np.eye(2))
    assert config.master_damping == pytest.approx(config.impedance)
    assert (config.forward_scaling, config.return_scaling) == (1.0, 1.0)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["controller.wave_variables.impedance=0"], "wave_variables.impedance = 0.0"),
        (["controller.wave_variables.forward_scaling=2"], "forward_scaling = 2.0: "),
        (["controller.wave_variables.return_bandwidth=-1"], "return_bandwidth = -1"),
        (["controller.wave_variables.drift_correction=.nan"], "drift_correction = nan"),
        (
            ["haptic_device.numerator=[0, 50]", "haptic_device.denominator=[1, 25, 0]"],
            "controller.wave_variables.impedance = null",
        ),
        (
            ["haptic_device.numerator=[1, 9]", "haptic_device.denominator=[1, 2]"],
            "haptic_device.numerator",
        ),
        (
            [
                "controller.wave_variables.master_damping=0",
                "forward_channel.delay=0",
                "return_channel.delay=0",
            ],
            "controller.wave_variables.master_damping = ",
        ),
    ],
)
def test_bad_input_is_named(overrides, message):
    with pytest.raises(ScenarioError, match=message):
        Wave("one_dof", "duration=0.1", *overrides)

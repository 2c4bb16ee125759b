"""Tests of analysis.energy."""

import numpy as np
import pytest
from grids import Slow
from pydrake.systems.framework import DiagramBuilder

from teleop_drake.analysis.energy import (
    AddTwoPortEnergy,
    ChannelEnergyBalance,
    TwoPortEnergyBalance,
)
from teleop_drake.scenario import ARCHITECTURES, LoadScenario
from teleop_drake.simulation import simulate
from teleop_drake.stations import ResolveController
from teleop_drake.tasks.metrics import RunMetrics
from teleop_drake.teleoperator import AddTeleoperator

NETWORK = {
    "kind": "network",
    "delay": 0.08,
    "sample_period": 0.02,
    "jitter": {"kind": "gamma", "std": 0.01, "minimum": 0.05},
    "loss": {"kind": "independent", "probability": 0.05},
    "seed": 3,
}


def RunWithTwoPortMeter(name, kind, **overrides):
    scenario = LoadScenario(name, {"controller.kind": kind} | overrides)
    builder = DiagramBuilder()
    AddTeleoperator(builder, scenario)
    meter = AddTwoPortEnergy(builder)
    assert meter.get_name() == "two_port_energy"
    return simulate(scenario, teleoperator=builder.Build(), engine="auto")


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("one_dof", {"duration": 9.0, "return_channel.delay": 0.17}),
        ("two_dof_collision", {"duration": 3.0}),
    ],
)
def test_system_and_recording_agree(name, overrides):
    """Also across the puncture, the contact and the operator's switch."""
    recording = RunWithTwoPortMeter(name, "direct_force", **overrides)
    balance = TwoPortEnergyBalance(recording)
    # The law passes the force on as it is received.
    of_channels = ChannelEnergyBalance(recording).energy
    np.testing.assert_allclose(of_channels, balance.energy, atol=1e-12)
    in_diagram = recording["energy"][:, 0]
    scale = np.abs(in_diagram).max()
    assert scale > 1e-8
    np.testing.assert_allclose(balance.energy, in_diagram, atol=5e-5 * scale)
    np.testing.assert_allclose(
        balance.power_in - balance.power_out, recording["power"][:, 0], atol=1e-15
    )
    assert np.all(np.diff(balance.violation) >= 0)
    assert balance.violation[-1] == pytest.approx(max(0, -balance.energy.min()))


def test_other_recordings():
    recording = RunWithTwoPortMeter("one_dof", "direct_force", duration=0.05)
    recording.signals["forward_packet_sent"] = np.zeros((len(recording.time), 3))
    with pytest.raises(ValueError, match="entries of forward_packet = 3"):
        ChannelEnergyBalance(recording)
    del recording.signals["forward_packet_sent"]
    for Balance in (ChannelEnergyBalance, TwoPortEnergyBalance):
        with pytest.raises(ValueError, match="recording = 'without packets'"):
            Balance(recording)


def test_force_that_is_let_go_and_caught_between_packets():
    """Jumps, and corners close behind them: balance, meter and metrics agree."""
    channel = {"kind": "sampled", "delay": 0.1, "sample_period": 0.05}
    recording = RunWithTwoPortMeter(
        "two_dof_combined",
        "time_domain_passivity",
        duration=4.0,
        forward_channel=channel,
        return_channel=channel,
    )
    balance = TwoPortEnergyBalance(recording).energy
    meter = recording["energy"][:, 0]
    assert np.sign(balance[-1]) == np.sign(meter[-1])
    np.testing.assert_allclose(balance, meter, rtol=0, atol=1e-3 * np.ptp(meter))
    # What the samples themselves are with steps of 0.0002 s.
    metrics = RunMetrics(recording)
    assert metrics["control_force_peak"] == pytest.approx([0.2, 0.0492862], rel=1e-3)
    assert metrics["control_force_variation"] == pytest.approx(
        [5.321714, 0.1807975], rel=1e-3
    )


@pytest.mark.parametrize("channel", Slow(["transport", "network"]))
@pytest.mark.parametrize("kind", ARCHITECTURES)
def test_every_architecture_has_a_balance(kind, channel):
    """The meter in the diagram and the recording agree."""
    overrides = {"duration": 1.5}
    if channel == "network":
        overrides |= {"forward_channel": NETWORK, "return_channel": NETWORK}
    recording = RunWithTwoPortMeter("two_dof_collision", kind, **overrides)
    balance = TwoPortEnergyBalance(recording)
    energy = recording["energy"][:, 0]
    scale = np.abs(recording["energy_in"]).max() + np.abs(recording["energy_out"]).max()
    assert scale > 1e-4
    # Passivity control bends the power between the samples of the recording.
    tolerance = 5e-3 if kind == "time_domain_passivity" else 1e-3
    np.testing.assert_allclose(balance.energy, energy, atol=tolerance * scale)
    np.testing.assert_allclose(
        energy, (recording["energy_in"] - recording["energy_out"])[:, 0], atol=1e-15
    )
    power = (recording["power_in"] - recording["power_out"])[:, 0]
    np.testing.assert_allclose(recording["power"][:, 0], power, atol=1e-15)
    np.testing.assert_allclose(balance.power_in, recording["power_in"][:, 0])
    np.testing.assert_allclose(balance.power_out, recording["power_out"][:, 0])


@pytest.mark.parametrize("delays", [(0.1, 0.1), (0.25, 0.05)])
def test_a_wave_line_stores_its_waves(delays):
    """E = integral over what is under way of u^T u/2 and w^T w/2, and what the damper
    at the master has dissipated: closed form, from the waves alone."""
    forward, back = delays
    recording = RunWithTwoPortMeter(
        "two_dof_collision",
        "wave_variables",
        **{
            "duration": 2.4,
            "forward_channel.delay": forward,
            "return_channel.delay": back,
        },
    )
    D = ResolveController(recording.scenario).master_damping
    fine = np.linspace(0.0, recording.time[-1], 48001)

    def Integral(power):
        steps = (power[1:] + power[:-1]) / 2 * np.diff(fine)
        return np.concatenate([[0.0], np.cumsum(steps)])

    u, w, v = (
        recording.Interpolate(name, fine)[:, :2]
        for name in ("forward_packet_sent", "return_packet_sent", "felt_velocity")
    )
    sent_u, sent_w = (Integral(np.sum(x * x, axis=1) / 2) for x in (u, w))
    stored = sum(
        sent - np.interp(fine - delay, fine, sent)
        for sent, delay in ((sent_u, forward), (sent_w, back))
    )
    dissipated = Integral(np.einsum("ki,ij,kj->k", v, D, v))
    expected = np.interp(recording.time, fine, stored + dissipated)
    energy = recording["energy"][:, 0]
    scale = energy.max()
    assert scale > 1e-3 and stored.max() > 0.02 * scale
    np.testing.assert_allclose(energy, expected, atol=1e-3 * scale)
    assert TwoPortEnergyBalance(recording).violation[-1] == 0


def test_no_teleoperator_no_meter():
    with pytest.raises(RuntimeError, match="master"):
        AddTwoPortEnergy(DiagramBuilder())

"""Tests of analysis.energy."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from teleop_drake.analysis.energy import (
    AddChannelEnergy,
    ChannelEnergyBalance,
    EnvironmentImpedance,
    TransmittedImpedance,
)
from teleop_drake.analysis.linearization import LinearizeLoop, OperatingPoints
from teleop_drake.laws.two_port import delay_two_port, terminated_port
from teleop_drake.recording import Recording, SolverStatistics
from teleop_drake.robots import MakeRobot
from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate
from teleop_drake.stations import MakeControlLaw, MakeMasterStation, MakeSlaveStation
from teleop_drake.systems.layered_force_field import LayeredForceField
from teleop_drake.teleoperator import MakeChannel

W = np.geomspace(0.1, 100, 40)


def LoopWithMeter(scenario):
    """The teleoperator, wired by hand with a ChannelEnergy."""
    n = scenario.num_axes
    config = scenario.robot
    builder = DiagramBuilder()
    add = builder.AddNamedSystem
    master = add("master", MakeMasterStation(scenario))
    controller = add("controller", MakeSlaveStation(MakeControlLaw(scenario)))
    robot = add(
        "robot",
        MakeRobot(
            model=config.model,
            start=config.start,
            elbow=config.elbow,
            mass=config.mass,
            damping=config.damping,
        ),
    )
    environment = add(
        "environment",
        LayeredForceField(layers=scenario.environment.layers, num_axes=n),
    )
    channels = [
        add(
            name,
            MakeChannel(getattr(scenario, name), size=2 * n, initial_value=[*start]),
        )
        for name, start in (
            ("forward_channel", np.zeros(2 * n)),
            ("return_channel", [*config.start, *np.zeros(n)]),
        )
    ]
    forward, back = channels
    for source, output, target, name in (
        (master, "forward_packet", forward, "signal"),
        (forward, "delayed_signal", controller, "forward_packet"),
        (controller, "control_force", robot, "control_force"),
        (environment, "environment_force", robot, "environment_force"),
        (environment, "environment_force", controller, "environment_force"),
        (controller, "return_packet", back, "signal"),
        (back, "delayed_signal", master, "return_packet"),
        *(
            (robot, name, target, name)
            for name in ("tool_position", "tool_velocity")
            for target in (environment, controller)
        ),
    ):
        builder.Connect(source.GetOutputPort(output), target.GetInputPort(name))
    AddChannelEnergy(
        builder,
        num_axes=n,
        forward_sent=master.GetOutputPort("forward_packet"),
        forward_received=forward.GetOutputPort("delayed_signal"),
        return_sent=controller.GetOutputPort("return_packet"),
        return_received=back.GetOutputPort("delayed_signal"),
    )
    return builder.Build()


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("one_dof", {"controller.kind": "direct_force", "duration": 9.0}),
        ("one_dof", {"duration": 9.0, "return_channel.delay": 0.17}),
        ("two_dof_collision", {"controller.kind": "direct_force", "duration": 3.0}),
    ],
)
def test_system_and_recording_agree(name, overrides):
    """Also across the puncture, the contact and the surgeon's switch."""
    scenario = LoadScenario(name, overrides)
    recording = simulate(scenario, teleoperator=LoopWithMeter(scenario))
    balance = ChannelEnergyBalance(recording)
    in_diagram = recording["energy"][:, 0]
    scale = np.abs(in_diagram).max()
    assert scale > 1e-8
    np.testing.assert_allclose(balance.energy, in_diagram, atol=5e-5 * scale)
    np.testing.assert_allclose(
        balance.power_in - balance.power_out, recording["power"][:, 0], atol=1e-15
    )
    assert np.all(np.diff(balance.violation) >= 0)
    assert balance.violation[-1] == pytest.approx(max(0, -balance.energy.min()))


def Sinusoids(phi, forward, back, w=3.0):
    """A recording of sinusoids behind a raw delay, on two axes."""
    t = np.arange(0, 12, 0.05)

    def F(t):
        return 2 * np.sin(w * t)

    def v(t):
        return 0.7 * np.sin(w * t + phi)

    def Pack(first, second):
        zero = 0 * t
        return np.stack([first, zero, second, zero], axis=1)

    return Recording(
        scenario=None,
        time=t,
        signals={
            "tool_velocity": np.zeros((len(t), 2)),
            "forward_packet_sent": Pack(F(t), 9 + 0 * t),
            "forward_packet_received": Pack(F(t - forward), 9 + 0 * t),
            "return_packet_sent": Pack(7 + 0 * t, v(t)),
            "return_packet_received": Pack(7 + 0 * t, v(t - back)),
        },
        events=[],
        solver=SolverStatistics(
            scheme="",
            accuracy=0,
            steps=0,
            derivative_evaluations=0,
            wall_time_s=0,
            real_time_factor=0,
        ),
    )


@pytest.mark.parametrize("phi", [-1.2, 0.4])
def test_sinusoids_in_closed_form(phi):
    w, forward, back = 3.0, 0.3, 0.1
    balance = ChannelEnergyBalance(Sinusoids(phi, forward, back, w))
    t = balance.time
    # sin a sin b = (cos(a - b) - cos(a + b))/2, integrated from 0.
    expected = 0.7 * (
        (np.cos(phi - w * back) - np.cos(phi + w * forward)) * t
        - (np.sin(2 * w * t + phi - w * back) - np.sin(phi - w * back)) / (2 * w)
        + (np.sin(2 * w * t + phi - w * forward) - np.sin(phi - w * forward)) / (2 * w)
    )
    np.testing.assert_allclose(balance.energy, expected, atol=1e-8)
    assert (balance.violation[-1] > 1) == (phi < 0)


def test_other_packets():
    recording = Sinusoids(0.4, 0.3, 0.1)
    whole = ChannelEnergyBalance(recording)
    chosen = ChannelEnergyBalance(recording, force=slice(0, 2), velocity=slice(2, None))
    np.testing.assert_array_equal(chosen.energy, whole.energy)
    with pytest.raises(ValueError, match="forward_packet: 1 entries chosen"):
        ChannelEnergyBalance(recording, force=slice(0, 1))
    recording.signals["forward_packet_sent"] = np.zeros((len(recording.time), 3))
    with pytest.raises(ValueError, match="its forward_packet has 3 entries"):
        ChannelEnergyBalance(recording)


def test_other_recordings():
    recording = simulate(LoadScenario("network_tracking_linear", {"duration": 0.1}))
    with pytest.raises(ValueError, match="recording: no packets"):
        ChannelEnergyBalance(recording)


@pytest.mark.parametrize(("point", "k", "d"), [(0, 0.01, 0.5), (2, 150.0, 0.0)])
def test_transmitted_impedance_of_direct_force(point, k, d):
    """Z_to = (m j w + c + Z_e) e^(j w T): the robot is felt as well."""
    scenario = LoadScenario("one_dof", {"controller.kind": "direct_force"})
    model = LinearizeLoop(scenario, OperatingPoints(scenario)[point])
    Z_e = EnvironmentImpedance(scenario, model, W)
    np.testing.assert_allclose(Z_e[:, 0, 0], d + k / (1j * W))
    Z_to = TransmittedImpedance(model, W, delay=0.2)[:, 0, 0]
    robot = 0.5j * W + 0.1
    np.testing.assert_allclose(
        Z_to, (robot + Z_e[:, 0, 0]) * np.exp(0.2j * W), rtol=1e-8
    )
    # The same through the two-port.
    felt = terminated_port(
        delay_two_port(W, forward_delay=0.13, return_delay=0.07), robot + Z_e[:, 0, 0]
    )
    np.testing.assert_allclose(Z_to, 1 / felt, rtol=1e-8)
    assert Z_to.real.min() < 0 < TransmittedImpedance(model, W).real.min()


def test_transmitted_impedance_of_the_arm():
    scenario = LoadScenario("two_dof_combined", {"controller.kind": "direct_force"})
    points = OperatingPoints(scenario)
    tissue, free = (
        TransmittedImpedance(LinearizeLoop(scenario, point), W) for point in points[:2]
    )
    assert tissue.shape == (40, 2, 2)
    model = LinearizeLoop(scenario, points[1])
    assert np.all(EnvironmentImpedance(scenario, model, W) == 0)
    # At high frequencies the inertia of the tool.
    inertia = np.linalg.inv(model.slave.B[2:4, :2])
    np.testing.assert_allclose(free[-1] / (1j * W[-1]), inertia, rtol=1e-2)

"""Tests of systems.channel_energy."""

import numpy as np
import pytest
from blocks import Block, Feedthrough
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Sine

from teleop_drake.channels.transport import TransportDelay
from teleop_drake.simulation import simulate
from teleop_drake.systems.channel_energy import ChannelEnergy


def test_ports_and_feedthrough():
    system = ChannelEnergy(num_axes=2)
    inputs = {
        "master_force": [1.0, 2.0],
        "master_velocity": [3.0, -1.0],
        "slave_force": [0.5, 4.0],
        "slave_velocity": [2.0, 0.25],
    }
    now = Block(system, inputs, [7.0, 5.0])
    # 1*3 - 2*1 and 0.5*2 + 4*0.25
    powers = {"power_in": 1.0, "power_out": 2.0, "power": -1.0}
    energies = {"energy": 2.0, "energy_in": 7.0, "energy_out": 5.0}
    assert {name: now[name].item() for name in powers | energies} == powers | energies
    assert now.Rate().tolist() == [1.0, 2.0]
    assert Feedthrough(system) == {
        "power": set(inputs),
        "power_in": {"master_force", "master_velocity"},
        "power_out": {"slave_force", "slave_velocity"},
    }
    with pytest.raises(ValueError, match=r"num_axes = .*must be"):
        ChannelEnergy(num_axes=0)


@pytest.mark.parametrize(
    ("phi", "forward", "back"), [(-1.2, 0.35, 0.05), (0.4, 0.1, 0.1)]
)
def test_sinusoids_through_a_raw_delay(phi, forward, back):
    """F_m = F sin(w t), v_s = V sin(w t + phi): over a period T the channels take

        F V T/2 (cos(phi - w T_r) - cos(phi + w T_f)),

    which is negative for some phi: a raw delay makes energy.
    """
    w, F, V = 3.0, 2.0, 0.7
    builder = DiagramBuilder()

    def AddSine(name, amplitude, phase):
        sine = Sine(amplitude, w, phase, 1)
        return builder.AddNamedSystem(name, sine).get_output_port(0)

    force, velocity = AddSine("force", F, 0.0), AddSine("velocity", V, phi)
    meter = builder.AddNamedSystem("meter", ChannelEnergy(num_axes=1))
    for name, port, delay, target in (
        ("forward", force, forward, "slave_force"),
        ("back", velocity, back, "master_velocity"),
    ):
        channel = builder.AddNamedSystem(name, TransportDelay(delay=delay, size=1))
        builder.Connect(port, channel.get_input_port())
        builder.Connect(channel.get_output_port(), meter.GetInputPort(target))
    builder.Connect(force, meter.GetInputPort("master_force"))
    builder.Connect(velocity, meter.GetInputPort("slave_velocity"))
    builder.ExportOutput(meter.GetOutputPort("energy"), "energy")
    period = 2 * np.pi / w
    config = SimulatorConfig(
        integration_scheme="runge_kutta5", accuracy=1e-10, use_error_control=True
    )
    run = simulate(builder.Build(), duration=1 + 3 * period, simulator=config)
    times = np.array([1.0, 1.0 + period, 1.0 + 3 * period])
    begin, once, thrice = run.Interpolate("energy", times)[:, 0]
    expected = F * V * period / 2 * (np.cos(phi - w * back) - np.cos(phi + w * forward))
    assert once - begin == pytest.approx(expected, abs=1e-6)
    assert thrice - begin == pytest.approx(3 * expected, abs=3e-6)

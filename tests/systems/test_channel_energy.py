"""Tests of systems.channel_energy."""

import numpy as np
import pytest
from grids import Slow
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Sine

from teleop_drake.channels.transport import TransportDelay
from teleop_drake.systems.channel_energy import ChannelEnergy


def test_ports_and_feedthrough():
    system = ChannelEnergy(num_axes=2)
    context = system.CreateDefaultContext()
    values = {
        "master_force": [1.0, 2.0],
        "master_velocity": [3.0, -1.0],
        "slave_force": [0.5, 4.0],
        "slave_velocity": [2.0, 0.25],
    }
    for name, value in values.items():
        system.GetInputPort(name).FixValue(context, value)
    # 1*3 - 2*1 and 0.5*2 + 4*0.25
    for name, value in {
        "power_in": 1.0,
        "power_out": 2.0,
        "power": -1.0,
        "energy": 0.0,
        "energy_in": 0.0,
        "energy_out": 0.0,
    }.items():
        assert system.GetOutputPort(name).Eval(context) == [value]
    assert system.EvalTimeDerivatives(context).CopyToVector().tolist() == [1.0, 2.0]
    context.SetContinuousState([7.0, 5.0])
    for name, value in {"energy": 2.0, "energy_in": 7.0, "energy_out": 5.0}.items():
        assert system.GetOutputPort(name).Eval(context) == [value]
    feedthrough = {
        "power": {0, 1, 2, 3},
        "power_in": {0, 1},
        "power_out": {2, 3},
        "energy": set(),
        "energy_in": set(),
        "energy_out": set(),
    }
    for name, expected in feedthrough.items():
        index = system.GetOutputPort(name).get_index()
        found = {i for i in range(4) if system.HasDirectFeedthrough(i, index)}
        assert found == expected, name


def test_num_axes():
    with pytest.raises(ValueError, match=r"num_axes = .*must be"):
        ChannelEnergy(num_axes=0)


@pytest.mark.parametrize(
    ("forward", "back"), Slow([(0.35, 0.05), (0.1, 0.1), (0.0, 0.0)])
)
@pytest.mark.parametrize("phi", [-1.2, 0.0, 0.4, 1.5])
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
    diagram = builder.Build()
    simulator = Simulator(diagram)
    config = SimulatorConfig(
        integration_scheme="runge_kutta5",
        accuracy=1e-11,
        use_error_control=True,
        max_step_size=0.02,
    )
    ApplySimulatorConfig(config, simulator)
    context = meter.GetMyContextFromRoot(simulator.get_context())
    energies = []
    period = 2 * np.pi / w
    for time in (1.0, 1.0 + period, 1.0 + 3 * period):
        simulator.AdvanceTo(time)
        energies.append(meter.GetOutputPort("energy").Eval(context)[0])
    expected = F * V * period / 2 * (np.cos(phi - w * back) - np.cos(phi + w * forward))
    assert energies[1] - energies[0] == pytest.approx(expected, abs=1e-8)
    assert energies[2] - energies[0] == pytest.approx(3 * expected, abs=3e-8)

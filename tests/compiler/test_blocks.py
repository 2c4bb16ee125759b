"""Every block of the package has a kernel that computes what the block does."""

import warnings

import numpy as np
import pytest

from teleop_drake.architectures.four_channel import FourChannelMaster, FourChannelSlave
from teleop_drake.architectures.wave_variables import WaveMaster, WaveSlave
from teleop_drake.channels.transport import TransportDelay
from teleop_drake.compiler.check import CheckKernel
from teleop_drake.scenario import ARCHITECTURES, LoadScenario
from teleop_drake.simulation import MakeDiagram, simulate
from teleop_drake.systems.channel_energy import ChannelEnergy
from teleop_drake.systems.disturbance_force import DisturbanceForce
from teleop_drake.teleoperator import MakeTeleoperator


@pytest.mark.parametrize("controller", ARCHITECTURES)
@pytest.mark.parametrize("name", ["one_dof", "two_dof_combined"])
def test_a_scenario_compiles(name, controller):
    scenario = LoadScenario(name)
    scenario.controller.kind = controller
    CheckKernel(MakeTeleoperator(scenario), num_states=3)


@pytest.mark.parametrize(
    "name", ["network_tracking_linear", "network_tracking_coupled"]
)
def test_the_tracking_of_chapter_3_compiles(name):
    CheckKernel(MakeDiagram(LoadScenario(name)), num_states=3)


I = np.eye(2)
FOUR = {"mass": I, "damping": I, "local_damping": I, "local_stiffness": 9 * I}


@pytest.mark.parametrize(
    "block",
    [
        WaveMaster(impedance=2 * I, damping=I, start=[0.1, 0], bandwidth=30),
        WaveMaster(impedance=2 * I, damping=2 * I, start=[0.1, 0], scaling=0.9),
        WaveSlave(impedance=2 * I, bandwidth=30, drift_correction=2, scaling=0.9),
        FourChannelMaster(
            **FOUR, C2=1, C4=0.5, C6=0.1, start=[1, 0], acceleration_bandwidth=50
        ),
        FourChannelSlave(
            **FOUR, C1=1, C3=0.5, C5=0.1, start=[1, 0], acceleration_bandwidth=50
        ),
        TransportDelay(delay=0, size=2),
        ChannelEnergy(num_axes=2),
        DisturbanceForce(kind="linear", gain=I),
        DisturbanceForce(kind="coupled", gain=I),
    ],
    ids=lambda block: type(block).__name__,
)
def test_a_variant_has_a_kernel(block):
    CheckKernel(block)


@pytest.mark.slow
@pytest.mark.parametrize("controller", ARCHITECTURES)
def test_an_architecture_runs_as_machine_code(controller):
    pytest.importorskip("numba")
    tight = ["simulator.accuracy=1e-11", "simulator.max_step_size=0.005"]
    scenario = LoadScenario(
        "one_dof", ["duration=1", f"controller.kind={controller}", *tight]
    )
    drake = simulate(scenario)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compiled = simulate(scenario, engine="compiled")
    for name in ("tool_velocity", "control_force", "return_packet_received"):
        ours, theirs = (run[name][-1] for run in (compiled, drake))
        np.testing.assert_allclose(ours, theirs, atol=1e-5 * np.ptp(drake[name]))

"""Time-domain passivity: neither port gives more than the other has taken."""

from dataclasses import replace

import numpy as np
import pytest
from block_checks import Block, Feedthrough
from energies import ChannelEnergy
from grids import Slow
from numpy.testing import assert_allclose, assert_array_equal
from runs import Run

from teleop_drake.model.blocks.architectures.time_domain_passivity import (
    PassivityMaster,
    PassivitySlave,
    TimeDomainPassivityConfig,
)
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.stations import ResolveController

KIND = "time_domain_passivity"
LOOSE = "simulator.accuracy=1e-6"
NETWORK = (
    "{kind: network, delay: 0.1, sample_period: 0.01, jitter: {kind: uniform, "
    "std: 0.02}, loss: {kind: independent, probability: 0.2}}"
)

E_0 = 0.02
HORIZON = 0.05
CONFIG = TimeDomainPassivityConfig(
    horizon=HORIZON, maximum_mobility=4.0, maximum_damping=4.0, initial_energy=E_0
)


def Master(F_h, v, E_received, energies):
    """The block with [E_in; E_out] in J."""
    packet = np.concatenate([[0.7, 0.8], v, E_received])
    inputs = {"haptic_force": F_h, "velocity_command": [9, 9], "return_packet": packet}
    return Block(PassivityMaster(CONFIG, num_axes=2), inputs, np.array(energies) / E_0)


def Slave(F_hd, v, E_received, energies, local_damping=0.0):
    """The block with [E_in; E_out] in J."""
    inputs = {
        "forward_packet": np.concatenate([F_hd, E_received]),
        "tool_position": [0.7, 0.8],
        "tool_velocity": v,
        "environment_force": [9, 9],
    }
    config = replace(CONFIG, local_damping=local_damping)
    return Block(PassivitySlave(config, num_axes=2), inputs, np.array(energies) / E_0)


def test_what_can_be_paid_for_passes():
    now = Master([1.0, -2.0], [0.1, 0.2], [0.5, 0.5], [0.1, 0.2, 0.3, 0.4])
    assert_allclose(now["master_budget"], [0.2, 0.1])
    assert_array_equal(now["injected_mobility"], [0.0, 0.0])
    assert_array_equal(now["felt_velocity"], [0.1, 0.2])
    assert_array_equal(now["felt_position"], [0.7, 0.8])
    assert_allclose(now["forward_packet"], [1.0, -2.0, 0.1, 0.2])
    assert_allclose(now["master_power"], [0.1, -0.4])
    assert_allclose(now.Rate() * E_0, [0.1, 0.0, 0.0, 0.4])
    now = Slave([1.0, -2.0], [0.1, 0.2], [0.5, 0.5], [0.1, 0.2, 0.3, 0.4])
    assert_allclose(now["slave_budget"], [0.22, 0.12])
    assert_array_equal(now["injected_damping"], [0.0, 0.0])
    assert_array_equal(now["control_force"], [1.0, -2.0])
    assert_allclose(now["return_packet"], [0.7, 0.8, 0.1, 0.2, 0.1, 0.2])
    assert_allclose(now["slave_power"], [0.1, -0.4])
    assert_allclose(now.Rate() * E_0, [0.0, 0.4, 0.1, 0.0])


def test_what_cannot_is_brought_down_to_the_budget():
    now = Master([1.0, -2.0], [-1.0, 1.0], [0.01, 0.0], [0.0, 0.0, 0.0, 0.0])
    # 1 W would leave where 0.01 J / 0.05 s may; nothing may on the other axis.
    assert_allclose(now["master_power"], [-0.01 / HORIZON, 0.0], atol=1e-15)
    assert_allclose(now["injected_mobility"], [0.8, 0.5])
    assert_allclose(now["felt_velocity"], [-0.2, 0.0], atol=1e-15)
    now = Slave([2.0, 2.0], [1.0, 1.0], [0.0, 0.0], [0.0, 0.0, 0.0, E_0])
    assert_allclose(now["slave_power"], [E_0 / HORIZON, 0.0], atol=1e-15)
    assert_allclose(now["injected_damping"], [1.6, 2.0])
    assert_allclose(now["control_force"], [0.4, 0.0], atol=1e-15)


def test_mobility_and_damping_have_a_maximum():
    now = Master([0.01, 0.01], [-1.0, -1.0], [0.0, 0.0], [0.0] * 4)
    assert_array_equal(now["injected_mobility"], [4.0, 4.0])
    now = Slave([1.0, 1.0], [0.01, 0.01], [0.0, 0.0], [0.0, 0.0, E_0, E_0])
    assert_array_equal(now["injected_damping"], [4.0, 4.0])


def test_a_local_damper_is_behind_the_port():
    damper = np.array([[2.0, 0.3], [0.3, 1.0]])
    v = np.array([0.4, -0.3])
    at = ([1.0, -2.0], v, [0.5, 0.5], [0.1, 0.2, 0.3, 0.4])
    bare = Slave(*at)
    damped = Slave(*at, local_damping=damper)
    expected = bare["control_force"] - damper @ v
    assert_allclose(damped["control_force"], expected)
    assert_array_equal(damped["slave_power"], bare["slave_power"])
    assert_array_equal(damped.Rate(), bare.Rate())


def test_feedthrough_and_start():
    both = {"haptic_force", "return_packet"}
    assert Feedthrough(PassivityMaster(CONFIG, num_axes=2)) == {
        "felt_position": {"return_packet"},
        "felt_velocity": both,
        "forward_packet": {"haptic_force"},
        "master_budget": {"return_packet"},
        "master_power": both,
        "injected_mobility": both,
    }
    both = {"forward_packet", "tool_velocity"}
    assert Feedthrough(PassivitySlave(CONFIG, num_axes=2)) == {
        "control_force": both,
        "return_packet": {"tool_position", "tool_velocity"},
        "slave_budget": {"forward_packet"},
        "slave_power": both,
        "injected_damping": both,
    }
    now = Slave([0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0] * 4)
    assert_allclose(now["slave_budget"], [E_0, E_0])


def Passivity(name, *overrides):
    scenario = LoadScenario(name, [f"controller.kind={KIND}", LOOSE, *overrides])
    return simulate(scenario, engine="auto")


@pytest.mark.parametrize(
    ("name", "overrides"),
    Slow(
        [
            ("two_dof_combined", ["duration=4.0", f"forward_channel={NETWORK}"]),
            ("two_dof_puncture", ["duration=4.0", f"return_channel={NETWORK}"]),
        ]
    ),
)
def test_the_channel_is_passive(name, overrides):
    """E_0 + what went in - what came out >= 0, but for what the maxima let through."""
    recording = Passivity(name, *overrides)
    E_0 = ResolveController(recording.scenario).initial_energy
    assert recording["injected_mobility"].max() > 0
    assert (E_0 + ChannelEnergy(recording)).min() > -0.1 * E_0
    assert recording["slave_budget"].min() > -0.1 * E_0
    assert recording["master_budget"].min() > -0.25 * E_0


def test_the_budgets_hold_the_better_the_shorter_the_horizon():
    worst = []
    for horizon in (0.01, 0.0025):
        recording = Passivity(
            "two_dof_combined",
            "duration=2.0",
            f"controller.{KIND}.horizon={horizon}",
        )
        worst.append(-recording["master_budget"].min())
    assert 0 < worst[1] < 0.5 * worst[0]


def test_without_delay_it_nearly_leaves_direct_force_alone():
    """What comes in at one end leaves at the other, but for a horizon's lag."""
    delays = ["forward_channel.delay=0", "return_channel.delay=0", "duration=12.0"]
    ours = Passivity("one_dof", *delays)
    assert ours["injected_damping"].max() == 0
    theirs = Run("one_dof", "direct_force", *delays)
    times = np.linspace(0, 12, 1001)
    error = ours.Interpolate("tool_velocity", times) - theirs.Interpolate(
        "tool_velocity", times
    )
    assert np.abs(error).max() < 0.05 * 1e-3


def test_energy_for_the_start_is_what_the_tool_takes():
    """m v^2 / 2 + d v^2 T on the slider: 0.5 kg, 0.6 N s/m, 0.2 s, 1 mm/s."""
    config = ResolveController(LoadScenario("one_dof", [f"controller.kind={KIND}"]))
    assert config.initial_energy == pytest.approx((0.25 + 0.6 * 0.2) * 1e-6)
    assert config.maximum_damping == pytest.approx(0.5 / 0.01)
    assert config.maximum_mobility == pytest.approx(1 / (25 * 0.01))


@pytest.mark.parametrize(
    "name",
    ("horizon", "maximum_mobility", "initial_energy"),
)
def test_bad_parameters_of_the_blocks(name):
    for value in (0.0, None):
        with pytest.raises(ValueError, match=name):
            PassivityMaster(replace(CONFIG, **{name: value}), num_axes=1)

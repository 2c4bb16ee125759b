"""Time-domain passivity: neither port gives more than the other has taken."""

import numpy as np
import pytest
from grids import Slow
from runs import Run

from teleop_drake.architectures.time_domain_passivity import (
    PassivityMaster,
    PassivitySlave,
)
from teleop_drake.scenario import LoadScenario, ScenarioError
from teleop_drake.simulation import simulate
from teleop_drake.stations import ResolveController
from teleop_drake.tasks.metrics import RunMetrics

KIND = "time_domain_passivity"
LOOSE = "simulator.accuracy=1e-6"
NETWORK = (
    "{kind: network, delay: 0.1, sample_period: 0.01, jitter: {kind: uniform, "
    "std: 0.02}, loss: {kind: independent, probability: 0.2}}"
)


def Passivity(name, *overrides):
    scenario = LoadScenario(name, [f"controller.kind={KIND}", LOOSE, *overrides])
    return simulate(scenario, engine="auto")


def Integral(time, y):
    steps = np.diff(time)[:, None] * (y[1:] + y[:-1]) / 2
    return np.vstack([np.zeros(y.shape[1]), np.cumsum(steps, axis=0)])


def ChannelEnergy(recording):
    """Energy per axis that went into the channel and did not come out (J)."""
    return Integral(
        recording.time, recording["master_power"] - recording["slave_power"]
    )


@pytest.mark.parametrize(
    ("name", "overrides"),
    Slow(
        [
            ("two_dof_combined", ["duration=4.0"]),
            ("two_dof_combined", ["duration=4.0", f"forward_channel={NETWORK}"]),
            ("two_dof_puncture", ["duration=4.0", f"return_channel={NETWORK}"]),
            (
                "two_dof_collision",
                [
                    "duration=3.0",
                    "forward_channel.delay=0.3",
                    "return_channel.delay=0.2",
                ],
            ),
        ],
        but=[1],
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


def test_the_raw_delay_is_not_passive():
    """The same energy of direct force application: far below zero."""
    recording = Run("two_dof_puncture", "direct_force")
    n = 2
    F_h, v_felt = (
        recording["forward_packet_sent"][:, :n],
        recording["return_packet_received"][:, n:],
    )
    F_c, v = recording["control_force"], recording["tool_velocity"]
    energy = Integral(recording.time, F_h * v_felt - F_c * v)
    E_0 = ResolveController(
        LoadScenario("two_dof_puncture", [f"controller.kind={KIND}"])
    ).initial_energy
    assert energy.min() < -3 * E_0
    assert recording.termination == "diverged"


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


@pytest.mark.slow  # As rows of the league table.
@pytest.mark.parametrize("delay", Slow([0.2, 0.3]))
def test_it_stays_bounded_where_direct_force_diverges(delay):
    delays = [f"{way}_channel.delay={delay}" for way in ("forward", "return")]
    ours = RunMetrics(Passivity("two_dof_combined", *delays))
    theirs = RunMetrics(Run("two_dof_combined", "direct_force", *delays))
    assert theirs["diverged"]
    assert not ours["diverged"]


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


@pytest.mark.parametrize("block", [PassivityMaster, PassivitySlave])
def test_bad_parameters_of_the_blocks(block):
    is_master = block is PassivityMaster
    good = {"num_axes": 1, "horizon": 0.01}
    good["maximum_mobility" if is_master else "maximum_damping"] = 1.0
    good["energy_scale" if is_master else "initial_energy"] = 1.0
    for name in good:
        with pytest.raises(ValueError, match=name):
            block(**{**good, name: 0})


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (f"controller.{KIND}.horizon=0", f"controller.{KIND}.horizon = 0.0"),
        (f"controller.{KIND}.initial_energy=-1", "initial_energy = -1.0: must be"),
        (f"controller.{KIND}.maximum_damping=0", "maximum_damping = 0.0: must be"),
        ("haptic_device.numerator=[50]", f"controller.{KIND}.maximum_mobility = null"),
    ],
)
def test_bad_input_is_named(override, message):
    with pytest.raises(ScenarioError, match=message):
        Passivity("one_dof", "duration=0.1", override)

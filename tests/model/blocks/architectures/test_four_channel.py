"""Lawrence's architecture: what the operator feels, by the blocks and on paper."""

import numpy as np
import pytest
from block_checks import AssertFeedthroughIsReal, Block, RandomInputs
from numpy.testing import assert_allclose, assert_array_equal
from phasors import FeltImpedance

from teleop_drake.model.blocks.architectures.four_channel import (
    FourChannelConfig,
    FourChannelMaster,
    FourChannelSlave,
    LocalController,
)
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.stations import MakeArchitecture, ResolveController

KIND = "four_channel"
VARIANTS = ("four_channel", "position_position", "position_force", "force_force")
# The slider of the one-axis task, and what it may be pushed against.
ROBOT = (0.5, 0.1)
TISSUE = (0.01, 0.5)
BONE = (150.0, 0.0)

M = np.array([[2.0, 0.3], [0.3, 1.0]])
B = np.diag([0.4, 0.0])
B_c = np.diag([1.0, 2.0])
K_c = np.array([[5.0, 1.0], [1.0, 4.0]])
START = np.array([0.5, -0.2])


def Make(block, **changes):
    local = LocalController(damping=B_c, stiffness=K_c)
    given = {"C1": 1.1, "C2": 0.9, "C3": 0.9, "C4": 1.1, "C5": -0.2, "C6": -0.2}
    given |= {"master_mass": M, "master_damping": B, "C_m": local, "C_s": local}
    given |= {"slave_damping": B}
    start = changes.pop("start", START)
    return block(FourChannelConfig(**(given | changes)), start=start)


def test_the_master_by_its_equation():
    block = Make(FourChannelMaster)
    inputs = RandomInputs(block, 1)
    F_h = inputs["haptic_force"]
    p, v, F_e = inputs["return_packet"].reshape(-1, 2)
    x = np.random.default_rng(2).normal(size=4)
    x_m = x[:2]
    v_m = x[2:]
    now = Block(block, inputs, x)
    force = 0.8 * F_h - 0.9 * F_e - (B + B_c) @ v_m - K_c @ (x_m - START)
    force += 1.1 * ((B + B_c) @ v + K_c @ (p - START))
    expected = np.concatenate([v_m, np.linalg.solve(M, force)])
    assert_allclose(now.Rate(), expected, rtol=1e-12)
    assert_array_equal(now["forward_packet"], [*x_m, *v_m, *F_h])
    assert_array_equal(now["felt_position"], p)
    assert_array_equal(now["felt_velocity"], v_m)
    AssertFeedthroughIsReal(block)
    start = Block(block, RandomInputs(block, 0))
    assert_array_equal(start["forward_packet"][:4], [*START, 0.0, 0.0])


def test_the_slave_by_its_equation():
    block = Make(FourChannelSlave)
    inputs = RandomInputs(block, 1)
    x_m, v_m, F_h = inputs["forward_packet"].reshape(-1, 2)
    p = inputs["tool_position"]
    v = inputs["tool_velocity"]
    F_e = inputs["environment_force"]
    now = Block(block, inputs)
    force = 0.9 * F_h + 0.2 * F_e - B_c @ v - K_c @ (p - START)
    force += 1.1 * ((B + B_c) @ v_m + K_c @ (x_m - START))
    assert_allclose(now["control_force"], force, rtol=1e-12)
    assert_array_equal(now["return_packet"], [*p, *v, *F_e])
    AssertFeedthroughIsReal(block)


def Scenario(*overrides, name="one_dof", delay=None):
    overrides = [f"controller.{KIND}.{item}" for item in overrides]
    if delay is not None:
        overrides += [f"{way}_channel.delay={delay}" for way in ("forward", "return")]
    return LoadScenario(name, [f"controller.kind={KIND}", *overrides])


def Felt(scenario, omega, environment):
    k, d = environment
    m, c = ROBOT
    s = 1j * omega
    sides = MakeArchitecture(scenario)
    delays = (scenario.forward_channel.delay, scenario.return_channel.delay)
    return FeltImpedance(
        sides.master_side,
        sides.slave_side,
        s,
        delays=delays,
        robot=m * s + c,
        environment=k / s + d,
    )


def test_the_environment_is_felt_at_low_frequency():
    Z_e = 3.0 / 0.01j + 2.0
    felt = Felt(Scenario(delay=0.0), 0.01, (3.0, 2.0))
    assert felt == pytest.approx(Z_e, rel=1e-3)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(
    ("environment", "delay", "omega"), [(TISSUE, 0.1, 0.5), (BONE, 0.0, 7.0)]
)
def test_felt_impedance_is_lawrences(variant, environment, delay, omega):
    """Z_to from Z_m, Z_s, C1 to C6, C_m and C_s, solved on paper."""
    scenario = Scenario(f"variant={variant}", "C5=-0.2", "C6=0.3", delay=delay)
    config = ResolveController(scenario)
    s = 1j * omega
    z = np.exp(-s * delay)
    (k, d) = environment
    (m, c) = ROBOT
    Z_e = k / s + d
    Z_s = m * s + c
    Z_m = 0.5 * s + 0.1

    def Local(gains):
        return gains.damping[0, 0] + gains.stiffness[0, 0] / s

    C_m = Local(config.C_m)
    C_s = Local(config.C_s)
    # The models in C1 and C4 are dampings.
    C1 = config.C1 * (config.slave_damping[0, 0] + C_s)
    C4 = -config.C4 * (config.master_damping[0, 0] + C_m)
    C2 = config.C2
    C3 = config.C3
    C5 = config.C5
    C6 = config.C6
    # (Z_s + C_s + (1 + C5) Z_e) V_s = z (C1 V_m + C3 F_h), and
    # (Z_m + C_m) V_m = (1 + C6) F_h - z (C2 Z_e + C4) V_s.
    N = Z_s + C_s + (1 + C5) * Z_e
    back = z * z * (C2 * Z_e + C4) / N
    expected = (Z_m + C_m + back * C1) / (1 + C6 - back * C3)
    felt = Felt(scenario, omega, environment)
    assert felt == pytest.approx(expected, rel=1e-9)


def test_defaults_derive_from_the_delays_and_the_robot():
    config = ResolveController(Scenario())
    assert config.bandwidth == pytest.approx(1 / 0.2)
    assert config.C_s.damping == pytest.approx(2 * 0.5 * 5)
    assert config.C_s.stiffness == pytest.approx(0.5 * 25)
    assert config.slave_damping == pytest.approx(0.1)
    assert (config.C1, config.C2, config.C3, config.C4) == (1, 1, 1, 1)
    assert (config.C5, config.C6) == (0, 0)
    assert ResolveController(Scenario(delay=0)).bandwidth == pytest.approx(25)
    config = ResolveController(Scenario("variant=position_force", "C2=0.5"))
    assert (config.C1, config.C2, config.C3, config.C4) == (1, 0.5, 0, 0)
    assert (config.C5, config.C6) == (0, -0.5)
    assert not np.any(config.C_m.stiffness) and np.any(config.C_s.stiffness)
    config = ResolveController(Scenario(name="two_dof_combined"))
    assert config.slave_damping == pytest.approx(np.zeros((2, 2)))
    assert config.C_s.stiffness == pytest.approx(config.C_m.stiffness)


@pytest.mark.parametrize(
    ("variant", "name"),
    [
        *((variant, "one_dof") for variant in VARIANTS),
        (VARIANTS[0], "two_dof_puncture"),
    ],
)
def test_without_delay_the_tool_follows_the_command(variant, name):
    scenario = Scenario(f"variant={variant}", name=name, delay=0)
    scenario.duration = 2.0 if name == "two_dof_puncture" else 4.0  # In the tissue.
    recording = simulate(scenario, engine="auto")
    assert recording.termination == "completed"
    v = recording["tool_velocity"][-1, 0]
    assert v == pytest.approx(scenario.surgeon.velocity[0], rel=0.25)


def test_a_lasting_force_arrives_as_it_was_sent():
    """Position-position on the bone: 0.2 N along x and nothing along y."""
    scenario = Scenario("variant=position_position", name="two_dof_collision")
    scenario.duration = 9.0
    scenario.simulator.accuracy = 1e-6
    recording = simulate(scenario, engine="auto")
    assert recording["environment_force"][-1, 0] == pytest.approx(0.2, rel=0.02)
    assert recording["control_force"][-1] == pytest.approx([0.2, 0.0], abs=0.005)


@pytest.mark.parametrize(
    ("block", "name", "value"),
    [
        (FourChannelMaster, "master_mass", np.zeros((2, 2))),
        (FourChannelMaster, "master_damping", -1.0),
        (FourChannelMaster, "C4", np.nan),
        (FourChannelMaster, "start", [np.inf]),
        (FourChannelSlave, "slave_damping", np.eye(3)),
        (FourChannelSlave, "C5", None),
    ],
)
def test_bad_parameters_of_the_blocks(block, name, value):
    with pytest.raises(ValueError, match=name):
        Make(block, **{name: value})

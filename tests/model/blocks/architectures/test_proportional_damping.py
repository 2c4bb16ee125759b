"""P+d: the blocks are its equations, and the gains keep to its theorem."""

from dataclasses import replace

import numpy as np
import pytest
from block_checks import AssertFeedthroughIsReal, Block, Feedthrough, RandomInputs
from grids import Slow
from numpy.testing import assert_allclose, assert_array_equal
from runs import TASKS

from teleop_drake.model.blocks.architectures.proportional_damping import (
    ProportionalDampingConfig,
    ProportionalMaster,
    ProportionalSlave,
)
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.stations import ResolveController
from teleop_drake.model.tasks.metrics import RunMetrics

KIND = "proportional_damping"
M = np.array([[2.0, 0.3], [0.3, 1.0]])
B = np.diag([0.4, 0.0])
K = np.array([[5.0, 1.0], [1.0, 4.0]])
START = [0.5, -0.2]
CONFIG = ProportionalDampingConfig(
    master_mass=M, stiffness=K, master_damping=B, slave_damping=2 * B
)


def test_the_master_by_its_equation():
    block = ProportionalMaster(CONFIG, start=START)
    inputs = RandomInputs(block, 1)
    F_h = inputs["haptic_force"]
    x_s = inputs["return_packet"]
    x_m = np.array([0.1, 0.2])
    v_m = np.array([0.3, -0.4])
    now = Block(block, inputs, np.concatenate([x_m, v_m]))
    force = F_h - K @ (x_m - x_s) - B @ v_m
    expected = np.concatenate([v_m, np.linalg.solve(M, force)])
    assert_allclose(now.Rate(), expected, rtol=1e-12)
    assert_array_equal(now["felt_position"], x_s)
    assert_array_equal(now["felt_velocity"], v_m)
    assert_array_equal(now["forward_packet"], x_m)
    assert_allclose(now["coupling_force"], K @ (x_m - x_s), rtol=1e-12)
    AssertFeedthroughIsReal(block)
    assert Feedthrough(block) == {
        "felt_position": {"return_packet"},
        "coupling_force": {"return_packet"},
    }
    start = Block(block, RandomInputs(block, 0))
    assert_array_equal(start["forward_packet"], START)
    assert_array_equal(start["felt_velocity"], [0.0, 0.0])


def test_the_slave_by_its_equation():
    block = ProportionalSlave(CONFIG, num_axes=2)
    inputs = RandomInputs(block, 1)
    p = inputs["tool_position"]
    now = Block(block, inputs)
    expected = K @ (inputs["forward_packet"] - p) - 2 * B @ inputs["tool_velocity"]
    assert_allclose(now["control_force"], expected, rtol=1e-12)
    assert_array_equal(now["return_packet"], p)
    AssertFeedthroughIsReal(block)


@pytest.mark.parametrize(
    ("name", "delay"),
    Slow([("two_dof_collision", 0.3), *zip(TASKS, (0.0, 0.1, 0.1, 0.3), strict=True)]),
)
def test_thesis_tasks_are_stable(name, delay):
    scenario = LoadScenario(
        name,
        [
            f"controller.kind={KIND}",
            f"forward_channel.delay={delay}",
            f"return_channel.delay={delay}",
            "simulator.accuracy=1e-6",
        ],
    )
    config = ResolveController(scenario)
    K = config.stiffness[0, 0]
    B = config.slave_damping[0, 0]
    assert (2 * delay * K) ** 2 < 4 * B**2
    assert pytest.approx(0.92) == B
    if delay == 0.1:
        assert pytest.approx((0.2 * K) ** 2 * 2) == 4 * B**2
    if delay == 0:
        assert pytest.approx(0.5 * 25**2) == K
    metrics = RunMetrics(simulate(scenario, engine="auto"))
    assert not metrics["diverged"]
    assert metrics["start_velocity_overshoot"] < 0.1 * abs(scenario.surgeon.velocity[0])


def test_bad_parameters_of_the_blocks():
    with pytest.raises(ValueError, match="master_mass"):
        ProportionalMaster(replace(CONFIG, master_mass=0.0), start=START)
    with pytest.raises(ValueError, match="start"):
        ProportionalMaster(CONFIG, start=[np.nan])
    with pytest.raises(ValueError, match="stiffness = null"):
        ProportionalSlave(replace(CONFIG, stiffness=None), num_axes=2)

"""Tests of the Puma 560, which pushes its needle through tissue onto bone."""

import numpy as np
import pytest
import standard_dh
from pydrake.math import RotationMatrix

from teleop_drake.model.blocks.robots.inverse_kinematics import ToolRotation
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import RunMetrics

NAME = "puma560_insertion"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "settling", "peak"),
    [
        (NAME, 0.706, 3.7427),
        ("puma560_needle_insertion", 1.10, 7.5349),
        ("puma560_wall_sliding", 2.41, 7.5864),
    ],
)
def test_stiff_walls_leave_psi_above_its_limit(name, settling, peak):
    """The runs converge, and Psi stays far from its limit."""
    wall = {"kind": "hunt_crossley", "start": 0.76, "stiffness": 2e4, "damping": 1.5}
    changes = {"environment": wall} if name == NAME else {}
    for accuracy in (1e-6, 1e-8):
        scenario = LoadScenario(name, {**changes, "simulator.accuracy": accuracy})
        run = simulate(scenario, engine="compiled")
        collision = RunMetrics(run)["collision"]
        assert collision["peak_force"] == pytest.approx(peak, abs=1.5e-4)
        assert collision["settling_time"] == pytest.approx(settling, rel=5e-3)
        least = np.linalg.svd(run["psi"].reshape(-1, 3, 3), compute_uv=False).min()
        assert least > 5 * scenario.controller.minimum_psi


@pytest.mark.slow
def test_the_needle_keeps_its_direction():
    """The direction is constant to 1 degree, although the law moves only the tip."""
    fast = {"surgeon.velocity": [0.15, 0.0, 0.0], "duration": 1.6}
    scenario = LoadScenario(NAME, fast)
    run = simulate(scenario, engine="compiled")
    plant = scenario.robot.LoadPlant()
    assert RunMetrics(run)["collision"]["peak_force"] > 4
    first, *others = (ToolRotation(plant, q) for q in run["joint_position"][::10])
    for R in others:
        assert RotationMatrix(first.T @ R).ToAngleAxis().angle() < np.radians(1)


@pytest.mark.slow
def test_a_straight_wrist_on_the_way_leaves_the_run_finite():
    """The arm comes closer to a straight wrist than is allowed for a start."""
    q = [0.0, 0.5, -2.2, 0.0, 0.1, 0.0]
    changes = {
        "robot.posture": q,
        "robot.start": standard_dh.tool_pose(q)[1].tolist(),
        "surgeon.velocity": [0.3, 0.0, 0.0],
        "environment.layers": [],
        "controller.kind": "direct_force",
        "robot.hold_frequency": 2.0,
        "duration": 2.5,
    }
    run = simulate(LoadScenario(NAME, changes), engine="compiled")
    assert run.termination == "completed"
    assert np.abs(run["joint_position"][:, 4]).min() < 0.05
    assert all(np.isfinite(x).all() for x in run.signals.values())

"""The controller's block of chapter 3; tests/test_network_tracking.py has the loop."""

import appendix_a as arm
import numpy as np
import pytest
from block_checks import Block, Feedthrough, RandomInputs
from numpy.testing import assert_allclose
from slopes import Slopes

from teleop_drake.model.blocks.robots import TwoLinkArmConfig
from teleop_drake.model.blocks.systems.network_tracking_controller import (
    NetworkTrackingController,
)
from teleop_drake.model.laws.gaussian_network import GaussianNetwork
from teleop_drake.model.laws.tracking import TrackingGains

NETWORK = GaussianNetwork(lower=[-1, -1], upper=[1, 1], count=[4, 5], width=1.0)


@pytest.fixture(scope="module")
def block():
    return NetworkTrackingController(
        gains=TrackingGains(
            Lambda=np.diag([35.0, 20.0]), G1=np.diag([1.0, 2.0]), beta=5.0, nu=0.1
        ),
        network=NETWORK,
        plant=TwoLinkArmConfig().LoadPlant([0, -9.81]),
    )


@pytest.mark.parametrize("seed", range(2))
def test_law_with_the_dynamics_of_appendix_a(block, seed):
    x = RandomInputs(block, seed)
    x["joint_position"][1] = 1.3
    W = np.random.default_rng(seed + 9).normal(size=(2, NETWORK.num_functions))
    now = Block(block, x, W.ravel())
    q = x["joint_position"]
    qdot = x["joint_velocity"]
    J_inv = np.linalg.inv(arm.J(q))
    h = 1e-6
    J_dot = (arm.J(q + h * qdot) - arm.J(q - h * qdot)) / (2 * h)
    M_r = J_inv.T @ arm.M(q) @ J_inv  # (2.8)
    h_r = J_inv.T @ (arm.C(q, qdot) @ qdot + arm.G(q)) - M_r @ J_dot @ qdot
    e = x["tool_position"] - x["desired_position"]
    e_dot = x["tool_velocity"] - x["desired_velocity"]
    s = e_dot + np.array([35, 20]) * e
    Phi = NETWORK.evaluate(x["tool_position"])
    a = x["desired_acceleration"] - np.array([35, 20]) * e_dot - np.array([1, 2]) * s
    for name, expected in {
        "control_force": W @ Phi + h_r + M_r @ a,
        "disturbance_estimate": W @ Phi,
        "weights_1": W.ravel(),
        "auxiliary_error": s,
    }.items():
        assert_allclose(now[name], expected, rtol=1e-6, atol=1e-6)
    g = np.linalg.solve(M_r, s)
    assert_allclose(
        now.Rate(),
        (-5 * (np.outer(g, Phi) + 0.1 * W)).ravel(),
        rtol=1e-6,
        atol=1e-6,
    )


def test_feedthrough_and_start(block):
    inputs = set(RandomInputs(block, 0))
    errors = {name for name in inputs if not name.startswith("joint")}
    assert Feedthrough(block) == {
        "control_force": inputs,
        "disturbance_estimate": {"tool_position"},
        "auxiliary_error": errors - {"desired_acceleration"},
    }
    weights = Block(block, {})["weights_1"]
    assert weights.tolist() == [0.0] * 2 * NETWORK.num_functions


def test_it_has_its_slopes(block):
    assert Slopes(block) == "yes"


def test_size_of_the_network():
    with pytest.raises(
        ValueError, match=r"network.num_inputs = .*: must be 2, one for"
    ):
        NetworkTrackingController(
            gains=TrackingGains(Lambda=np.eye(2), G1=np.eye(2), beta=5.0, nu=0.1),
            network=GaussianNetwork(lower=[0], upper=[1], count=[3], width=1.0),
            plant=TwoLinkArmConfig().LoadPlant(),
        )

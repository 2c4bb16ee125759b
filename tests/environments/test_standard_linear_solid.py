"""Tests of the kind `standard_linear_solid`."""

import numpy as np
import pytest
from blocks import Block
from walls import Refusal

from teleop_drake.environments import StandardLinearSolidConfig

NORMAL = np.array([0.8, 0.6])
ALONG = np.outer(NORMAL, NORMAL)


def test_slopes():
    """Of the force at rest: what it is to analyze and to the architectures."""
    config = StandardLinearSolidConfig(
        start=0.0, direction=NORMAL, stiffness=5.0, branch_stiffness=20.0
    )
    K, D = config.StiffnessAndDamping(0.02 * NORMAL)
    np.testing.assert_allclose(K, 25 * ALONG, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(D, 0 * ALONG, rtol=1e-6, atol=1e-6)


def test_equation():
    config = StandardLinearSolidConfig(
        start=0.0, direction=NORMAL, stiffness=5.0, branch_stiffness=20.0
    )
    config.relaxation_time = 2.0
    motion = {"tool_position": 0.03 * NORMAL, "tool_velocity": [9.0, 9.0]}
    now = Block(config.MakeEnvironment([0, 0]), motion, [0.01])
    expected = (5 * 0.03 + 20 * (0.03 - 0.01)) * NORMAL
    np.testing.assert_allclose(now["environment_force"], expected, rtol=1e-12)
    np.testing.assert_allclose(now.Rate(), [(0.03 - 0.01) / 2.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("stiffness: -1", "stiffness = -1.0"),
        ("branch_stiffness: 0", "branch_stiffness = 0.0"),
        ("relaxation_time: null", "relaxation_time = null"),
        ("relaxation_time: 0", "relaxation_time = 0.0"),
    ],
)
def test_refuses(change, message):
    assert Refusal("standard_linear_solid", change).startswith(
        f"environment.{message}: must be"
    )

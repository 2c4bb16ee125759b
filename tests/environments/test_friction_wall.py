"""Tests of the kind `friction_wall`."""

import numpy as np
import pytest
from walls import Refusal

from teleop_drake.environments import FrictionWallConfig

NORMAL = np.array([0.8, 0.6])
ALONG = np.outer(NORMAL, NORMAL)


def test_slopes():
    """Of the force at rest: what it is to analyze and to the architectures."""
    config = FrictionWallConfig(
        start=0.0, direction=NORMAL, stiffness=150.0, friction=0.4, creep_speed=0.1
    )
    K, D = config.StiffnessAndDamping(0.02 * NORMAL)
    np.testing.assert_allclose(K, 150 * ALONG, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        D, 150 * 0.02 * 0.4 / 0.1 * (np.eye(2) - ALONG), rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("friction: -0.1", "friction = -0.1"),
        ("creep_speed: 0", "creep_speed = 0.0"),
        ("damping: -1", "damping = -1.0"),
    ],
)
def test_refuses(change, message):
    assert Refusal("friction_wall", change).startswith(
        f"environment.{message}: must be"
    )

"""Tests of the kind `hunt_crossley`."""

import numpy as np
import pytest
from walls import Refusal

from teleop_drake.environments import HuntCrossleyConfig

NORMAL = np.array([0.8, 0.6])
ALONG = np.outer(NORMAL, NORMAL)


def test_slopes():
    """Of the force at rest: what it is to analyze and to the architectures."""
    config = HuntCrossleyConfig(
        start=0.0, direction=NORMAL, stiffness=2000.0, damping=1.5
    )
    K, D = config.StiffnessAndDamping(0.02 * NORMAL)
    np.testing.assert_allclose(K, 2000 * 1.5 * 0.02**0.5 * ALONG, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        D, 2000 * 0.02**1.5 * 1.5 * 1.5 * ALONG, rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("stiffness: 0", "stiffness = 0.0"),
        ("exponent: -1", "exponent = -1.0"),
        ("exponent: 0.5", "exponent = 0.5"),
        ("damping: -1", "damping = -1.0"),
        ("friction: 1", "friction = 1.0"),
    ],
)
def test_refuses(change, message):
    assert Refusal("hunt_crossley", change).startswith(
        f"environment.{message}: must be"
    )

"""The master's end of a wave line by itself, against its equation."""

import numpy as np
import pytest
from blocks import AssertFeedthroughIsReal, Block, Feedthrough, RandomInputs
from scipy.linalg import sqrtm

from teleop_drake.architectures.wave_variables import WaveMaster

b, D = np.array([[2.0, 0.3], [0.3, 1.0]]), np.diag([0.4, 0.1])
START = [0.5, -0.2]


def Make(bandwidth=None, damping=D):
    return WaveMaster(
        impedance=b, damping=damping, start=START, scaling=0.9, bandwidth=bandwidth
    )


@pytest.mark.parametrize("bandwidth", [None, 30.0])
def test_equation(bandwidth):
    block = Make(bandwidth)
    inputs = RandomInputs(block, 1)
    F_h = inputs["haptic_force"]
    received, p = inputs["return_packet"].reshape(2, 2)
    x_m = np.array([0.1, 0.2])
    w = np.array([0.3, -0.4]) if bandwidth else 0.9 * received
    now = Block(block, inputs, np.concatenate([x_m, w]) if bandwidth else x_m)
    root = sqrtm(2 * b)
    v = np.linalg.solve(b + D, F_h + root @ w)
    np.testing.assert_allclose(now["felt_velocity"], v, rtol=1e-12)
    sent = np.concatenate([root @ v - w, x_m])
    np.testing.assert_allclose(now["forward_packet"], sent, rtol=1e-12)
    np.testing.assert_allclose(now["master_power"], (F_h - D @ v) * v, rtol=1e-12)
    np.testing.assert_array_equal(now["felt_position"], p)
    np.testing.assert_array_equal(now["master_position"], x_m)
    rate = [*v, *30.0 * (0.9 * received - w)] if bandwidth else v
    np.testing.assert_allclose(now.Rate(), rate, rtol=1e-12)


@pytest.mark.parametrize("bandwidth", [None, 30.0])
@pytest.mark.parametrize("damping", [D, b], ids=["unmatched", "matched"])
def test_feedthrough_and_start(bandwidth, damping):
    block = Make(bandwidth, damping)
    AssertFeedthroughIsReal(block)
    sent = Feedthrough(block)["forward_packet"]
    reflects = bandwidth is None and damping is D
    assert sent == {"haptic_force", *(["return_packet"] if reflects else [])}
    start = Block(block, RandomInputs(block, 0))
    np.testing.assert_array_equal(start["master_position"], START)

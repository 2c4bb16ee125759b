"""The block of the four-channel master by itself, against its equation."""

import numpy as np
import pytest
from blocks import AssertFeedthroughIsReal, Block, RandomInputs

from teleop_drake.architectures.four_channel import FourChannelMaster

M, B = np.array([[2.0, 0.3], [0.3, 1.0]]), np.diag([0.4, 0.0])
B_c, K_c = np.diag([1.0, 2.0]), np.array([[5.0, 1.0], [1.0, 4.0]])
START = np.array([0.5, -0.2])


def Make(bandwidth=None):
    return FourChannelMaster(
        mass=M,
        damping=B,
        local_damping=B_c,
        local_stiffness=K_c,
        C2=0.9,
        C4=1.1,
        C6=-0.2,
        start=START,
        acceleration_bandwidth=bandwidth,
    )


@pytest.mark.parametrize("bandwidth", [None, 30.0])
def test_equation(bandwidth):
    block = Make(bandwidth)
    inputs = RandomInputs(block, 1)
    F_h = inputs["haptic_force"]
    p, v, F_e, *rest = inputs["return_packet"].reshape(-1, 2)
    x = np.random.default_rng(2).normal(size=6 if bandwidth else 4)
    x_m, v_m = x[:2], x[2:4]
    now = Block(block, inputs, x)
    force = 0.8 * F_h - 0.9 * F_e - (B + B_c) @ v_m - K_c @ (x_m - START)
    force += 1.1 * ((B + B_c) @ v + K_c @ (p - START))
    sent = [x_m, v_m, F_h]
    if bandwidth:
        (a,) = rest
        force += 1.1 * M @ a
        a_m = bandwidth * (v_m - x[4:])
        sent.append(a_m)
        np.testing.assert_allclose(now.Rate()[4:], a_m, rtol=1e-12)
    expected = np.concatenate([v_m, np.linalg.solve(M, force)])
    np.testing.assert_allclose(now.Rate()[:4], expected, rtol=1e-12)
    np.testing.assert_array_equal(now["forward_packet"], np.concatenate(sent))
    np.testing.assert_array_equal(now["felt_position"], p)
    np.testing.assert_array_equal(now["felt_velocity"], v_m)


@pytest.mark.parametrize("bandwidth", [None, 30.0])
def test_feedthrough_and_start(bandwidth):
    block = Make(bandwidth)
    AssertFeedthroughIsReal(block)
    start = Block(block, RandomInputs(block, 0))
    np.testing.assert_array_equal(start["forward_packet"][:4], [*START, 0.0, 0.0])

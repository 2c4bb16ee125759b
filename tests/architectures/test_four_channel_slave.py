"""The block of the four-channel slave by itself, against its equation."""

import numpy as np
import pytest
from blocks import AssertFeedthroughIsReal, Block, RandomInputs

from teleop_drake.architectures.four_channel import FourChannelSlave

M, B = np.array([[2.0, 0.3], [0.3, 1.0]]), np.diag([0.4, 0.0])
B_c, K_c = np.diag([1.0, 2.0]), np.array([[5.0, 1.0], [1.0, 4.0]])
START = np.array([0.5, -0.2])


def Make(bandwidth=None):
    return FourChannelSlave(
        mass=M,
        damping=B,
        local_damping=B_c,
        local_stiffness=K_c,
        C1=1.1,
        C3=0.9,
        C5=-0.2,
        start=START,
        acceleration_bandwidth=bandwidth,
    )


@pytest.mark.parametrize("bandwidth", [None, 30.0])
def test_equation(bandwidth):
    block = Make(bandwidth)
    inputs = RandomInputs(block, 1)
    x_m, v_m, F_h, *rest = inputs["forward_packet"].reshape(-1, 2)
    p, v = inputs["tool_position"], inputs["tool_velocity"]
    F_e = inputs["environment_force"]
    v_f = np.array([0.3, -0.4]) if bandwidth else None
    now = Block(block, inputs, v_f)
    force = 0.9 * F_h + 0.2 * F_e - B_c @ v - K_c @ (p - START)
    force += 1.1 * ((B + B_c) @ v_m + K_c @ (x_m - START))
    sent = [p, v, F_e]
    if bandwidth:
        (a_m,) = rest
        force += 1.1 * M @ a_m
        sent.append(bandwidth * (v - v_f))
        np.testing.assert_allclose(now.Rate(), sent[-1], rtol=1e-12)
    np.testing.assert_allclose(now["control_force"], force, rtol=1e-12)
    np.testing.assert_allclose(now["return_packet"], np.concatenate(sent), rtol=1e-12)


@pytest.mark.parametrize("bandwidth", [None, 30.0])
def test_feedthrough(bandwidth):
    AssertFeedthroughIsReal(Make(bandwidth))

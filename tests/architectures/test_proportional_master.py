"""The handle of P+d by itself, against its equation."""

import numpy as np
from blocks import AssertFeedthroughIsReal, Block, Feedthrough, RandomInputs

from teleop_drake.architectures.proportional_damping import ProportionalMaster

M, B = np.array([[2.0, 0.3], [0.3, 1.0]]), np.diag([0.4, 0.0])
K, START = np.array([[5.0, 1.0], [1.0, 4.0]]), [0.5, -0.2]


def Make():
    return ProportionalMaster(mass=M, stiffness=K, damping=B, start=START)


def test_equation():
    block = Make()
    inputs = RandomInputs(block, 1)
    F_h, x_s = inputs["haptic_force"], inputs["return_packet"]
    x_m, v_m = np.array([0.1, 0.2]), np.array([0.3, -0.4])
    now = Block(block, inputs, np.concatenate([x_m, v_m]))
    force = F_h - K @ (x_m - x_s) - B @ v_m
    expected = np.concatenate([v_m, np.linalg.solve(M, force)])
    np.testing.assert_allclose(now.Rate(), expected, rtol=1e-12)
    np.testing.assert_array_equal(now["felt_position"], x_s)
    np.testing.assert_array_equal(now["felt_velocity"], v_m)
    np.testing.assert_array_equal(now["forward_packet"], x_m)
    np.testing.assert_allclose(now["coupling_force"], K @ (x_m - x_s), rtol=1e-12)


def test_feedthrough_and_start():
    block = Make()
    AssertFeedthroughIsReal(block)
    assert Feedthrough(block) == {
        "felt_position": {"return_packet"},
        "coupling_force": {"return_packet"},
    }
    start = Block(block, RandomInputs(block, 0))
    np.testing.assert_array_equal(start["forward_packet"], START)
    np.testing.assert_array_equal(start["felt_velocity"], [0.0, 0.0])

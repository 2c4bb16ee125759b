"""The slave of P+d by itself, against its equation."""

import numpy as np
from blocks import AssertFeedthroughIsReal, Block, Feedthrough, RandomInputs

from teleop_drake.architectures.proportional_damping import ProportionalSlave

K, B = np.array([[5.0, 1.0], [1.0, 4.0]]), np.array([[0.4, 0.1], [0.1, 0.2]])


def test_equation():
    block = ProportionalSlave(stiffness=K, damping=B)
    inputs = RandomInputs(block, 1)
    p = inputs["tool_position"]
    now = Block(block, inputs)
    expected = K @ (inputs["forward_packet"] - p) - B @ inputs["tool_velocity"]
    np.testing.assert_allclose(now["control_force"], expected, rtol=1e-12)
    np.testing.assert_array_equal(now["return_packet"], p)


def test_feedthrough():
    block = ProportionalSlave(stiffness=K, damping=B)
    AssertFeedthroughIsReal(block)
    assert Feedthrough(block) == {
        "control_force": {"forward_packet", "tool_position", "tool_velocity"},
        "return_packet": {"tool_position"},
    }

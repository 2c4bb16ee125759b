"""The slave's end of a wave line by itself, against its equation."""

import numpy as np
import pytest
from blocks import AssertFeedthroughIsReal, Block, Feedthrough, RandomInputs
from scipy.linalg import sqrtm

from teleop_drake.architectures.wave_variables import WaveSlave

b = np.array([[2.0, 0.3], [0.3, 1.0]])
CASES = [(None, 0.0), (30.0, 0.0), (None, 2.0), (30.0, 2.0)]


def Make(bandwidth, drift_correction):
    return WaveSlave(
        impedance=b,
        scaling=0.9,
        bandwidth=bandwidth,
        drift_correction=drift_correction,
    )


@pytest.mark.parametrize(("bandwidth", "rate"), CASES)
def test_equation(bandwidth, rate):
    block = Make(bandwidth, rate)
    inputs = RandomInputs(block, 1)
    received, x_m = inputs["forward_packet"].reshape(2, 2)
    p, v = inputs["tool_position"], inputs["tool_velocity"]
    u = np.array([0.3, -0.4]) if bandwidth else 0.9 * received
    now = Block(block, inputs, u if bandwidth else None)
    if bandwidth:
        expected = 30.0 * (0.9 * received - u)
        np.testing.assert_allclose(now.Rate(), expected, rtol=1e-12)
    # |u| does not grow on any axis.
    correction = rate * sqrtm(b / 2) @ (x_m - p)
    u = np.clip(u + correction, -np.abs(u), np.abs(u))
    root = sqrtm(2 * b)
    force = root @ u - b @ v
    np.testing.assert_allclose(now["control_force"], force, rtol=1e-12)
    sent = np.concatenate([root @ v - u, p])
    np.testing.assert_allclose(now["return_packet"], sent, rtol=1e-12)
    np.testing.assert_allclose(now["slave_power"], force * v, rtol=1e-12)


def test_feedthrough():
    for case in CASES[:2]:
        AssertFeedthroughIsReal(Make(*case))
    packet, v = "forward_packet", "tool_velocity"
    assert Feedthrough(Make(None, 0.0))["control_force"] == {packet, v}
    assert Feedthrough(Make(30.0, 0.0))["control_force"] == {v}
    for bandwidth in (None, 30.0):
        found = Feedthrough(Make(bandwidth, 2.0))
        assert all(x == {packet, "tool_position", v} for x in found.values())
        assert len(found) == 3

"""The block of the disturbance in chapter 3."""

import numpy as np
import pytest

from teleop_drake.systems.disturbance_force import DisturbanceForce


def evaluate(block, r, v):
    context = block.CreateDefaultContext()
    block.GetInputPort("tool_position").FixValue(context, r)
    block.GetInputPort("tool_velocity").FixValue(context, v)
    return block.GetOutputPort("environment_force").Eval(context).tolist()


def test_force():
    gain = np.diag([1.0, 10.0])
    linear = DisturbanceForce(kind="linear", gain=gain)
    assert evaluate(linear, [2, 3], [5, 7]) == [2, 30]
    coupled = DisturbanceForce(kind="coupled", gain=gain)
    assert evaluate(coupled, [2, 3], [5, 7]) == [54, 510]
    one_axis = DisturbanceForce(kind="linear", gain=[[3.0]])
    assert evaluate(one_axis, [2], [5]) == [6]


@pytest.mark.parametrize("kind, feels_velocity", [("linear", False), ("coupled", True)])
def test_feedthrough(kind, feels_velocity):
    block = DisturbanceForce(kind=kind, gain=np.eye(2))
    position, velocity = (
        block.GetInputPort(name).get_index()
        for name in ("tool_position", "tool_velocity")
    )
    assert block.HasDirectFeedthrough(position, 0)
    assert block.HasDirectFeedthrough(velocity, 0) == feels_velocity


@pytest.mark.parametrize(
    "kind, gain, message",
    [
        ("cubic", np.eye(2), "kind = 'cubic': must be one of linear, coupled"),
        ("linear", [1.0, 2.0], "gain = .*must be a square, finite matrix"),
        ("linear", [[np.nan]], "gain = .*must be a square, finite matrix"),
        ("coupled", np.eye(3), "gain = .*must be 2 x 2 for kind coupled"),
    ],
)
def test_bad_parameters(kind, gain, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        DisturbanceForce(kind=kind, gain=gain)

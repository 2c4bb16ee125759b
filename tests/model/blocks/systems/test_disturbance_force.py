"""The block of the disturbance in chapter 3."""

import numpy as np
import pytest
from block_checks import Block, Feedthrough

from teleop_drake.model.blocks.systems.disturbance_force import DisturbanceForce


def test_force():
    gain = np.diag([1.0, 10.0])
    inputs = {"tool_position": [2, 3], "tool_velocity": [5, 7]}
    for kind, force in (("linear", [2, 30]), ("coupled", [54, 510])):
        block = DisturbanceForce(kind=kind, gain=gain)
        assert Block(block, inputs)["environment_force"].tolist() == force
        felt = set(inputs) if kind == "coupled" else {"tool_position"}
        assert Feedthrough(block) == {"environment_force": felt}


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

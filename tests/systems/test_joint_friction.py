"""The block of the joints' friction."""

import pytest
from blocks import Block

from teleop_drake.compiler.check import CheckKernel
from teleop_drake.systems.joint_friction import JointFriction
from teleop_drake.validation import ScenarioError


def test_fast_joints_feel_their_own_friction():
    block = JointFriction(forward=[2.0, 0.5], backward=[1.0, 0.7], speed=0.02)
    CheckKernel(block)
    torque = Block(block, {"joint_velocity": [3e3, -3e3]})["friction_torque"]
    assert torque == pytest.approx([-2.0, 0.7])


@pytest.mark.parametrize(
    "fields, message",
    [
        ({"forward": [-1.0, 0.0]}, r"forward = \[-1.0, 0.0\]: must be finite numbers"),
        ({"backward": [1.0]}, "backward = .* one for each joint"),
        ({"speed": 0.0}, "speed = 0.0: must be a finite number > 0"),
    ],
)
def test_bad_parameters(fields, message):
    good = {"forward": [1.0, 1.0], "backward": [1.0, 1.0], "speed": 0.1}
    with pytest.raises(ScenarioError, match=message):
        JointFriction(**{**good, **fields})

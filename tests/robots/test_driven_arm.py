"""What an arm of one's own does beside the task."""

from pathlib import Path

import numpy as np
import pytest

from teleop_drake.compiler.check import CheckKernel
from teleop_drake.robots import ArmConfig
from teleop_drake.validation import ScenarioError

FILE = str(Path(__file__).parents[2] / "diagrams" / "own_arm.urdf")


def test_any_arm_can_be_held_and_carried():
    """With gravity it rests where it starts, and its free joints hold their posture."""
    config = ArmConfig(
        file=FILE,
        start=np.array([0.45]),
        posture=np.array([0.2, -0.7, 1.5]),
        gravity=np.array([0, 0, -9.81]),
        gravity_compensation=True,
        payload=0.3,
        hold="posture",
    )
    config.Check("robot")
    robot = config.MakeRobot()
    CheckKernel(robot, num_states=3)
    context = robot.CreateDefaultContext()
    for name in ("control_force", "environment_force"):
        robot.GetInputPort(name).FixValue(context, [0.0])
    rates = robot.EvalTimeDerivatives(context).CopyToVector()
    np.testing.assert_allclose(rates, 0, atol=1e-10)
    x = context.get_continuous_state_vector().CopyToVector()
    x[:3] += 0.01
    context.SetContinuousState(x)
    assert np.abs(robot.EvalTimeDerivatives(context).CopyToVector()).max() > 0.1


def test_an_arm_of_three_joints_cannot_hold_its_orientation():
    arm = ArmConfig(file=FILE, start=np.array([0.45, 0, 0.2]), hold="orientation")
    with pytest.raises(ScenarioError, match=r"robot.hold = .* 3 axes and 3 joints"):
        arm.Check("robot")

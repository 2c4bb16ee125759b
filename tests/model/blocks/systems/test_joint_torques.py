"""Torques on joints: what carries an arm's weight, and friction."""

import numpy as np
import pytest
from block_checks import Block
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.robots import Puma560Config
from teleop_drake.model.blocks.robots.inverse_kinematics import ToolJacobian
from teleop_drake.model.blocks.systems.joint_friction import JointFriction


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


@pytest.mark.parametrize("payload, error", [(2.0, 0.0), (2.0, -0.5)])
def test_a_wrong_payload_pulls_at_the_tool(payload, error):
    """At rest M dv/dt = J^T (error g), and nothing moves if there is no error."""
    config = Puma560Config(
        start=np.array([0.6, -0.15, 0.4]),
        friction=0.0,
        hold="none",
        payload=payload,
        payload_error=error,
    )
    robot = config.MakeRobot()
    context = robot.CreateDefaultContext()
    for name in ("control_force", "environment_force"):
        robot.GetInputPort(name).FixValue(context, np.zeros(3))
    v_dot = robot.EvalTimeDerivatives(context).CopyToVector()[6:]
    plant = robot.GetSubsystemByName("plant")
    plant_context = plant.GetMyContextFromRoot(context)
    J = ToolJacobian(plant, plant_context, 3)
    torque = plant.CalcMassMatrix(plant_context) @ v_dot
    assert_allclose(torque, J.T @ [0, 0, 9.80665 * error], atol=1e-10)

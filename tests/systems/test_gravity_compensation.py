"""The torque that carries an arm's weight."""

import numpy as np
import pytest

from teleop_drake.robots import Puma560Config
from teleop_drake.robots.inverse_kinematics import ToolJacobian


@pytest.mark.parametrize("payload, error", [(0.0, 0.0), (2.0, 0.0), (2.0, -0.5)])
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
    np.testing.assert_allclose(torque, J.T @ [0, 0, 9.80665 * error], atol=1e-10)

"""What holds the joints of a Puma that the task leaves free."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from slopes import Slopes

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.robots import Puma560Config
from teleop_drake.model.blocks.robots.inverse_kinematics import ToolRotation
from teleop_drake.model.blocks.systems.posture_hold import PostureHold
from teleop_drake.model.laws.task_space import PostureGains, orientation_error

START = np.array([0.6, -0.15, 0.4])


POSTURE = Puma560Config(start=START).JointPositions(START)


def evaluate(hold, q, v, force=(1.0, -2.0, 0.5)):
    """Accelerations of the joints and of the tool."""
    robot = Puma560Config(start=START, hold=hold, friction=0.0).MakeRobot()
    context = robot.CreateDefaultContext()
    context.SetContinuousState(np.concatenate([q, v]))
    robot.GetInputPort("control_force").FixValue(context, force)
    robot.GetInputPort("environment_force").FixValue(context, [0.3, 0.0, 0.0])
    v_dot = robot.EvalTimeDerivatives(context).CopyToVector()[6:]
    return v_dot, np.array(robot.GetOutputPort("tool_acceleration").Eval(context))


@pytest.mark.parametrize("hold", ["posture", "orientation"])
def test_it_does_not_accelerate_the_tool(hold):
    """Whatever the arm does: the task's forces find the same arm as without it."""
    rng = np.random.default_rng(0)
    for _ in range(3):
        q = POSTURE + 0.05 * rng.normal(size=6)
        v = 0.1 * rng.normal(size=6)
        free = evaluate("none", q, v)
        held = evaluate(hold, q, v)
        assert_allclose(held[1], free[1], atol=1e-9)
        assert np.abs(held[0] - free[0]).max() > 0.1


def test_it_turns_the_tool_back():
    """At rest it adds the angular acceleration -w^2 sin(angle) axis."""
    rest = np.zeros(6)
    q = POSTURE + np.array([0, 0, 0, 0.02, -0.03, 0.01])
    added = evaluate("orientation", q, rest)[0] - evaluate("none", q, rest)[0]
    plant = Puma560Config(start=START).LoadPlant()
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, np.append(q, added))
    tool = plant.GetBodyByName("tool")
    alpha = plant.EvalBodySpatialVelocityInWorld(context, tool).rotational()
    e = orientation_error(ToolRotation(plant, POSTURE), ToolRotation(plant, q))
    assert_allclose(alpha, -(10.0**2) * e, atol=1e-9)


def Hold(**changes):
    given = {
        "plant": Puma560Config(start=START).LoadPlant(),
        "num_axes": 3,
        "tool_name": "tool",
        "joint_positions": POSTURE,
        "gains": PostureGains(frequency=10.0, damping_ratio=1, near=1e-3, damping=0.1),
        "keeps_orientation": True,
    }
    return PostureHold(**(given | changes))


def test_either_hold_has_its_slopes():
    assert Slopes(Hold()) == Slopes(Hold(keeps_orientation=False)) == "yes"


def test_what_cannot_be_held():
    with pytest.raises(ScenarioError, match="num_axes = 4: must be 3 or less"):
        Hold(num_axes=4)

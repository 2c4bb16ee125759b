import numpy as np
import pytest
from forced_robot import context_with_forces
from numpy.testing import assert_allclose

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.robots import SliderConfig


def test_slider_has_the_dynamics_of_2_12():
    robot = SliderConfig(start=[0.25]).MakeRobot()
    context = context_with_forces(robot, F_c=[0.7], F_e=[0.3])
    context.SetContinuousState([0.25, 2.0])
    acceleration = (0.7 - 0.3 - 0.1 * 2.0) / 0.5
    assert_allclose(
        robot.EvalTimeDerivatives(context).CopyToVector(), [2.0, acceleration]
    )
    assert_allclose(
        robot.GetOutputPort("tool_acceleration").Eval(context), [acceleration]
    )


def test_mass_and_damping_are_in_the_default_context():
    mass = 0.1 + 0.2
    damping = 1e-3
    robot = SliderConfig(start=[0.25], mass=mass, damping=damping).MakeRobot()
    plant = robot.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(robot.CreateDefaultContext())
    assert plant.CalcMassMatrix(context) == np.array([[mass]])
    context = context_with_forces(robot, [0.0], [0.0])
    context.SetContinuousState([0.0, 1.0])
    assert robot.EvalTimeDerivatives(context)[1] == pytest.approx(-damping / mass)


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"start": []}, r"robot.start = \[\]: must be a list of 1, 2 or 3 finite"),
        ({"start": [0.1, 0.2]}, r"robot.start = \[0.1, 0.2\]: must be a list of 1 fin"),
        ({"mass": 0}, "robot.mass = 0: must be a finite number > 0"),
        ({"damping": np.nan}, "robot.damping = nan: must be a finite number >= 0"),
    ],
)
def test_bad_input_gets_one_clear_line(changes, message):
    with pytest.raises(ScenarioError, match=message) as error:
        SliderConfig(**{"start": [0.25], **changes}).Check("robot")
    assert "\n" not in str(error.value)

"""What a robot of one's own gets from the bases."""

from dataclasses import dataclass

import numpy as np
import pytest
from pydrake.systems.primitives import PassThrough

from teleop_drake.robots.base import PlantRobotConfig, PointOf, RobotConfig
from teleop_drake.robots.model_file import LoadModel, ReadModel
from teleop_drake.validation import ScenarioError


@dataclass(kw_only=True, eq=False)
class Point(RobotConfig):
    kind = "point"

    def MakeRobot(self):
        return PassThrough(self.num_axes)


@dataclass(kw_only=True, eq=False)
class Plant(PlantRobotConfig):
    """Nothing but LoadPlant."""

    kind = "plant"

    def LoadPlant(self, gravity=None):
        return LoadModel(ReadModel("two_link_arm"), gravity)

    def Posture(self, plant):
        return np.array([0.0, 1.0])


def test_a_point_is_its_own_joint_position():
    robot = Point(start=np.array([0.1, 0.2, 0.3]))
    robot.Check("robot")
    assert robot.num_axes == 3
    assert robot.JointPositions([4, 5, 6]).tolist() == [4.0, 5.0, 6.0]


@pytest.mark.parametrize("start", [[], [0.0] * 4, [np.nan], 0.5, [[0.1]]])
def test_bad_starts(start):
    with pytest.raises(ScenarioError, match=r"robot.start.* must be a list of 1, 2 or"):
        Point(start=start).Check("robot")


def test_a_plant_is_posed_and_wired():
    config = Plant(start=np.array([0.85, 0.1]))
    config.Check("robot")
    robot = config.MakeRobot()
    context = robot.CreateDefaultContext()
    position = robot.GetOutputPort("tool_position").Eval(context)
    np.testing.assert_allclose(position, [0.85, 0.1], atol=1e-12)
    with pytest.raises(ScenarioError, match=r"robot.start = .*no nearer than"):
        Plant(start=np.array([3.0, 0.0])).Check("robot")


def test_the_bases_are_abstract():
    for base in (RobotConfig, PlantRobotConfig):
        with pytest.raises(TypeError, match="abstract"):
            base(start=[0.0])


@pytest.mark.parametrize("p_WT", [None, [0.1], [0.1, np.inf], [[0.1, 0.2]]])
def test_points_of_the_wrong_shape(p_WT):
    with pytest.raises(ScenarioError, match=r"start = .* must be a list of 2 finite"):
        PointOf(p_WT, 2)

"""What a robot of one's own gets from the bases; kinds by name, model files."""

import dataclasses
import inspect
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.primitives import PassThrough

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.robots import ROBOT_KINDS, ArmConfig, MakeRobot
from teleop_drake.model.blocks.robots.base import (
    LoadModel,
    NewPlant,
    PlantRobotConfig,
    PointOf,
    ReadModel,
    RobotConfig,
)
from teleop_drake.model.blocks.robots.driven_arm import DrivenArmConfig

FILE = str(Path(__file__).parents[4] / "diagrams" / "own_arm.urdf")


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
    assert_allclose(position, [0.85, 0.1], atol=1e-12)
    with pytest.raises(ScenarioError, match=r"robot.start = .*no nearer than"):
        Plant(start=np.array([3.0, 0.0])).Check("robot")


def test_the_bases_are_abstract(subtests):
    for base in (RobotConfig, PlantRobotConfig, DrivenArmConfig):
        with (
            subtests.test(base=base),
            pytest.raises(TypeError, match="abstract"),
        ):
            base(start=[0.0])


@pytest.mark.parametrize("p_WT", [None, [0.1], [0.1, np.inf], [[0.1, 0.2]]])
def test_points_of_the_wrong_shape(p_WT):
    with pytest.raises(ScenarioError, match=r"start = .* must be a list of 2 finite"):
        PointOf(p_WT, 2)


# By name.


def test_the_kinds_of_the_package():
    assert ROBOT_KINDS.names == ("slider", "two_link_arm", "arm", "puma560")


@pytest.mark.parametrize("model, hint", [("two_link_arn", "did you mean"), ("pum", "")])
def test_unknown_model(model, hint):
    with pytest.raises(ScenarioError, match=f"model = '{model}': must be.*{hint}"):
        MakeRobot(model=model, start=[0.0])


def test_a_bad_field_has_its_path():
    with pytest.raises(ScenarioError, match=r"^robot\.mass = -1: must be"):
        MakeRobot(model="slider", start=[0.0], mass=-1)


@pytest.mark.parametrize("kind", ROBOT_KINDS.kinds)
def test_the_parameters_are_the_fields_of_every_kind(kind):
    taken = inspect.signature(MakeRobot).parameters
    assert {item.name for item in dataclasses.fields(kind)} < {*taken}


def test_a_field_of_another_kind_is_refused():
    message = (
        "robot.elbow = 'up': must be left out: a slider has one of start, mass, damping"
    )
    with pytest.raises(ScenarioError, match=re.escape(message)):
        MakeRobot("slider", [0.0], elbow="up")


# Model files.


@pytest.mark.parametrize(("name", "num_joints"), [("slider", 1), ("two_link_arm", 2)])
def test_models_of_the_package(name, num_joints):
    plant = LoadModel(ReadModel(name))
    assert plant.is_finalized() and plant.time_step() == 0
    assert plant.get_name() == "plant"
    assert plant.num_velocities() == plant.num_actuators() == num_joints
    assert plant.HasBodyNamed("tool")


@pytest.mark.parametrize("gravity", [[1.0], [0.0, 0.0, 3.0]])
def test_gravity_is_along_the_first_axes(gravity):
    plant = LoadModel(ReadModel("slider"), gravity)
    vector = plant.gravity_field().gravity_vector()
    assert_array_equal(vector, np.pad(gravity, (0, 3 - len(gravity))))


def test_a_plant_is_finalized_at_the_end():
    with NewPlant() as plant:
        assert not plant.is_finalized()
    assert plant.is_finalized()
    assert np.linalg.norm(plant.gravity_field().gravity_vector()) > 9


# What an arm does beside the task.


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
    assert_allclose(rates, 0, atol=1e-10)
    x = context.get_continuous_state_vector().CopyToVector()
    x[:3] += 0.01
    context.SetContinuousState(x)
    assert np.abs(robot.EvalTimeDerivatives(context).CopyToVector()).max() > 0.1


def test_an_arm_of_three_joints_cannot_hold_its_orientation():
    arm = ArmConfig(file=FILE, start=np.array([0.45, 0, 0.2]), hold="orientation")
    with pytest.raises(ScenarioError, match=r"robot.hold = .* 3 axes and 3 joints"):
        arm.Check("robot")

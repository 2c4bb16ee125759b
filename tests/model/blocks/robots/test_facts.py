"""What a robot tells of itself."""

import appendix_a
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
)
from pydrake.systems.primitives import LinearSystem
from wired import Wired

from teleop_drake.model.blocks.robots import (
    FactsOfConfig,
    FactsOfRobot,
    MakeRobotDiagram,
    SliderConfig,
    TwoLinkArmConfig,
)
from teleop_drake.model.scenario import LoadScenario


def test_slider():
    facts = FactsOfRobot(SliderConfig(start=[0.25], mass=0.2, damping=0.7).MakeRobot())
    assert facts.start == pytest.approx([0.25])
    assert facts.inertia == pytest.approx(np.array([[0.2]]))
    assert facts.damping == pytest.approx(np.array([[0.7]]))


def test_two_link_arm():
    config = TwoLinkArmConfig(start=[0.85, 0.1], elbow="down")
    facts = FactsOfRobot(config.MakeRobot())
    q = config.JointPositions(config.start)
    J = appendix_a.J(q)
    M = appendix_a.M(q)
    inverse = np.linalg.inv(facts.inertia)
    assert_allclose(inverse, J @ np.linalg.inv(M) @ J.T, atol=1e-10)
    assert_array_equal(facts.damping, np.zeros((2, 2)))


def test_own_robot_of_five_kilograms():
    plant = MultibodyPlant(0.0)
    tool = plant.AddRigidBody("tool", SpatialInertia.SolidSphereWithMass(5.0, 0.1))
    joint = PrismaticJoint(
        "x", plant.world_frame(), tool.body_frame(), [1, 0, 0], damping=3.0
    )
    plant.AddJointActuator("motor", plant.AddJoint(joint))
    plant.Finalize()
    robot = MakeRobotDiagram(plant=plant, num_axes=1, joint_positions=[0.4])
    # Also where it stands in a larger diagram.
    loop = Wired({"robot": robot}, {})
    for _ in range(2):
        facts = FactsOfRobot(robot)
        assert facts.inertia == pytest.approx(np.array([[5.0]]))
        assert facts.damping == pytest.approx(np.array([[3.0]]))
    assert loop.num_continuous_states() == 2


def redundant_arm(dampings):
    """An arm of three links with a tool that moves in the plane."""
    plant = MultibodyPlant(0.0)
    frame = plant.world_frame()
    for i, (damping, length) in enumerate(zip(dampings, (0.5, 0.4, 0.3), strict=True)):
        link = plant.AddRigidBody(
            f"link{i}", SpatialInertia.SolidBoxWithMass(1.0 + i, 0.1, 0.1, 0.1)
        )
        joint = RevoluteJoint(f"j{i}", frame, link.body_frame(), [0, 0, 1], damping)
        plant.AddJointActuator(f"m{i}", plant.AddJoint(joint))
        frame = plant.AddFrame(
            FixedOffsetFrame(f"tip{i}", link, RigidTransform([length, 0, 0]))
        )
    tool = plant.AddRigidBody("tool", SpatialInertia.Zero())
    plant.WeldFrames(frame, tool.body_frame())
    plant.Finalize()
    return plant


def test_more_joints_than_axes():
    """A force on the tool gives the acceleration that the inertia says, and a velocity
    in which the other joints go along freely loses the power that the damping says."""
    plant = redundant_arm([0.3, 0.2, 0.1])
    dampings = np.array([0.3, 0.2, 0.1])
    q = np.array([0.3, 0.8, -0.5])
    robot = MakeRobotDiagram(plant=plant, num_axes=2, joint_positions=q)
    facts = FactsOfRobot(robot)
    context = robot.CreateDefaultContext()
    force = np.array([0.7, -0.4])
    robot.GetInputPort("control_force").FixValue(context, force)
    robot.GetInputPort("environment_force").FixValue(context, [0.0, 0.0])
    acceleration = robot.GetOutputPort("tool_acceleration").Eval(context)
    assert_allclose(facts.inertia @ acceleration, force, atol=1e-12)
    # From rest, the impulse of the force moves all joints; they brake it.
    qdot = robot.EvalTimeDerivatives(context).CopyToVector()[3:]
    assert acceleration @ facts.damping @ acceleration == pytest.approx(
        qdot @ np.diag(dampings) @ qdot
    )


def test_a_robot_without_a_plant_cannot_tell():
    diagram = Wired(
        {"mass": LinearSystem(np.diag([1.0], 1), [[0], [1]], [[1, 0]], [[0]])},
        {},
        {"tool_position": "mass"},
    )
    facts = FactsOfRobot(diagram)
    assert (len(facts.start), facts.inertia, facts.damping) == (1, None, None)


def test_a_singular_pose_tells_nothing():
    plant = TwoLinkArmConfig().LoadPlant()
    robot = MakeRobotDiagram(plant=plant, num_axes=2, joint_positions=[0.0, 0.0])
    assert FactsOfRobot(robot).inertia is None


def test_facts_are_those_of_the_robot_whatever_was_asked_before():
    for mass in (1.0, 2.0, 1.0):
        robot = LoadScenario("one_dof", {"robot.mass": mass}).robot
        facts = FactsOfConfig(robot)
        expected = FactsOfRobot(robot.MakeRobot())
        for name in ("start", "inertia", "damping"):
            assert_array_equal(getattr(facts, name), getattr(expected, name))
        assert facts.inertia is FactsOfConfig(robot).inertia
    arm = LoadScenario("two_dof_combined").robot
    assert FactsOfConfig(arm).inertia.shape == (2, 2)

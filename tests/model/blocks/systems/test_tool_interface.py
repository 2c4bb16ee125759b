"""The block between a plant and task space, by a planar arm of three links."""

import numpy as np
import pytest
from block_checks import Feedthrough
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    JacobianWrtVariable,
    RevoluteJoint,
    SpatialInertia,
)
from pydrake.systems.primitives import FirstOrderTaylorApproximation
from slopes import Slopes

from teleop_drake.model.blocks.systems.tool_interface import ToolInterface
from teleop_drake.model.scenario import LoadScenario

LENGTHS = [0.5, 0.4, 0.3]
INERTIA = SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1)

three = st.lists(st.floats(-5, 5), min_size=3, max_size=3).map(np.array)
two = st.lists(st.floats(-5, 5), min_size=2, max_size=2).map(np.array)


def make_plant(actuated=(0, 1, 2)):
    """A planar arm of three links: one joint more than a task in the plane has axes."""
    plant = MultibodyPlant(0.0)
    tip = plant.world_frame()
    joints = []
    for i, length in enumerate(LENGTHS):
        link = plant.AddRigidBody(f"link{i}", INERTIA)
        joints.append(
            plant.AddJoint(
                RevoluteJoint(f"joint{i}", tip, link.body_frame(), [0, 0, 1])
            )
        )
        tip = plant.AddFrame(
            FixedOffsetFrame(f"tip{i}", link, RigidTransform([length, 0.0, 0.0]))
        )
    hand = plant.AddRigidBody("hand", SpatialInertia.Zero())
    plant.WeldFrames(tip, hand.body_frame())
    for i in actuated:
        plant.AddJointActuator(f"motor{i}", joints[i])
    plant.Finalize()
    return plant


@pytest.fixture(scope="module")
def dut():
    return ToolInterface(plant=make_plant(), num_task_axes=2, tool_name="hand")


def test_ports(dut):
    inputs = map(dut.get_input_port, range(dut.num_input_ports()))
    assert [(port.get_name(), port.size()) for port in inputs] == [
        *(("plant_state", 6), ("generalized_acceleration", 3)),
        *(("control_force", 2), ("environment_force", 2)),
    ]
    outputs = map(dut.get_output_port, range(dut.num_output_ports()))
    sizes = {"tool_kinematics": 10, "tool_acceleration": 2, "joint_torques": 6}
    assert {port.get_name(): port.size() for port in outputs} == sizes


def test_direct_feedthrough(dut):
    assert Feedthrough(dut) == {
        "tool_kinematics": {"plant_state"},
        "tool_acceleration": {"plant_state", "generalized_acceleration"},
        "joint_torques": {"plant_state", "control_force", "environment_force"},
    }


@settings(max_examples=20)
@given(q=three, qdot=three, F_c=two, F_e=two)
def test_tool_kinematics_and_torques(dut, q, qdot, F_c, F_e):
    context = dut.CreateDefaultContext()
    dut.GetInputPort("plant_state").FixValue(context, np.concatenate((q, qdot)))
    dut.GetInputPort("control_force").FixValue(context, F_c)
    dut.GetInputPort("environment_force").FixValue(context, F_e)
    kinematics, torques = (
        dut.GetOutputPort(name).Eval(context)
        for name in ("tool_kinematics", "joint_torques")
    )
    tau, tau_e = np.split(torques, 2)
    p_WT, v_WT, J = np.split(kinematics, [2, 4])
    # As complex numbers: the links turn by the sums of the joint angles.
    links = LENGTHS * np.exp(1j * np.cumsum(q))
    p = sum(links)
    v = 1j * links @ np.cumsum(qdot)
    assert_allclose(p_WT, [p.real, p.imag], atol=1e-10)
    assert_allclose(v_WT, [v.real, v.imag], atol=1e-10)
    assert_allclose(J.reshape(2, 3) @ qdot, v_WT, atol=1e-10)
    # (2.11) and (2.6), by the moments of F_c and of -F_e about each joint.
    arms = p - np.concatenate(([0], np.cumsum(links)[:-1]))
    assert_allclose(tau, arms.real * F_c[1] - arms.imag * F_c[0], atol=1e-10)
    expected = arms.imag * F_e[0] - arms.real * F_e[1]
    assert_allclose(tau_e, expected, atol=1e-10)
    assert F_c @ v_WT == pytest.approx(tau @ qdot, abs=1e-9)


def test_contexts_do_not_disturb_one_another(dut):
    first = dut.CreateDefaultContext()
    second = dut.CreateDefaultContext()
    dut.GetInputPort("plant_state").FixValue(first, [0, 0, 0, 1, 0, 0])
    dut.GetInputPort("plant_state").FixValue(second, [np.pi / 2, 0, 0, 1, 0, 0])
    kinematics = dut.GetOutputPort("tool_kinematics")
    kinematics.Eval(first)
    for context, motion in ((second, [0, 1.2, -1.2, 0]), (first, [1.2, 0, 0, 1.2])):
        assert_allclose(kinematics.Eval(context)[:4], motion, atol=1e-12)


def test_tool_acceleration_is_the_tool_bodys(dut):
    plant = make_plant()
    context = plant.CreateDefaultContext()
    seen = dut.CreateDefaultContext()
    x = [0.3, 0.7, -0.4, 1.1, -0.2, 0.5]
    plant.SetPositionsAndVelocities(context, x)
    plant.get_actuation_input_port().FixValue(context, [1.0, -2.0, 0.5])
    v_dot = plant.get_generalized_acceleration_output_port().Eval(context)
    accelerations = plant.get_body_spatial_accelerations_output_port().Eval(context)
    expected = accelerations[int(plant.GetBodyByName("hand").index())].translational()
    dut.GetInputPort("plant_state").FixValue(seen, x)
    dut.GetInputPort("generalized_acceleration").FixValue(seen, v_dot)
    found = dut.GetOutputPort("tool_acceleration").Eval(seen)
    assert_allclose(found, expected[:2], rtol=1e-12)


def test_it_has_its_slopes(dut):
    assert Slopes(dut) == "yes"


@pytest.mark.parametrize("actuated", [(0, 1), (1, 0, 2)])
def test_actuators_must_be_the_joints_in_order(actuated):
    with pytest.raises(
        ValueError, match=r"plant.num_actuators = .*must be one for each"
    ):
        ToolInterface(plant=make_plant(actuated), num_task_axes=2, tool_name="hand")


def test_task_axes_must_be_axes_of_space():
    with pytest.raises(ValueError, match="num_task_axes = 4: must"):
        ToolInterface(plant=make_plant(), num_task_axes=4, tool_name="hand")


def test_drake_linearises_a_robot():
    """The acceleration is J M^-1 J^T (F_c - F_e) and more: Drake's own derivatives."""
    robot = LoadScenario("two_dof_collision").robot.MakeRobot()
    plant = robot.GetSubsystemByName("plant")
    context = robot.CreateDefaultContext()
    context.SetContinuousState([0.3, 0.7, 0.1, -0.2])
    for i in range(robot.num_input_ports()):
        robot.get_input_port(i).FixValue(context, [0.1, 0.2])
    linear = FirstOrderTaylorApproximation(
        robot,
        context,
        robot.GetInputPort("control_force").get_index(),
        robot.GetOutputPort("tool_acceleration").get_index(),
    )
    inner = plant.GetMyContextFromRoot(context)
    frames = plant.GetFrameByName("tool"), np.zeros(3), *[plant.world_frame()] * 2
    J = plant.CalcJacobianTranslationalVelocity(inner, JacobianWrtVariable.kV, *frames)
    J = J[:2]
    expected = J @ np.linalg.inv(plant.CalcMassMatrix(inner)) @ J.T
    assert_allclose(linear.D(), expected, rtol=1e-12)

"""The planar arm against the thesis's Appendix A."""

import appendix_a
import numpy as np
import pytest
from forced_robot import context_with_forces
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pydrake.multibody.tree import JacobianWrtVariable

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.robots import TwoLinkArmConfig

ARM = TwoLinkArmConfig(start=[0.85, 0.1], elbow="down")

radii = st.floats(0.0376, 1.4995)
angles = st.floats(-3.1, 3.1)
elbows = st.sampled_from(["up", "down"])
task_vectors = st.tuples(st.floats(-10, 10), st.floats(-10, 10)).map(np.array)


def random_states(count=20):
    return np.random.default_rng(1).uniform(-np.pi, np.pi, (count, 4))


def polar(radius, angle):
    return radius * np.array([np.cos(angle), np.sin(angle)])


@pytest.fixture(scope="module")
def arm():
    return TwoLinkArmConfig().LoadPlant()


@pytest.fixture(scope="module")
def arm_robot():
    return ARM.MakeRobot()


def test_arm_has_the_dynamics_of_appendix_a(arm):
    """And c21 as it is printed is wrong."""
    context = arm.CreateDefaultContext()
    world = arm.world_frame()
    tool = arm.GetFrameByName("tool")
    for x in random_states():
        q = x[:2]
        qdot = x[2:]
        arm.SetPositionsAndVelocities(context, x)
        J = arm.CalcJacobianTranslationalVelocity(
            context, JacobianWrtVariable.kV, tool, np.zeros(3), world, world
        )
        bias = arm.CalcBiasTerm(context)
        for ours, theirs in (
            (arm.CalcMassMatrix(context), appendix_a.M(q)),
            (bias, appendix_a.C(q, qdot) @ qdot),
            (J[:2], appendix_a.J(q)),
            (tool.CalcPoseInWorld(context).translation(), [*appendix_a.p_WT(q), 0]),
            # The plane is horizontal.
            (arm.CalcGravityGeneralizedForces(context), np.zeros(2)),
        ):
            assert_allclose(ours, theirs, atol=1e-10)
        error = bias - appendix_a.C_as_printed(q, qdot) @ qdot
        assert abs(error[0]) < 1e-10
        assert abs(error[1]) > 1e-3


def test_heavier_links_have_as_much_more_inertia():
    plant = TwoLinkArmConfig(link_mass=3 * appendix_a.m1).LoadPlant()
    context = plant.CreateDefaultContext()
    for x in random_states():
        plant.SetPositionsAndVelocities(context, x)
        M = plant.CalcMassMatrix(context)
        assert_allclose(M, 3 * appendix_a.M(x[:2]), atol=1e-10)


def test_arm_in_a_vertical_plane_has_the_gravity_of_appendix_a():
    plant = TwoLinkArmConfig().LoadPlant([0, -appendix_a.g])
    context = plant.CreateDefaultContext()
    for x in random_states():
        plant.SetPositionsAndVelocities(context, x)
        G = -plant.CalcGravityGeneralizedForces(context)
        assert_allclose(G, appendix_a.G(x[:2]), atol=1e-10)


@given(task_vectors, task_vectors, st.integers(0, 19))
def test_arm_moves_as_2_6_says(arm_robot, F_c, F_e, index):
    x = random_states()[index]
    q = x[:2]
    qdot = x[2:]
    context = context_with_forces(arm_robot, F_c, F_e)
    context.SetContinuousState(x)
    J = appendix_a.J(q)
    qddot = np.linalg.solve(
        appendix_a.M(q), J.T @ (F_c - F_e) - appendix_a.C(q, qdot) @ qdot
    )
    centripetal = -appendix_a.L1 * qdot[0] ** 2 * polar(1, q[0])
    centripetal -= appendix_a.L3 * (qdot[0] + qdot[1]) ** 2 * polar(1, q[0] + q[1])
    expected = {
        "joint_position": q,
        "joint_velocity": qdot,
        "joint_torque": J.T @ F_c,
        "tool_position": appendix_a.p_WT(q),
        "tool_velocity": J @ qdot,
        "tool_acceleration": J @ qddot + centripetal,
    }
    assert_allclose(
        arm_robot.EvalTimeDerivatives(context).CopyToVector()[2:], qddot, atol=1e-9
    )
    for name, value in expected.items():
        assert_allclose(
            arm_robot.GetOutputPort(name).Eval(context),
            value,
            atol=1e-9,
            err_msg=name,
        )


@given(radii, angles, elbows)
def test_inverse_kinematics_reaches_the_point(radius, angle, elbow):
    p_WT = polar(radius, angle)
    q = TwoLinkArmConfig(elbow=elbow).JointPositions(p_WT)
    assert_allclose(appendix_a.p_WT(q), p_WT, atol=1e-12)
    assert 0 < (q[1] if elbow == "down" else -q[1]) < np.pi


def test_elbow_down_is_at_negative_y_of_an_arm_stretched_forward():
    q = TwoLinkArmConfig(elbow="down").JointPositions([0.85, 0.0])
    assert q[0] < 0 < q[1]


@pytest.mark.parametrize(
    "changes, message",
    [
        (
            {"start": [1.6, 0]},
            r"start = \[1.6, 0.0\]: must be 0.0375\d+ to 1.499.* 1.6 m",
        ),
        ({"start": [0.03, 0]}, "start = .* from the shoulder, not 0.03 m"),
        ({"start": [0.85]}, r"start = \[0.85\]: must be a list of 2 finite"),
        ({"start": None}, "start = null: must be a list of 1, 2 or 3 finite"),
        ({"elbow": "left"}, "elbow = 'left': must be one of up, down"),
        ({"elbow": None}, "elbow = null: must be one of up, down"),
    ],
)
def test_bad_input_gets_one_clear_line(changes, message):
    config = TwoLinkArmConfig(**{"start": [0.85, 0.1], "elbow": "down", **changes})
    with pytest.raises(ScenarioError, match=rf"^robot\.{message}") as error:
        config.Check("robot")
    assert "\n" not in str(error.value)

"""The Puma 560 against a recursion of its own, and what drives it beside the task."""

import numpy as np
import pytest
import standard_dh
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose
from pydrake.multibody.tree import MultibodyForces

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.robots import Puma560Config

NOMINAL = [0.7963, -0.15, 0.6576]


def puma(**fields):
    return Puma560Config(**{"start": np.array(NOMINAL), **fields})


@pytest.fixture(scope="module")
def plant():
    return puma().LoadPlant()


def random_states(count):
    rng = np.random.default_rng(0)
    for _ in range(count):
        yield rng.uniform(-np.pi, np.pi, 6), rng.normal(size=6), rng.normal(size=6)


def test_it_is_the_arm_of_the_papers(plant):
    """Forward kinematics, mass matrix, weight and inverse dynamics."""
    context = plant.CreateDefaultContext()
    forces = MultibodyForces(plant)
    tool = plant.GetFrameByName("tool")
    rest = np.zeros(6)
    for q, v, v_dot in random_states(count=5):
        plant.SetPositionsAndVelocities(context, np.append(q, v))
        R, p = standard_dh.tool_pose(q)
        pose = tool.CalcPoseInWorld(context)
        assert_allclose(pose.rotation().matrix(), R, atol=1e-13)
        assert_allclose(pose.translation(), p, atol=1e-13)
        M = plant.CalcMassMatrix(context)
        assert_allclose(M, standard_dh.mass_matrix(q), atol=1e-12)
        weight = -plant.CalcGravityGeneralizedForces(context)
        expected = standard_dh.inverse_dynamics(q, rest, rest)
        assert_allclose(weight, expected, atol=1e-12)
        plant.CalcForceElementsContribution(context, forces)
        torque = plant.CalcInverseDynamics(context, v_dot, forces)
        friction = standard_dh.VISCOUS * standard_dh.GEAR**2 * v
        expected = standard_dh.inverse_dynamics(q, v, v_dot) + friction
        assert_allclose(torque, expected, atol=1e-11)


def test_its_poses_keep_the_needle_along_x():
    config = puma(start=np.array([0.75, -0.1, 0.7]))
    config.Check("robot")
    R, p = standard_dh.tool_pose(config.JointPositions(config.start))
    assert_allclose(p, config.start, atol=1e-12)
    assert_allclose(R[:, 2], [1, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("hold", "num_axes"), [("none", 1), ("posture", 2), ("orientation", 3)]
)
def test_every_block_has_a_kernel(hold, num_axes):
    config = puma(
        hold=hold, start=np.array(NOMINAL[:num_axes]), payload=0.5, payload_error=0.1
    )
    CheckKernel(config.MakeRobot(), num_states=3)


def test_friction_counts_by_its_share():
    """Viscous friction too; a joint that moves fast has all of its Coulomb friction."""
    rates = []
    for friction in (0.0, 1.0, 2.0):
        robot = puma(friction=friction, hold="none").MakeRobot()
        context = robot.CreateDefaultContext()
        for name in ("control_force", "environment_force"):
            robot.GetInputPort(name).FixValue(context, np.zeros(3))
        x = context.get_continuous_state_vector().CopyToVector()
        v = np.array([3.0, -3.0, 4.0, 5.0, -5.0, 4.0])
        context.SetContinuousState(np.append(x[:6], v))
        rates.append(robot.EvalTimeDerivatives(context).CopyToVector()[6:])
        q = x[:6]
    assert_allclose(rates[2] - rates[1], rates[1] - rates[0], atol=1e-9)
    torque = standard_dh.mass_matrix(q) @ (rates[1] - rates[0])
    viscous = standard_dh.VISCOUS * standard_dh.GEAR**2 * v
    forward, backward = standard_dh.COULOMB
    coulomb = np.where(v > 0, forward, -np.array(backward)) * standard_dh.GEAR
    assert_allclose(torque, -viscous - coulomb, rtol=1e-3)


def test_its_torque_is_limited():
    config = puma(hold="none", friction=0.0)
    robot = config.MakeRobot()
    context = robot.CreateDefaultContext()
    robot.GetInputPort("environment_force").FixValue(context, np.zeros(3))
    robot.GetInputPort("control_force").FixValue(context, [1e5, 1e5, 1e5])
    torque = robot.GetOutputPort("joint_torque").Eval(context)
    assert (np.abs(torque) <= [97.6, 186.4, 89.4, 24.2, 20.1, 21.3]).all()
    assert abs(torque[0]) == 97.6


@pytest.mark.parametrize(
    "fields, message",
    [
        (
            {"start": [2.0, 0.0, 0.5]},
            "robot.start = .*: must be in reach of the tool, ",
        ),
        (
            # The wrist reaches it, but not from behind the arm.
            {"start": [-0.8, 0.15, 0.65]},
            "robot.start = .*: must be in reach of the tool as it is turned",
        ),
        (
            {"posture": [0, 0.5, -2.0707963267948966, 0, 0.02, 0], "start": None},
            "robot.start = .*: must be away from singular poses .* 6 x 6 Jacobian",
        ),
        ({"hold": "wrist"}, "robot.hold = 'wrist': must be one of none, posture"),
        ({"hold_frequency": 1e9}, "robot.hold_frequency = .* > 0 and <= 1000"),
        ({"payload_error": -1.0}, "robot.payload_error = -1.0: must be"),
        (
            {"payload_error": 0.1, "gravity_compensation": False},
            "robot.payload_error = 0.1: must be 0, as nothing compensates",
        ),
        ({"friction_speed": 0.0}, "robot.friction_speed = 0.0: must be a finite"),
    ],
)
def test_bad_fields_get_one_clear_line(fields, message):
    config = puma()
    for name, value in fields.items():
        setattr(config, name, np.array(value) if isinstance(value, list) else value)
    if config.start is None:  # Where the posture puts it.
        config.start = standard_dh.tool_pose(config.posture)[1]
    with pytest.raises(ScenarioError, match=message) as error:
        config.Check("robot")
    assert "\n" not in str(error.value)

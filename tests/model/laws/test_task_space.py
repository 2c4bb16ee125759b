"""Control of the joint motion that an arm's task leaves free."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from teleop_drake.model.laws.task_space import (
    PostureGains,
    held_torque,
    orientation_error,
    orientation_goal,
)

GAINS = PostureGains(frequency=7.0, damping_ratio=0.6, near=1e-3, damping=1e-2)


def random_case(seed, num_rows, num_joints):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(num_joints, num_joints))
    M = root @ root.T + np.eye(num_joints)
    return M, rng.normal(size=(num_rows, num_joints)), rng.normal(size=(3, num_joints))


@pytest.mark.parametrize("num_axes, num_joints", [(1, 2), (3, 7)])
def test_the_posture_is_held_without_moving_the_tool(num_axes, num_joints):
    """The torque is that of the standard null-space projector."""
    M, (q_0, q, v), _ = random_case(0, 3, num_joints)
    J = random_case(1, num_axes, num_joints)[1]
    tau = held_torque(GAINS, M, J, np.zeros(num_axes), q_0, q, v)
    assert_allclose(J @ np.linalg.solve(M, tau), 0, atol=1e-9)
    J_bar = np.linalg.solve(M, J.T) @ np.linalg.inv(J @ np.linalg.solve(M, J.T))
    tau_0 = M @ (49.0 * (q_0 - q) - 2 * 0.6 * 7.0 * v)
    expected = (np.eye(num_joints) - J.T @ J_bar.T) @ tau_0
    assert_allclose(tau, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("num_axes, num_joints", [(1, 6), (3, 8)])
def test_the_orientation_is_held_without_moving_the_tool(num_axes, num_joints):
    M, J_v, J_w = random_case(2, num_axes, num_joints)
    q_0, q, v = random_case(3, 3, num_joints)[1]
    R_0 = Rotation.random(rng=4).as_matrix()
    turn = np.array([0.02, -0.01, 0.03])
    R = Rotation.from_rotvec(turn).as_matrix() @ R_0
    gains = GAINS._replace(near=1e-9)
    y = np.append(np.zeros(num_axes), orientation_goal(gains, R_0, R, J_w @ v))
    tau = held_torque(gains, M, np.vstack([J_v, J_w]), y, q_0, q, v)
    v_dot = np.linalg.solve(M, tau)
    assert_allclose(J_v @ v_dot, 0, atol=1e-9)
    expected = -49.0 * turn - 2 * 0.6 * 7.0 * (J_w @ v)
    assert_allclose(J_w @ v_dot, expected, atol=1e-3)


def test_the_error_is_the_sine_of_the_angle_about_the_axis():
    R_0 = Rotation.random(rng=0).as_matrix()
    axis = np.array([0.6, 0.0, 0.8])
    for angle in (0.0, 0.3, 1.5):
        R = Rotation.from_rotvec(angle * axis).as_matrix() @ R_0
        error = orientation_error(R_0, R)
        assert_allclose(error, np.sin(angle) * axis, atol=1e-12)


@pytest.mark.parametrize("distance", [0.0, 1e-9, 1e-4])
def test_no_pose_is_too_singular(distance):
    """The torque is bounded even if two rows of J are equal and one is zero."""
    M, J, _ = random_case(5, 3, 6)
    J[1] = J[0] + distance * J[1]
    J[2] *= distance
    tau = held_torque(GAINS, M, J, np.zeros(3), np.ones(6), np.zeros(6), np.zeros(6))
    bound = np.abs(M @ np.full(6, 49.0)).max()
    assert np.abs(tau).max() < 20 * bound


def test_the_damping_begins_where_it_should():
    """The damping does not affect poses that are far enough from singular ones."""
    M = np.eye(2)
    J = np.eye(2)
    y = (np.array([1.0, 0.5]), np.zeros(2), np.zeros(2))
    for share, is_damped in ((1.001, False), (0.5, True)):
        # det A of these rows is the squared sine of the angle between them.
        angle = np.arcsin(np.sqrt(share * GAINS.near))
        J[1] = [np.cos(angle), np.sin(angle)]
        tau = held_torque(GAINS, M, J, np.zeros(2), *y)
        leak = np.abs(J @ tau).max()
        assert (leak > 1e-4) == is_damped

"""Rigid-body dynamics against closed forms; test_plant_tree.py has random trees."""

import appendix_a
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.loops.numerics.rigid_body import (
    RigidBodyTree,
    calc_bias_acceleration,
    calc_jacobian,
    calc_joint_accelerations,
    calc_motion,
)


def Inertia(m, com, rotational):
    """Returns mass, first moment and inertia about the origin of the link's frame."""
    c = np.array(com, dtype=float)
    square = np.dot(com, com)
    about = np.diag(rotational) + m * (square * np.eye(3) - np.outer(c, c))
    return m, m * c, about


def Tree(*links, gravity=(0.0, 0.0, 0.0)):
    """Returns a chain of links (is_prismatic, offset on the parent, axis, inertia)."""
    num = len(links)
    return RigidBodyTree(
        parents=np.arange(-1, num - 1),
        is_prismatic=np.array([link[0] for link in links]),
        frames=np.array([np.c_[np.eye(3), link[1]] for link in links]),
        axes=np.array([link[2] for link in links], dtype=float),
        masses=np.array([link[3][0] for link in links]),
        moments=np.array([link[3][1] for link in links]),
        inertias=np.array([link[3][2] for link in links]),
        rotor_inertias=np.zeros(num),
        damping=np.zeros(num),
        gravity=np.array(gravity, dtype=float),
    )


def Arm(gravity=0.0):
    """Returns the arm of Appendix A, with gravity along -y."""
    a = appendix_a
    z = (0, 0, 1)
    return Tree(
        (0, (0, 0, 0), z, Inertia(a.m1, (a.L2, 0, 0), (0, 0, a.I1))),
        (0, (a.L1, 0, 0), z, Inertia(a.m2, (a.L4, 0, 0), (0, 0, a.I2))),
        gravity=(0, -gravity, 0),
    )


@pytest.mark.parametrize("gravity", [0.0, appendix_a.g])
def test_the_arm_of_appendix_a(gravity):
    random = np.random.default_rng(1)
    tree = Arm(gravity)
    for _ in range(10):
        q, v, tau = random.normal(size=(3, 2))
        v_dot = calc_joint_accelerations(tree, q, v, tau)
        weight = appendix_a.G(q) * (gravity > 0)
        M = appendix_a.M(q)
        C = appendix_a.C(q, v)
        expected = np.linalg.solve(M, tau - C @ v - weight)
        assert_allclose(v_dot, expected, rtol=1e-9, atol=1e-10)


def test_the_tool_of_appendix_a():
    q = np.array([0.4, 1.1])
    v = np.array([0.7, -0.3])
    tree = Arm()
    motion = calc_motion(tree, q, v)
    p, J = calc_jacobian(tree, motion, 1, np.array([appendix_a.L3, 0.0, 0.0]))
    assert_allclose(p, [*appendix_a.p_WT(q), 0.0], rtol=1e-12)
    assert_allclose(J[3:5], appendix_a.J(q), rtol=1e-12)
    assert_array_equal(J[[0, 1, 2, 5]], [[0, 0], [0, 0], [1, 1], [0, 0]])


def test_what_turns_evenly_falls_towards_the_axis():
    """A point at radius r of a link that turns at w has the acceleration -w^2 r."""
    tree = Tree((0, (0, 0, 0), (0, 0, 1), Inertia(1.0, (0, 0, 0), (1, 1, 1))))
    q = np.array([0.3])
    v = np.array([2.0])
    v_dot = calc_joint_accelerations(tree, q, v, np.zeros(1))
    assert v_dot[0] == pytest.approx(0.0)
    motion = calc_motion(tree, q, v)
    point = np.array([0.5, 0.0, 0.2])
    result = calc_bias_acceleration(motion, 0, point)
    expected = [0.0, 0.0, 0.0, -2.0 * np.cos(0.3), -2.0 * np.sin(0.3), 0.0]
    assert_allclose(result, expected, atol=1e-14)


def test_a_slide_falls_with_its_rotor_and_its_damping():
    """(m + rotor) dv/dt = F - d v - m g, upwards."""
    tree = Tree(
        (1, (0, 0, 0), (0, 0, 1), Inertia(2.0, (0, 0, 0), (1, 1, 1))),
        gravity=(0, 0, -9.81),
    )
    tree = tree._replace(rotor_inertias=np.array([0.5]), damping=np.array([0.3]))
    forces = np.array([4.0])
    v = np.array([1.5])
    v_dot = calc_joint_accelerations(tree, np.zeros(1), v, forces)
    assert v_dot[0] == pytest.approx((4.0 - 0.45 - 2.0 * 9.81) / 2.5)

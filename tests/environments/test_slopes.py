"""Tests of stiffness and damping at a point."""

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem

from teleop_drake.environments.base import StackSlopes, StiffnessAndDamping
from teleop_drake.environments.surface import Material, Surface


def Matter(name, stiffness, damping, relaxed):
    return Material(name=name, stiffness=stiffness, damping=damping, relaxed=relaxed)


NORMAL = np.array([0.6, 0.8])
BONE = Surface("contact", 1.0 * NORMAL, NORMAL, Matter("bone", 150.0, 3.0, 1.0))


class Cubic(LeafSystem):
    """F_e = [x^3 + 2 v_y, 3 v_x y], which tells no surfaces."""

    def __init__(self):
        LeafSystem.__init__(self)
        p = self.DeclareVectorInputPort("tool_position", 2)
        v = self.DeclareVectorInputPort("tool_velocity", 2)
        self.DeclareVectorOutputPort(
            "environment_force",
            2,
            lambda context, output: output.SetFromVector(
                [
                    p.Eval(context)[0] ** 3 + 2 * v.Eval(context)[1],
                    3 * v.Eval(context)[0] * p.Eval(context)[1],
                ]
            ),
        )


def test_a_stack_tells_them_exactly():
    K, D = StackSlopes((BONE,), 2.0 * NORMAL)
    np.testing.assert_allclose(K, 150 * np.outer(NORMAL, NORMAL), rtol=1e-15)
    np.testing.assert_allclose(D, 3 * np.outer(NORMAL, NORMAL), rtol=1e-15)
    for zero in StackSlopes((BONE,), [0.0, 0.0]):
        assert not zero.any()


def test_others_are_differenced():
    K, D = StiffnessAndDamping(Cubic(), [2.0, 0.5], [0.1, 0.0])
    np.testing.assert_allclose(K, [[12.0, 0.0], [0.0, 0.3]], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(D, [[0.0, 2.0], [1.5, 0.0]], rtol=1e-7, atol=1e-7)


def test_no_surfaces_are_no_stack():
    assert StackSlopes((), [0.0]) is None
    assert StackSlopes((Surface("x", [0.0], [1.0]),), [0.0]) is None


@pytest.mark.parametrize("depth", [-1e-3, 1e-3])
def test_differences_stay_on_their_side(depth):
    """Of a wall that tells its surface but no material."""

    class Wall(Cubic):
        def Surfaces(self):
            return [Surface("wall", [1.0, 0.0], [1.0, 0.0])]

    K, _ = StiffnessAndDamping(Wall(), [1.0 + depth, 0.0])
    assert K[0, 0] == pytest.approx(3 * (1 + depth) ** 2, rel=1e-6)

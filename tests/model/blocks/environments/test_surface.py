"""Tests of surfaces: depth along any normal."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.framework import LeafSystem
from wired import Wired

from teleop_drake.loops.framework.surface import (
    FindSurface,
    LastPassed,
    Material,
    MaterialAt,
    StackNormal,
    Surface,
    SurfacesOf,
)
from teleop_drake.model.blocks.environments.base import StackSlopes, StiffnessAndDamping


def Matter(name, stiffness, damping, relaxed):
    return Material(name=name, stiffness=stiffness, damping=damping, relaxed=relaxed)


SKIN = Surface("puncture", [1.0, 0.0], [1.0, 0.0], Matter("skin", 2.0, 0.5, 1.0))
BONE = Surface("contact", [2.0, 0.0], [1.0, 0.0], Matter("bone", 9.0, 0.0, 2.0))


@pytest.mark.parametrize("n", [1, 2, 3])
@given(data=st.data())
def test_depth_is_the_way_along_the_normal(n, data):
    numbers = st.lists(st.floats(-3, 3), min_size=n, max_size=n).map(np.array)
    normal = data.draw(numbers.filter(lambda v: np.linalg.norm(v) > 0.1))
    normal = normal / np.linalg.norm(normal)
    point = data.draw(numbers)
    p = data.draw(numbers)
    surface = Surface("wall", point, normal)
    depth = surface.Depth(p)
    # What is left after going back by the depth lies in the plane.
    assert normal @ (p - depth * normal - point) == pytest.approx(0, abs=1e-9)
    assert_allclose(surface.Depth(np.array([p, point])), [depth, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("point", "normal"),
    [([0.0], [0.0]), ([0.0], [2.0]), ([0.0, 1.0], [1.0]), ([np.nan], [1.0])],
)
def test_refuses(point, normal):
    with pytest.raises(ValueError, match="wall"):
        Surface("wall", point, normal)


def test_what_lies_behind():
    surfaces = (SKIN, BONE)
    assert LastPassed(surfaces, [0.5, 0.0]) is None
    assert MaterialAt(surfaces, [1.5, 7.0]).name == "skin"
    assert MaterialAt(surfaces, [2.0, 0.0]).name == "bone"
    assert FindSurface(surfaces, "contact") is BONE
    assert FindSurface(surfaces, "floor") is None
    assert BONE.material.Force(2.5, 1.0) == 4.5
    assert SKIN.material.Force(1.5, 4.0) == 3.0
    assert_array_equal(StackNormal(surfaces), [1.0, 0.0])
    floor = Surface("floor", [0.0, 0.0], [0.0, -1.0], Matter("floor", 1.0, 0.0, 0.0))
    assert StackNormal((SKIN, floor)) is None
    assert StackNormal((SKIN, Surface("x", [3.0, 0.0], [1.0, 0.0]))) is None


def test_records_give_equal_surfaces():
    text = json.dumps(asdict(BONE), default=np.ndarray.tolist)
    again = Surface.FromRecord(json.loads(text))
    assert str(asdict(again)) == str(asdict(BONE))
    bare = Surface("x", [3.0], [1.0])
    assert Surface.FromRecord(asdict(bare)).material is None


def test_a_diagram_tells_what_its_systems_tell():
    class Teller(LeafSystem):
        def Surfaces(self):
            return [SKIN]

    diagram = Wired({"teller": Teller(), "other": LeafSystem()}, {})
    assert SurfacesOf(diagram) == (SKIN,)
    assert SurfacesOf(LeafSystem()) is None


# Stiffness and damping at a point.

NORMAL = np.array([0.6, 0.8])
OBLIQUE = Surface("contact", 1.0 * NORMAL, NORMAL, Matter("bone", 150.0, 3.0, 1.0))


class Cubic(LeafSystem):
    """F_e = [x^3 + 2 v_y, 3 v_x y], which reports no surfaces."""

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
    K, D = StackSlopes((OBLIQUE,), 2.0 * NORMAL)
    assert_allclose(K, 150 * np.outer(NORMAL, NORMAL), rtol=1e-15)
    assert_allclose(D, 3 * np.outer(NORMAL, NORMAL), rtol=1e-15)
    for zero in StackSlopes((OBLIQUE,), [0.0, 0.0]):
        assert not zero.any()


def test_others_are_differenced():
    K, D = StiffnessAndDamping(Cubic(), [2.0, 0.5])
    assert_allclose(K, [[12.0, 0.0], [0.0, 0.0]], rtol=1e-7, atol=1e-7)
    assert_allclose(D, [[0.0, 2.0], [1.5, 0.0]], rtol=1e-7, atol=1e-7)


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

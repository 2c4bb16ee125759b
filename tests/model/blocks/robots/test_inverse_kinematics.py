"""Inverse kinematics of a plant, against the planar arm's closed form."""

import appendix_a
import numpy as np
import pytest
from numpy.testing import assert_allclose

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.robots.base import LoadModel, ReadModel
from teleop_drake.model.blocks.robots.inverse_kinematics import (
    SolveInverseKinematics,
    ToolJacobian,
)


@pytest.fixture(scope="module")
def plant():
    return LoadModel(ReadModel("two_link_arm"))


@pytest.mark.parametrize("q", [[0.4, 1.1], [-1.0, 0.7], [2.0, -1.5]])
def test_it_finds_the_joints_of_a_point(plant, q):
    point = appendix_a.p_WT(q)
    found = SolveInverseKinematics(plant, point, np.add(q, 0.2))
    assert_allclose(found, q, atol=1e-9)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, found)
    jacobian = ToolJacobian(plant, context, 2)
    assert_allclose(jacobian, appendix_a.J(q), atol=1e-8)


def test_a_stretched_posture_says_not_which_way_to_bend(plant):
    found = SolveInverseKinematics(plant, [1.0, 0.0], [0.0, 0.0])
    assert_allclose(appendix_a.p_WT(found), [1.0, 0.0], atol=1e-9)


def test_out_of_reach(plant):
    with pytest.raises(ScenarioError, match=r"start = .*comes no nearer than 0\.5 m"):
        SolveInverseKinematics(plant, [2.0, 0.0], [0.1, 0.1])


def test_singular(plant):
    with pytest.raises(ScenarioError, match=r"start = .*away from singular poses"):
        SolveInverseKinematics(plant, [1.4999999, 0.0], [0.0, 0.001])

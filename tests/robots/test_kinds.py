"""Robots by the names of their kinds."""

import pytest

from teleop_drake.robots import ROBOT_KINDS, MakeRobot
from teleop_drake.validation import ScenarioError


def test_the_kinds_of_the_package():
    assert ROBOT_KINDS.names == ("slider", "two_link_arm", "arm", "puma560")


@pytest.mark.parametrize("model, hint", [("two_link_arn", "did you mean"), ("pum", "")])
def test_unknown_model(model, hint):
    with pytest.raises(ScenarioError, match=f"model = '{model}': must be.*{hint}"):
        MakeRobot(model=model, start=[0.0])


def test_a_bad_field_has_its_path():
    with pytest.raises(ScenarioError, match=r"^robot\.mass = -1: must be"):
        MakeRobot(model="slider", start=[0.0], mass=-1)

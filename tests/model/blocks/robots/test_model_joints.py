"""Arms whose joints are locked, whose base is moved, or whose motors are added."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RollPitchYaw

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.robots import ArmConfig, FactsOfRobot, TwoLinkArmConfig

# The links of two_link_arm in the x-z plane, with a gripper of two coupled fingers.
MJCF = """
<mujoco model="arm"><worldbody><body name="upper">
  <joint name="shoulder" axis="0 1 0"/>
  <inertial pos="0.375 0 0" mass="0.5" diaginertia="0.0001 0.0234 0.0234"/>
  <body name="lower" pos="0.75 0 0">
    <joint name="elbow" axis="0 1 0"/>
    <inertial pos="0.375 0 0" mass="0.4" diaginertia="0.0001 0.0234 0.0234"/>
    <body name="tool" pos="0.75 0 0">
      <body name="left" pos="-0.375 0 0">
        <joint name="left" type="slide" axis="1 0 0" ref="0.1"/>
        <inertial pos="0 0 0" mass="0.05" diaginertia="1e-9 1e-9 1e-9"/></body>
      <body name="right" pos="-0.375 0 0"><joint name="right"/>
        <inertial pos="0 0 0" mass="0.05" diaginertia="1e-9 1e-9 1e-9"/></body>
    </body></body></body></worldbody>
  <equality><joint joint1="left" joint2="right"/></equality>
  <actuator><position joint="shoulder" kp="10"/><motor joint="left"/></actuator>
</mujoco>"""
LOCKED = ["left", "right"]
INTO_XY = [0.0, 0.0, 0.0, -np.pi / 2, 0.0, 0.0]
YZ_INTO_XY = [0.0, 0.0, 0.0, 0.0, -np.pi / 2, -np.pi / 2]


def upright(tmp_path, **fields):
    """Returns the arm of MJCF."""
    path = tmp_path / "upright.xml"
    path.write_text(MJCF)
    given = {"start": [0.85, 0.1], "posture": [0, -1.0], "locked": LOCKED, **fields}
    return ArmConfig(file=str(path), **{"add_motors": True, **given})


@pytest.mark.parametrize("place", [[0.0, 0.0], [0.3, -0.2]])
def test_an_upright_mjcf_arm_with_locked_fingers_is_the_two_link_arm(tmp_path, place):
    """The fingers' mass, locked at the middle of the link, is that of the lower link.

    Its axes, y, are -z of the world, so that it bends the other way.
    """
    start = [0.85 + place[0], 0.1 + place[1]]
    robot = upright(tmp_path, start=start, base=[*place, *INTO_XY[2:]]).MakeRobot()
    expected = TwoLinkArmConfig(start=[0.85, 0.1], elbow="down").MakeRobot()
    facts = FactsOfRobot(robot)
    reference = FactsOfRobot(expected)
    assert_allclose(facts.start, start, atol=1e-12)
    assert_allclose(facts.inertia, reference.inertia, rtol=1e-6)


def test_a_base_turns_the_plane_y_z_into_x_y():
    """It maps y to x and z to y."""
    R = RollPitchYaw(YZ_INTO_XY[3:]).ToRotationMatrix().matrix()
    assert_allclose(R[:, 1:], np.eye(3)[:, :2], atol=1e-15)


@pytest.mark.parametrize(
    "fields, message",
    [
        ({"locked": ["left"]}, r"locked = \['left'\]: must be with right, which"),
        ({"locked": [*LOCKED, "x"]}, "locked = 'x': must be names of joints: should"),
        ({"locked": "left"}, "locked = 'left': must be a list of names of joints"),
        ({"base": [0.0, 1.0]}, "base = .*: must be a list of 6 finite numbers"),
        ({"add_motors": False}, "one actuator for each joint, not 1 actuators for 2"),
        ({"base": None}, "start = .*: must be along axes .*, here x only; `base`"),
        ({"locked": ["shoulder", "elbow", *LOCKED], "posture": None}, "with any joint"),
    ],
)
def test_refusals_of_an_upright_arm(tmp_path, fields, message):
    config = upright(tmp_path, **{"base": INTO_XY, **fields})
    with pytest.raises(ScenarioError, match=message) as error:
        config.Check("robot")
    assert "\n" not in str(error.value)

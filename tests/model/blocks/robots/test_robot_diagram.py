import pytest

from teleop_drake.model.blocks.robots import SliderConfig, TwoLinkArmConfig

SLIDER = SliderConfig(start=[0.25])
ARM = TwoLinkArmConfig(start=[0.85, 0.1], elbow="down")
ROBOTS = pytest.mark.parametrize("config", [SLIDER, ARM], ids=["slider", "arm"])


@ROBOTS
def test_direct_feedthrough(config):
    robot = config.MakeRobot()
    expected = {
        "tool_position": set(),
        "tool_velocity": set(),
        "tool_acceleration": {"control_force", "environment_force"},
        "joint_position": set(),
        "joint_velocity": set(),
        # Computed together with the environment's.
        "joint_torque": {"control_force", "environment_force"},
    }
    for output, inputs in expected.items():
        index = robot.GetOutputPort(output).get_index()
        assert {
            name
            for name in ("control_force", "environment_force")
            if robot.HasDirectFeedthrough(robot.GetInputPort(name).get_index(), index)
        } == inputs, output

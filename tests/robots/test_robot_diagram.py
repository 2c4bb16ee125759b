import numpy as np
import pytest

from teleop_drake.robots import SliderConfig, TwoLinkArmConfig

SLIDER = SliderConfig(start=[0.25])
ARM = TwoLinkArmConfig(start=[0.85, 0.1], elbow="down")
ROBOTS = pytest.mark.parametrize("config", [SLIDER, ARM], ids=["slider", "arm"])


@ROBOTS
def test_default_context_is_at_rest_at_the_start(config):
    robot = config.MakeRobot()
    context = robot.CreateDefaultContext()
    np.testing.assert_allclose(
        robot.GetOutputPort("tool_position").Eval(context),
        config.start,
        atol=1e-14,
    )
    np.testing.assert_array_equal(
        robot.GetOutputPort("joint_velocity").Eval(context), 0.0
    )
    np.testing.assert_array_equal(
        robot.GetOutputPort("joint_position").Eval(context),
        config.JointPositions(config.start),
    )


@ROBOTS
def test_ports_have_the_sizes_of_the_task_and_joint_spaces(config):
    robot, n = config.MakeRobot(), config.num_axes
    assert robot.get_name() == "robot"
    for port in (
        *(robot.get_input_port(i) for i in range(robot.num_input_ports())),
        *(robot.get_output_port(i) for i in range(robot.num_output_ports())),
    ):
        assert port.size() == n


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

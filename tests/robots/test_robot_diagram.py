import numpy as np
import pytest
from forced_robot import context_with_forces
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig

from teleop_drake.robots import SliderConfig, TwoLinkArmConfig

SLIDER = SliderConfig(start=[0.25])
ARM = TwoLinkArmConfig(start=[0.85, 0.1], elbow="down")
ROBOTS = pytest.mark.parametrize("config", [SLIDER, ARM], ids=["slider", "arm"])


@pytest.mark.parametrize(
    "config, x",
    [(SliderConfig(start=[0.25], damping=0), [0, 1.5]), (ARM, [-0.9, 1.8, 1, -2])],
)
def test_energy_is_conserved_without_forces(config, x):
    n = config.num_axes
    robot = config.MakeRobot()
    simulator = Simulator(robot, context_with_forces(robot, [0] * n, [0] * n))
    ApplySimulatorConfig(
        SimulatorConfig(
            integration_scheme="runge_kutta5",
            max_step_size=0.05,
            accuracy=1e-11,
            use_error_control=True,
        ),
        simulator,
    )
    plant = robot.GetSubsystemByName("plant")
    context = simulator.get_mutable_context()
    context.SetContinuousState(x)

    def energy():
        plant_context = plant.GetMyContextFromRoot(context)
        return plant.CalcKineticEnergy(plant_context) + plant.CalcPotentialEnergy(
            plant_context
        )

    start = energy()
    assert start > 0.1
    simulator.AdvanceTo(3.0)
    assert energy() == pytest.approx(start, rel=1e-8)
    # It did move.
    assert abs(context.get_continuous_state_vector()[0] - x[0]) > 0.1


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

import appendix_a
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder

from teleop_drake.robots import (
    CheckRobot,
    InverseKinematics,
    LoadRobotPlant,
    MakeRobot,
    NumTaskAxes,
    RobotModels,
    TaskInertiaInverse,
)

SLIDER = {"model": "slider", "start": [0.25]}
ARM = {"model": "two_link_arm", "start": [0.85, 0.1], "elbow": "down"}
ROBOTS = pytest.mark.parametrize("parameters", [SLIDER, ARM], ids=["slider", "arm"])

radii = st.floats(0.0376, 1.4995)
angles = st.floats(-3.1, 3.1)
elbows = st.sampled_from(["up", "down"])
task_vectors = st.tuples(st.floats(-10, 10), st.floats(-10, 10)).map(np.array)


@pytest.fixture(scope="module")
def arm():
    return LoadRobotPlant("two_link_arm")


@pytest.fixture(scope="module")
def arm_robot():
    return MakeRobot(**ARM)


def random_states(count=20):
    return np.random.default_rng(1).uniform(-np.pi, np.pi, (count, 4))


def polar(radius, angle):
    return radius * np.array([np.cos(angle), np.sin(angle)])


def context_with_forces(robot, F_c, F_e):
    context = robot.CreateDefaultContext()
    robot.GetInputPort("control_force").FixValue(context, F_c)
    robot.GetInputPort("environment_force").FixValue(context, F_e)
    return context


# The model files against Appendix A.


@pytest.mark.parametrize("x", random_states())
def test_arm_has_the_dynamics_of_appendix_a(arm, x):
    q, qdot = x[:2], x[2:]
    context = arm.CreateDefaultContext()
    arm.SetPositionsAndVelocities(context, x)
    world = arm.world_frame()
    J = arm.CalcJacobianTranslationalVelocity(
        context,
        JacobianWrtVariable.kV,
        arm.GetFrameByName("tool"),
        np.zeros(3),
        world,
        world,
    )
    p_WT = arm.EvalBodyPoseInWorld(context, arm.GetBodyByName("tool")).translation()
    np.testing.assert_allclose(arm.CalcMassMatrix(context), appendix_a.M(q), atol=1e-10)
    np.testing.assert_allclose(
        arm.CalcBiasTerm(context), appendix_a.C(q, qdot) @ qdot, atol=1e-10
    )
    np.testing.assert_allclose(J[:2], appendix_a.J(q), atol=1e-10)
    np.testing.assert_allclose(p_WT, [*appendix_a.p_WT(q), 0], atol=1e-10)
    # The plane is horizontal.
    np.testing.assert_allclose(arm.CalcGravityGeneralizedForces(context), 0, atol=1e-10)


@pytest.mark.parametrize("x", random_states())
def test_c21_as_printed_is_wrong(arm, x):
    q, qdot = x[:2], x[2:]
    context = arm.CreateDefaultContext()
    arm.SetPositionsAndVelocities(context, x)
    error = arm.CalcBiasTerm(context) - appendix_a.C_as_printed(q, qdot) @ qdot
    assert abs(error[0]) < 1e-10
    assert abs(error[1]) > 1e-3


@pytest.mark.parametrize("x", random_states())
def test_arm_in_a_vertical_plane_has_the_gravity_of_appendix_a(x):
    plant = LoadRobotPlant("two_link_arm", gravity=[0, -appendix_a.g])
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, x)
    np.testing.assert_allclose(
        -plant.CalcGravityGeneralizedForces(context), appendix_a.G(x[:2]), atol=1e-10
    )


def test_slider_has_the_dynamics_of_2_12():
    robot = MakeRobot(**SLIDER)
    context = context_with_forces(robot, F_c=[0.7], F_e=[0.3])
    context.SetContinuousState([0.25, 2.0])
    acceleration = (0.7 - 0.3 - 0.1 * 2.0) / 0.5
    np.testing.assert_allclose(
        robot.EvalTimeDerivatives(context).CopyToVector(), [2.0, acceleration]
    )
    np.testing.assert_allclose(
        robot.GetOutputPort("tool_acceleration").Eval(context), [acceleration]
    )


@given(task_vectors, task_vectors, st.integers(0, 19))
@settings(max_examples=50, deadline=None)
def test_arm_moves_as_2_6_says(arm_robot, F_c, F_e, index):
    x = random_states()[index]
    q, qdot = x[:2], x[2:]
    context = context_with_forces(arm_robot, F_c, F_e)
    context.SetContinuousState(x)
    J = appendix_a.J(q)
    qddot = np.linalg.solve(
        appendix_a.M(q), J.T @ (F_c - F_e) - appendix_a.C(q, qdot) @ qdot
    )
    centripetal = -appendix_a.L1 * qdot[0] ** 2 * polar(1, q[0])
    centripetal -= appendix_a.L3 * (qdot[0] + qdot[1]) ** 2 * polar(1, q[0] + q[1])
    expected = {
        "joint_position": q,
        "joint_velocity": qdot,
        "joint_torque": J.T @ F_c,
        "tool_position": appendix_a.p_WT(q),
        "tool_velocity": J @ qdot,
        "tool_acceleration": J @ qddot + centripetal,
    }
    np.testing.assert_allclose(
        arm_robot.EvalTimeDerivatives(context).CopyToVector()[2:], qddot, atol=1e-9
    )
    for name, value in expected.items():
        np.testing.assert_allclose(
            arm_robot.GetOutputPort(name).Eval(context),
            value,
            atol=1e-9,
            err_msg=name,
        )


@given(task_vectors, st.integers(0, 19))
@settings(max_examples=50, deadline=None)
def test_joint_torque_has_the_power_of_the_control_force(arm_robot, F_c, index):
    context = context_with_forces(arm_robot, F_c, [0, 0])
    context.SetContinuousState(random_states()[index])
    v_WT, tau, qdot = (
        arm_robot.GetOutputPort(name).Eval(context)
        for name in ("tool_velocity", "joint_torque", "joint_velocity")
    )
    assert F_c @ v_WT == pytest.approx(tau @ qdot, abs=1e-10)


@pytest.mark.parametrize(
    "parameters, x", [({**SLIDER, "damping": 0}, [0, 1.5]), (ARM, [-0.9, 1.8, 1, -2])]
)
def test_energy_is_conserved_without_forces(parameters, x):
    n = len(parameters["start"])
    robot = MakeRobot(**parameters)
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


# Inverse kinematics and the start pose.


@given(radii, angles, elbows)
@settings(deadline=None)
def test_inverse_kinematics_reaches_the_point(radius, angle, elbow):
    p_WT = polar(radius, angle)
    q = InverseKinematics("two_link_arm", p_WT, elbow)
    np.testing.assert_allclose(appendix_a.p_WT(q), p_WT, atol=1e-12)
    assert 0 < (q[1] if elbow == "down" else -q[1]) < np.pi


@given(radii, angles, elbows)
@settings(deadline=None)
def test_mirrored_points_have_mirrored_poses(radius, angle, elbow):
    other = "up" if elbow == "down" else "down"
    np.testing.assert_allclose(
        InverseKinematics("two_link_arm", polar(radius, -angle), other),
        -InverseKinematics("two_link_arm", polar(radius, angle), elbow),
        atol=1e-12,
    )


def test_elbow_down_is_at_negative_y_of_an_arm_stretched_forward():
    q = InverseKinematics("two_link_arm", [0.85, 0.0], "down")
    assert q[0] < 0 < q[1]


@ROBOTS
def test_default_context_is_at_rest_at_the_start(parameters):
    robot = MakeRobot(**parameters)
    context = robot.CreateDefaultContext()
    np.testing.assert_allclose(
        robot.GetOutputPort("tool_position").Eval(context),
        parameters["start"],
        atol=1e-14,
    )
    np.testing.assert_array_equal(
        robot.GetOutputPort("joint_velocity").Eval(context), 0.0
    )
    np.testing.assert_array_equal(
        robot.GetOutputPort("joint_position").Eval(context),
        InverseKinematics(
            parameters["model"], parameters["start"], parameters.get("elbow")
        ),
    )


def test_task_inertia_inverse():
    assert TaskInertiaInverse(**SLIDER) == pytest.approx(np.array([[2.0]]))
    assert TaskInertiaInverse(**SLIDER, mass=0.2) == pytest.approx(np.array([[5.0]]))
    q = InverseKinematics("two_link_arm", ARM["start"], "down")
    J, M = appendix_a.J(q), appendix_a.M(q)
    np.testing.assert_allclose(
        TaskInertiaInverse(**ARM), J @ np.linalg.inv(M) @ J.T, atol=1e-10
    )


def test_mass_and_damping_are_in_the_default_context():
    mass, damping = 0.1 + 0.2, 1e-3
    robot = MakeRobot(**SLIDER, mass=mass, damping=damping)
    plant = robot.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(robot.CreateDefaultContext())
    assert plant.CalcMassMatrix(context) == np.array([[mass]])
    context = context_with_forces(robot, [0.0], [0.0])
    context.SetContinuousState([0.0, 1.0])
    assert robot.EvalTimeDerivatives(context)[1] == pytest.approx(-damping / mass)


# The Diagram.


@ROBOTS
def test_ports_have_the_sizes_of_the_task_and_joint_spaces(parameters):
    robot = MakeRobot(**parameters)
    n = NumTaskAxes(parameters["model"])
    assert robot.get_name() == "robot"
    assert [
        (robot.get_input_port(i).get_name(), robot.get_input_port(i).size())
        for i in range(robot.num_input_ports())
    ] == [("control_force", n), ("environment_force", n)]
    assert [
        (robot.get_output_port(i).get_name(), robot.get_output_port(i).size())
        for i in range(robot.num_output_ports())
    ] == [
        (name, n)
        for name in (
            "tool_position",
            "tool_velocity",
            "tool_acceleration",
            "joint_position",
            "joint_velocity",
            "joint_torque",
        )
    ]


@ROBOTS
def test_direct_feedthrough(parameters):
    robot = MakeRobot(**parameters)
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


def test_forces_computed_from_the_tool_make_no_algebraic_loop():
    builder = DiagramBuilder()
    robot = builder.AddSystem(MakeRobot(**ARM))
    environment = builder.AddNamedSystem("environment", Adder(2, 2))
    controller = builder.AddNamedSystem("controller", Adder(3, 2))
    for system in (environment, controller):
        builder.Connect(robot.GetOutputPort("tool_position"), system.get_input_port(0))
        builder.Connect(robot.GetOutputPort("tool_velocity"), system.get_input_port(1))
    F_e = environment.get_output_port()
    builder.Connect(F_e, controller.get_input_port(2))
    builder.Connect(F_e, robot.GetInputPort("environment_force"))
    builder.Connect(controller.get_output_port(), robot.GetInputPort("control_force"))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    assert controller.get_output_port().Eval(
        controller.GetMyContextFromRoot(context)
    ) == pytest.approx(2 * np.array(ARM["start"]))


# Bad input.


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"model": "two_link_arn"}, "robot.model: 'two_link_arn'.*mean two_link_arm?"),
        ({"model": "puma"}, "robot.model: 'puma' is not one of slider, two_link_arm$"),
        ({"start": [1.6, 0]}, r"robot.start: \[1.6, 0\] is 1.6 m.*0.0375.* to 1.499"),
        ({"start": [1.5, 0]}, "robot.start: .* is 1.5 m from the shoulder"),
        ({"start": [0, 0]}, "robot.start: .* is 0 m from the shoulder"),
        ({"start": [0.03, 0]}, "robot.start: .* is 0.03 m from the shoulder"),
        ({"start": [0.85]}, r"robot.start: \[0.85\] must be a list of 2 finite"),
        ({"start": [0.85, np.nan]}, r"robot.start: \[0.85, nan\] must be a list of 2"),
        ({"start": [-np.inf, 0]}, r"robot.start: \[-inf, 0\] must be a list of 2"),
        ({"start": ["near", 0]}, r"robot.start: \['near', 0\] must be a list of 2"),
        ({"start": None}, "robot.start: None must be a list of 2"),
        ({"start": [[0.85, 0.0]]}, r"robot.start: \[\[0.85, 0.0\]\] must be a list"),
        ({"elbow": "left"}, "robot.elbow: 'left' must be up or down"),
        ({"elbow": None}, "robot.elbow: None must be up or down"),
        ({"mass": 1.0}, "robot.mass: 1.0 must be null for two_link_arm"),
        ({"damping": 0.0}, "robot.damping: 0.0 must be null for two_link_arm"),
        ({**SLIDER, "elbow": "up"}, "robot.elbow: 'up' must be null"),
        ({**SLIDER, "start": []}, r"robot.start: \[\] must be a list of 1 finite"),
        ({**SLIDER, "start": 0.1}, "robot.start: 0.1 must be a list of 1 finite"),
        ({**SLIDER, "elbow": None, "mass": 0}, "robot.mass: 0 must be finite and > 0"),
        ({**SLIDER, "elbow": None, "mass": np.inf}, "robot.mass: inf must be finite"),
        ({**SLIDER, "elbow": None, "damping": -1}, "robot.damping: -1 .*>= 0 N s/m"),
        ({**SLIDER, "elbow": None, "damping": np.nan}, "robot.damping: nan must be"),
        ({**SLIDER, "elbow": None, "damping": np.inf}, "robot.damping: inf must be"),
    ],
)
def test_bad_input_gets_one_clear_line(changes, message):
    for function in (MakeRobot, CheckRobot):
        with pytest.raises(ValueError, match=message) as error:
            function(**{**ARM, **changes})
        assert "\n" not in str(error.value)


def test_every_model_is_listed():
    assert RobotModels() == ("slider", "two_link_arm")
    assert [NumTaskAxes(model) for model in RobotModels()] == [1, 2]

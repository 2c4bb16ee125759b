"""Tests of the whole loop's structure."""

from itertools import product

import pytest
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.primitives import MatrixGain

from teleop_drake.loops.draw.block_diagram import DiagramDot
from teleop_drake.model.blocks.architectures.direct_force import DirectForce
from teleop_drake.model.blocks.robots import MakeRobot
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import ARCHITECTURES, LoadScenario, ScenarioError
from teleop_drake.model.stations import MakeArchitecture, MakeMasterStation
from teleop_drake.model.teleoperator import MakeTeleoperator
from teleop_drake.study.analysis.stability import AnalyzeStability

FIGURE_2_1 = {
    "master",
    "forward_channel",
    "controller",
    "robot",
    "environment",
    "return_channel",
}
TASKS = ("one_dof", "two_dof_puncture", "two_dof_collision", "two_dof_combined")


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("name", "kind"),
    [*product(TASKS, ARCHITECTURES[:1]), *product(TASKS[-1:], ARCHITECTURES[1:])],
)
def test_depth_one_is_figure_2_1(name, kind):
    diagram = MakeTeleoperator(LoadScenario(name, {"controller.kind": kind}))
    assert {system.get_name() for system in diagram.GetSystems()} == FIGURE_2_1
    assert diagram.num_input_ports() == diagram.num_output_ports() == 0
    dot = DiagramDot(diagram, max_depth=1)
    for box in FIGURE_2_1:
        assert f"name={box}" in dot


def test_every_station_opens_and_every_system_is_named():
    diagram = MakeTeleoperator(LoadScenario("two_dof_combined"))

    def Names(system):
        """Yields the path of every system inside a system."""
        for child in getattr(system, "GetSystems", list)():
            yield child.get_name()
            yield from (f"{child.get_name()}.{name}" for name in Names(child))

    names = set(Names(diagram))
    assert not any("@" in name for name in names)
    stations = {"master.surgeon", "master.haptic_device", "robot.tool_interface"}
    assert stations | {"controller.adaptive_backstepping", "robot.plant"} <= names


@pytest.mark.mostly_slow
@pytest.mark.parametrize("kind", ARCHITECTURES)
def test_no_delay_makes_no_algebraic_loop(kind):
    overrides = {"controller.kind": kind, "delay": 0.0, "duration": 0.05}
    scenario = LoadScenario("one_dof", overrides)
    assert simulate(scenario).termination == "completed"


def test_default_context_is_the_start():
    diagram = MakeTeleoperator(LoadScenario("two_dof_combined"))
    context = diagram.CreateDefaultContext()
    robot = diagram.GetSubsystemByName("robot")
    position = robot.GetOutputPort("tool_position").Eval(
        robot.GetMyContextFromRoot(context)
    )
    assert position.tolist() == pytest.approx([0.85, 0.0], abs=1e-12)
    channel = diagram.GetSubsystemByName("return_channel")
    felt = channel.get_output_port().Eval(channel.GetMyContextFromRoot(context))
    assert felt.tolist() == pytest.approx([0.85, 0.0, 0.0, 0.0], abs=1e-12)


def test_stations_speak_in_packets():
    scenario = LoadScenario("two_dof_combined")
    master = MakeMasterStation(scenario)
    assert master.GetInputPort("return_packet").size() == 4
    assert master.GetOutputPort("forward_packet").size() == 4
    slave = MakeArchitecture(scenario).slave_side
    assert slave.GetInputPort("forward_packet").size() == 4
    assert slave.GetOutputPort("return_packet").size() == 4
    assert slave.GetOutputPort("psi").size() == 4
    # The felt motion does not reach the forward packet without a delay in between.
    assert not master.HasDirectFeedthrough(0, 0)


def test_an_invalid_scenario_is_refused():
    scenario = LoadScenario("one_dof")
    scenario.forward_channel.delay = -1.0
    with pytest.raises(ScenarioError, match=r"forward_channel\.delay"):
        MakeTeleoperator(scenario)


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    "kind", ["smith_predictor", "adaptive_backstepping", "four_channel"]
)
def test_defaults_derive_from_the_robot_in_the_diagram(kind):
    """A user's robot of 5 kg gets the gains for 5 kg, not for the scenario's 0.5 kg."""
    scenarios = [
        LoadScenario(
            "one_dof", {"controller.kind": kind, "duration": 0.5, "robot.mass": mass}
        )
        for mass in (0.5, 5.0)
    ]
    heavy = MakeRobot(model="slider", start=[0.0], mass=5.0)
    own = simulate(
        scenarios[0], teleoperator=MakeTeleoperator(scenarios[0], robot=heavy)
    )
    expected = simulate(scenarios[1])
    assert_allclose(own["control_force"], expected["control_force"])


def test_control_law_without_the_ports_is_refused():
    law = MatrixGain([[1.0]])
    with pytest.raises(ScenarioError, match=r"lacks the ports .*control_force"):
        MakeTeleoperator(LoadScenario("one_dof"), control_law=law)


class Telling(DirectForce):
    """A control law with one more output."""

    def __init__(self, output):
        super().__init__(num_axes=1)
        self.set_name("telling")
        self.DeclareVectorOutputPort(
            output, 1, lambda context, value: None, {self.nothing_ticket()}
        )


@pytest.mark.parametrize(
    "output, owner",
    [
        ("forward_packet_received", "forward_channel"),
        ("velocity_command", "master"),
        ("joint_torque", "robot"),
    ],
)
def test_outputs_with_the_name_of_another_signal_are_refused(output, owner):
    scenario = LoadScenario("one_dof")
    with pytest.raises(ValueError, match=f"'{output}'") as raised:
        MakeTeleoperator(scenario, control_law=Telling(output))
    message = str(raised.value)
    assert {"controller", owner} <= set(message.replace(":", "").split())
    assert "\n" not in message
    assert MakeTeleoperator(scenario, control_law=Telling("doubt"))


@pytest.mark.slow
def test_a_diagram_is_run_and_analysed_in_any_order():
    """An analysis and runs of one diagram do not change each other's results."""
    scenario = LoadScenario(
        "one_dof", {"controller.kind": "direct_force", "duration": 0.05}
    )
    teleoperator = MakeTeleoperator(scenario)

    def Analyze() -> list[dict]:
        analysis = AnalyzeStability(scenario, teleoperator=teleoperator)
        return [point.ToRecord() for point in analysis.points]

    before = Analyze()
    first, again = (simulate(scenario, teleoperator=teleoperator) for _ in range(2))
    assert Analyze() == before
    assert_array_equal(first["tool_position"], again["tool_position"])
    CheckKernel(teleoperator, num_states=1)  # Compiled runs use these kernels.

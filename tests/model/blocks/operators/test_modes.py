"""What all operators have in common, and the hand; see also test_planned."""

import numpy as np
import pytest
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose
from pydrake.systems.framework import DiagramBuilder

from teleop_drake.model.blocks.environments import CONTACT, Surface
from teleop_drake.model.blocks.operators import OPERATOR_KINDS
from teleop_drake.model.blocks.operators.hand import HandOperator
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import (
    LoadScenario,
    ScenarioError,
    ScenarioFromYaml,
    ScenarioToYaml,
)
from teleop_drake.model.stations import MakeMasterStation

SURFACE = Surface(CONTACT, [0.55, 0.0], [1.0, 0.0])


@pytest.fixture
def hand_file(tmp_path):
    file = tmp_path / "hand.csv"
    file.write_text("time,v_x,v_y\n0,0,0\n0.5,0.1,0\n0.75,0.1,-0.2\n")
    return file


def Config(kind, hand_file):
    own = {"file": str(hand_file)} if kind == "recorded" else {}
    return OPERATOR_KINDS.Find(kind, "surgeon.kind")(
        velocity=np.array([0.1, 0.05]),
        contact_force=np.array([0.2, 0.0]),
        stop_time=0.9,
        **own,
    )


@pytest.mark.mostly_slow
@pytest.mark.parametrize("kind", OPERATOR_KINDS.names)
def test_kernel_mode_and_seam(kind, hand_file):
    config = Config(kind, hand_file)
    config.Check("surgeon", 2)
    dut = config.MakeOperator(start=[0.0, 0.0], contact_surface=SURFACE)
    CheckKernel(dut, num_states=2)
    context = dut.CreateDefaultContext()
    for name in ("haptic_force", "felt_position", "felt_velocity"):
        if dut.HasInputPort(name):
            dut.GetInputPort(name).FixValue(context, [1.0, 2.0])
    assert dut.GetOutputPort("mode").Eval(context).tolist() == [0]
    # The hand applies what the device asks for.
    assert dut.GetOutputPort("force_command").Eval(context).tolist() == [1, 2]


@pytest.mark.parametrize("kind", OPERATOR_KINDS.names)
def test_a_scenario_changes_its_operator_by_the_kind_alone(kind, hand_file):
    overrides = {"surgeon.kind": kind}
    if kind == "recorded":
        overrides["surgeon.file"] = str(hand_file)
    scenario = LoadScenario("two_dof_collision", overrides)
    assert scenario.surgeon.kind == kind
    assert ScenarioFromYaml(ScenarioToYaml(scenario)) == scenario
    station = MakeMasterStation(scenario)
    assert station.GetSubsystemByName("surgeon").GetOutputPort("mode").size() == 1


@pytest.mark.slow
@pytest.mark.parametrize("kind", OPERATOR_KINDS.names)
def test_both_engines_run_it_alike(kind, tmp_path):
    file = tmp_path / "hand.csv"
    file.write_text("0,0\n0.5,0.001\n1.5,0.001\n1.7,-0.001\n2.5,0\n")
    own = {"recorded": {"surgeon.file": str(file)}}.get(kind, {})
    scenario = LoadScenario(
        "one_dof",
        {
            "surgeon.kind": kind,
            "surgeon.stop_time": 2.2,
            "controller.kind": "direct_force",
            "environment.layers.free.start": 0.0005,
            "duration": 3.0,
        }
        | own,
    )
    drake, compiled = (simulate(scenario, engine=x) for x in ("drake", "compiled"))
    times = np.linspace(0.0, 3.0, 61)
    ours, theirs = (x.Interpolate("tool_velocity", times) for x in (compiled, drake))
    # Where a bend of the command arrives Drake's steps do not end.
    assert_allclose(ours, theirs, atol=3e-4 * np.abs(theirs).max())


def test_the_thesis_operator_needs_no_kind():
    scenario = LoadScenario("one_dof")
    assert scenario.surgeon.kind == "constant_velocity"
    assert LoadScenario("one_dof", {"surgeon.kind": "constant_velocity"}) == scenario


def test_a_diagram_of_ones_own_can_be_operator(hand_file):
    """In the place of the scenario's, without inputs that it does not need."""
    inner = Config("sine", hand_file).MakeOperator(start=[0.0, 0.0])
    builder = DiagramBuilder()
    builder.AddNamedSystem("inner", inner)
    for name in ("haptic_force", "felt_position"):
        builder.ExportInput(inner.GetInputPort(name), name)
    for name in ("velocity_command", "force_command", "mode"):
        builder.ExportOutput(inner.GetOutputPort(name), name)
    scenario = LoadScenario("two_dof_collision")
    station = MakeMasterStation(scenario, operator=builder.Build())
    assert station.GetOutputPort("forward_packet").size() == 4


def test_the_hand_follows_the_line_that_is_set_and_holds_its_end(subtests):
    dut = HandOperator(num_axes=2)
    CheckKernel(dut)
    context = dut.CreateDefaultContext()
    port = dut.GetOutputPort("velocity_command")
    line = dut.GetInputPort("line")
    assert port.Eval(context).tolist() == [0, 0]
    line.FixValue(context, [1.0, 2.0, 0.0, 0.1, 0.2, 0.1])
    for time, expected in ((0.5, 0.0), (1.25, 0.05), (2.0, 0.2), (5.0, 0.2)):
        with subtests.test(time=time):
            context.SetTime(time)
            assert port.Eval(context).tolist() == pytest.approx([expected, 0.1])
    # A change of the line alone is seen.
    line.FixValue(context, [4.0, 6.0, 0.0, 0.1, 0.2, 0.1])
    assert port.Eval(context).tolist() == pytest.approx([0.1, 0.1])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ("kind=sin", "kind = 'sin': must be one of constant_velocity"),
        ("kind=human goal=force", "goal = 'force': must be one"),
        ("kind=human reaction_delay=1e-9",
         "reaction_delay = 1e-09: must be 0 or a finite number >= 1e-06"),
        ("kind=human arm_mass=0", "arm_mass = 0.0: must be a"),
        ("kind=sine frequency=0", "frequency = 0.0: must be a"),
        ("kind=trapezoid rise_time=0", "rise_time = 0.0: must"),
        ("kind=sine velocity=[0]", "velocity = [0.0]: must be"),
        ("kind=minimum_jerk waypoints=[[0.1],[0.1]]",
         "waypoints.1 = [0.1]: must be another point than the waypoint"),
        ("kind=minimum_jerk waypoints=[[0.0]]",
         "waypoints.0 = [0.0]: must be another point than the start"),
        ("kind=minimum_jerk waypoints=[[0.1],[0.10000001]]",
         "waypoints.1 = [0.10000001]: must be another point than the waypoint"),
        ("kind=minimum_jerk waypoints=[[0.1,0]]",
         "waypoints.0 = [0.1, 0.0]: must be a list of 1 finite number (m)"),
        ("kind=recorded", "file = null: must be a table of time and v_d"),
        ("kind=sine rise_time=2", "rise_time = 2.0: must be 0.5 for the sine operator"),
    ],
)  # fmt: skip
def test_refused(fields, message):
    with pytest.raises(ScenarioError) as error:
        LoadScenario("one_dof", [f"surgeon.{field}" for field in fields.split()])
    assert str(error.value).startswith(f"surgeon.{message}")
    assert "\n" not in str(error.value)

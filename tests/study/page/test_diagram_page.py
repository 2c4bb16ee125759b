"""The page of anybody's Diagram: numbers of its Context as inputs, and its plants."""

from pathlib import Path

import numpy as np
import pytest
from foreign.wiring import SerialArm
from pydrake.common import RandomDistribution, RandomGenerator
from pydrake.examples import PendulumPlant
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.controllers import PidController
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    Gain,
    Integrator,
    MultilayerPerceptron,
    RandomSource,
    ZeroOrderHold,
)
from wasm_runs import DataOf

from teleop_drake import Compile, Explore, TransportDelay, WritePage, simulate
from teleop_drake.cli import main
from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.engine.parameters import SetNumbers
from teleop_drake.loops.numerics.step_polynomials import interpolate
from teleop_drake.loops.page.plants import PlantPictures, ViewOf
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.study.page.page import MakePage


def MakePendulum():
    """A pendulum that is held late.

    This paragraph is not shown.
    """
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", PendulumPlant())
    pid = builder.AddNamedSystem("pid", PidController([10.0], [1.0], [1.0]))
    aim = builder.AddNamedSystem("aim", ConstantVectorSource([1.0, 0.0]))
    sensor = builder.AddNamedSystem("sensor", TransportDelay(0.05, 2))
    builder.Connect(aim.get_output_port(), pid.get_input_port_desired_state())
    builder.Connect(plant.get_output_port(), sensor.get_input_port())
    builder.Connect(sensor.get_output_port(), pid.get_input_port_estimated_state())
    builder.Connect(pid.get_output_port(), plant.get_input_port())
    builder.ExportOutput(plant.get_output_port(), "state")
    diagram = builder.Build()
    diagram.set_name("held_pendulum")
    return diagram


VARY = {"plant.length": (0.2, 2.0), "delay": (0.0, 0.3), "plant/theta(0)": (-1, 1)}


def test_numbers_of_a_context_are_inputs(look, tmp_path):
    page = tmp_path / "page.html"
    assert WritePage(MakePendulum, page, vary=VARY, duration=5.0) == []
    found = look(page, "anybody.js")
    assert found["title"] == "held pendulum: 0 s late"
    assert found["story"] == "A pendulum that is held late."
    assert found["shown"] == ["plant.length", "delay [s]", "plant/theta(0)"]
    assert found["head"].startswith("statetheta thetadot held pendulum theta 0.4")
    assert found["tries"] == ["0 s late", "0.15 s late", "plant.length = 2"]
    assert found["box"][:2] == ["plant.length", "plant/theta(0)"]
    assert set(found["box"][2:]) == {"damping", "gravity", "mass"}
    assert sorted(found["after"]) == sorted(found["shown"])
    assert found["inputs"]["delay"]["min"] == 0
    diagram = MakePendulum()
    numbers = {}
    for (name, value), states in zip(
        [
            ("delay", 0.12),
            ("delay", 0.0),
            ("plant.length", 0.8),
            ("plant/theta(0)", 0.4),
            ("plant.damping", 0.3),
        ],
        found["samples"],
        strict=True,
    ):
        numbers[name] = value
        context = diagram.CreateDefaultContext()
        SetNumbers(diagram, context, numbers)
        recording = simulate(diagram, context=context, duration=5.0)
        expected = recording.Interpolate("state", np.array([0.5, 1.0, 2.0, 4.0]))
        np.testing.assert_allclose(np.transpose(states), expected, atol=2e-6)


@pytest.mark.slow
def test_a_page_goes_on_where_a_run_has_ended(look, tmp_path):
    """The delay's signal and packets are under way; a random source draws on.

    The page begins with a draw, which is held at the same instant.
    """
    builder = DiagramBuilder()
    pendulum = builder.AddNamedSystem("pendulum", MakePendulum())
    packets = builder.AddNamedSystem(
        "packets", SampledDelay(size=2, delay=0.3, sample_period=0.1)
    )
    noise = RandomSource(RandomDistribution.kGaussian, 2, 0.03)
    builder.AddNamedSystem("noise", noise)
    hold = builder.AddNamedSystem("hold", ZeroOrderHold(0.03, 2))
    builder.Connect(noise.get_output_port(), hold.get_input_port())
    builder.Connect(pendulum.get_output_port(), packets.get_input_port())
    builder.ExportOutput(pendulum.get_output_port(), "state")
    builder.ExportOutput(packets.get_output_port(), "shown")
    builder.ExportOutput(noise.get_output_port(), "noise")
    builder.ExportOutput(hold.get_output_port(), "held")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(4))
    first = simulate(diagram, context=context, duration=0.72)
    continued = {
        "context": first.final_context,
        "duration": 2.0,
        "suppress_initialization_events": True,
    }
    notes = WritePage(diagram, tmp_path / "page.html", **continued)
    (found,) = look(tmp_path / "page.html", "rows.js")
    second = simulate(diagram, **continued)
    assert found["time"][0] == 0.72
    assert found["time"][-1] == pytest.approx(2.72, abs=1e-12)
    check_rows(found, second, np.linspace(0.72, 2.72, 200)[1:-1] + 1e-6)
    reason = "sensor.delay = 0.005: must be 0.05 s while a signal is under way"
    assert notes == [f"pendulum/sensor.delay has no slider: {reason}"]
    shown = look(tmp_path / "page.html", "window.js")
    assert shown["clock"] == pytest.approx([0.72, 2.72], abs=1e-12)
    begin, end = shown["clock"]
    at_begin = {"window": [begin, end], "cursor": begin}
    assert shown["first"] == shown["again"] == at_begin
    assert shown["last"] == {"window": [begin, end], "cursor": end}
    assert shown["near"]["window"] == pytest.approx([1.72, 2.72], abs=1e-12)


def check_rows(found, expected, times):
    """Checks the signals of a page at times in s."""
    steps = np.array(found["ends"])[:, np.newaxis] + np.arange(-4, 1)
    for name in expected:
        values = np.array(found["signals"][name])
        shown = interpolate(np.array(found["time"]), values, steps, times)
        np.testing.assert_allclose(shown, expected.Interpolate(name, times), atol=1e-9)


def test_without_ranges_delays_and_four_parameters_have_sliders():
    page = Explore(MakePendulum())
    assert page.notes == []
    shown = [name for name in _Inputs(page) if not _Inputs(page)[name]["isField"]]
    assert shown == [
        "sensor.delay",
        *("pid.kp", "pid.ki", "pid.kd", "plant.length"),
    ]


def test_nobody_is_asked_to_drag_a_weight_or_what_has_no_name():
    builder = DiagramBuilder()
    network = builder.AddNamedSystem("network", MultilayerPerceptron([1, 3, 1]))
    unnamed = builder.AddSystem(Gain(2.0, 1))
    state = builder.AddNamedSystem("state", Integrator(1))
    builder.Connect(network.get_output_port(), unnamed.get_input_port())
    builder.Connect(unnamed.get_output_port(), state.get_input_port())
    builder.Connect(state.get_output_port(), network.get_input_port())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(1))
    page = MakePage(diagram, context=context)
    sliders = [one for one in page.data["inputs"] if not one["isField"]]
    assert [(one["name"], one["isTried"]) for one in sliders] == [("Gain.k", False)]


def _Inputs(page):
    """Returns the inputs of a page by their names."""
    return {one["name"]: one for one in DataOf(page.html)["inputs"]}


@pytest.mark.slow
def test_a_notebook_names_ranges_and_a_context():
    diagram = MakePendulum()
    context = diagram.CreateDefaultContext()
    SetNumbers(diagram, context, {"plant.length": 0.7})
    page = Explore(diagram, context=context, delay=(0.0, 0.2))
    inputs = _Inputs(page)
    assert inputs["delay"]["max"] == 0.2 and not inputs["delay"]["isField"]
    assert inputs["plant.length"]["value"] == 0.7 and inputs["plant.length"]["isField"]


def test_a_kept_program_takes_all_delays_and_initial_states():
    diagram = MakePendulum()
    context = diagram.CreateDefaultContext()
    numbers = {"delay": 0.1, "plant/theta(0)": 0.4, "aim.value(0)": 0.2}
    program = Compile(diagram, context=context, duration=1.0)
    SetNumbers(diagram, context, numbers)
    expected = simulate(diagram, context=context, duration=1.0)
    assert expected["state"][0, 0] == 0.4
    np.testing.assert_array_equal(program.Run(**numbers)["state"], expected["state"])


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ({"plant.lenght": (0.5, 2)}, "did you mean 'plant.length'"),
        ({"plant.length": (2, 0.5)}, "LO:HI, the larger one behind"),
        ({"plant.length": ("a", "b")}, "plant.length = .*: must be two numbers"),
        ({"plant.length": (0.5, 1, 2)}, "plant.length = .*: must be two numbers"),
        ({"delay": (-0.1, 0.5)}, "delay = '-0.1:0.5': must be 0 s or more"),
        ({"plant/psi(0)": (0, 1)}, "vary = 'plant.psi.0.': must be one of"),
    ],
    ids=["unknown", "reversed", "text", "three", "negative", "no state"],
)
def test_what_cannot_be_varied_is_refused(vary, message):
    with pytest.raises(ScenarioError, match=message):
        MakePage(MakePendulum(), vary=vary)


def MakeEcho():
    """Returns y(t) = 0.5 y(t - T) + 1, which needs its delay."""
    builder = DiagramBuilder()
    delay = builder.AddNamedSystem("echo", TransportDelay(0.1, 1))
    half = builder.AddNamedSystem("half", Gain(0.5, 1))
    one = builder.AddNamedSystem("one", ConstantVectorSource([1.0]))
    total = builder.AddNamedSystem("total", Adder(2, 1))
    builder.Connect(one.get_output_port(), total.get_input_port(0))
    builder.Connect(half.get_output_port(), total.get_input_port(1))
    builder.Connect(total.get_output_port(), delay.get_input_port())
    builder.Connect(delay.get_output_port(), half.get_input_port())
    builder.ExportOutput(total.get_output_port(), "y")
    return builder.Build()


def test_a_delay_that_a_loop_needs_does_not_become_0():
    page = MakePage(MakeEcho())
    assert _Inputs(page)["echo.delay"]["min"] == pytest.approx(0.005)
    with pytest.raises(ScenarioError, match="a signal depends on itself"):
        MakePage(MakeEcho(), vary={"echo.delay": (0, 1)})


@pytest.mark.slow
def test_a_scenario_has_a_program_with_and_without_delays(look, tmp_path):
    """Its runs are those of blocks that are made with the delay, or without."""
    overrides = {"duration": 1.0}
    page = tmp_path / "page.html"
    WritePage("one_dof", page, vary={"delay": (0, 0.2)}, overrides=overrides)
    found = look(page, "nolag.js")
    assert found["min"] == 0
    assert len(found["runs"]) == 4
    for run in found["runs"]:
        numbers = {"delay": run["delay"], "controller.kind": run["kind"]}
        recording = simulate(LoadScenario("one_dof", numbers | overrides))
        expected = recording.Interpolate("tool_velocity", np.array([0.3, 0.6, 0.9]))
        np.testing.assert_allclose(run["velocity"][0], expected[:, 0], atol=1e-8)


def test_a_delay_of_a_context_may_be_0():
    diagram = MakePendulum()
    context = diagram.CreateDefaultContext()
    SetNumbers(diagram, context, {"delay": 0.0})
    recording = simulate(diagram, context=context, duration=1.0)
    assert recording.termination == "completed"


def test_components_have_the_names_and_units_of_a_plant():
    (loop,) = MakePage(SerialArm([0.5, 0.3])).data["controllers"]
    names = {port.removeprefix(":"): x for port, x in loop["components"].items()}
    assert names["state"] == ["joint 0_q", "joint 1_q", "joint 0_w", "joint 1_w"]
    assert names["actuation"] == names["arm_net_actuation"] == ["motor 0", "motor 1"]
    units = {port.removeprefix(":"): unit for port, (*_, unit) in loop["ports"].items()}
    assert units["arm_state"] == "rad, rad/s"
    assert units["net_actuation"] == units["actuation"] == "N m"
    assert units["generalized_acceleration"] == "rad/s^2"


@pytest.mark.slow
def test_plants_are_drawn_as_frames_and_links(look, tmp_path):
    builder = DiagramBuilder()
    plant = builder.AddSystem(SerialArm([0.5, 0.3]))
    diagram = builder.Build()
    diagram.set_name("arm")
    context = diagram.CreateDefaultContext()
    state = np.array([0.7, 0.4, 0.0, 0.0])
    plant.GetMyMutableContextFromRoot(context).SetContinuousState(state)
    WritePage(diagram, tmp_path / "arm.html", context=context, duration=2.0)
    found = look(tmp_path / "arm.html", "plants.js")
    assert found["isShown"] and found["num"] == 1 and found["axes"] == 6
    own = plant.GetMyContextFromRoot(context)
    world = [
        [0.0, 0.0, 0.0],
        *(
            plant.GetBodyByName(f"rod {i}").EvalPoseInWorld(own) @ [0, 0, -length / 2]
            for i, length in enumerate((0.5, 0.3))
        ),
    ]
    # World and joint 0, its centre, joint 1, its centre; in pixels x right, z down.
    lines = np.array(found["before"]).reshape(-1, 2, 2)
    drawn = np.array([lines[0, 1], lines[1, 1], lines[3, 1]])
    points = np.array(world)[:, [0, 2]] * [1, -1]
    shape = (drawn - drawn[0]) / np.linalg.norm(drawn[1] - drawn[0])
    expected = points / np.linalg.norm(points[1])
    np.testing.assert_allclose(shape, expected, atol=0.02)
    assert found["after"] != found["before"]


def test_the_view_shows_the_plane_in_which_joints_turn():
    plant = SerialArm([0.5])
    (picture,) = PlantPictures(plant, plant.CreateDefaultContext()).values()
    tree = picture.tree
    assert ViewOf([tree]) == [[1, 0, 0], [0, 0, 1]]
    tree = tree._replace(axes=np.array([[0.0, 0.0, 1.0]]))
    assert ViewOf([tree]) == [[1, 0, 0], [0, 1, 0]]
    tree = tree._replace(axes=np.array([[0.6, 0.0, 0.8]]))
    right, up = np.array(ViewOf([tree]))
    assert right @ up == pytest.approx(0, abs=1e-3)


URDF = """<robot name="arm"><link name="rod">
<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial>
<KIND><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.2 0.1"/></geometry></KIND>
<KIND><origin xyz="1 0 0"/><geometry><sphere radius="0.5"/></geometry></KIND>
<KIND><geometry><cylinder radius="0.5" length="2"/></geometry></KIND></link>
<joint name="turn" type="revolute"><parent link="world"/><child link="rod"/>
<axis xyz="0 1 0"/><limit effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize("kind", ["visual", "collision"])
def test_shapes_of_a_plant_have_their_extent(kind):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    Parser(plant).AddModelsFromString(URDF.replace("KIND", kind), "urdf")
    plant.Finalize()
    diagram = builder.Build()
    (picture,) = PlantPictures(diagram, diagram.CreateDefaultContext()).values()
    extents = [
        (link, np.min(points, axis=0), np.max(points, axis=0))
        for link, points in picture.shapes
    ]
    expected = [
        ([0.0, -0.1, -0.05], [0.4, 0.1, 0.05]),
        ([0.5, -0.5, -0.5], [1.5, 0.5, 0.5]),
        ([-0.5, -0.5, -1.0], [0.5, 0.5, 1.0]),
    ]
    assert [link for link, _, _ in extents] == [0, 0, 0]
    found = sorted((list(low), list(high)) for _, low, high in extents)
    np.testing.assert_allclose(found, sorted(expected), atol=0.04)


@pytest.fixture
def with_diagrams(monkeypatch):
    """Lets modules of the folder diagrams/ be imported, as if one worked there."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[3] / "diagrams"))


def test_commands_take_a_function_that_makes_a_diagram(with_diagrams, tmp_path, capsys):
    page = tmp_path / "page.html"
    options = ["--vary", "sensor.delay=0:0.6", "--duration", "3", "-o", str(page)]
    assert main(["page", "own_diagram:MakeDiagram", *options]) == 0
    html = page.read_text(encoding="utf-8")
    assert "<title>late feedback</title>" in html
    assert "Makes y&#x27; = 2 (1 - y(t - delay))." in html
    shown = [one for one in DataOf(html)["inputs"] if not one["isField"]]
    assert [(one["name"], one["max"]) for one in shown] == [("sensor.delay", 0.6)]
    capsys.readouterr()
    assert main(["diagram", "own_diagram:MakeDiagram"]) == 0
    assert "<B>TransportDelay</B>" in capsys.readouterr().out


@pytest.mark.parametrize(
    "options",
    [{"controllers": ["adaptive"]}, {"overrides": {"delay": 1}}, {"has_hand": True}],
)
def test_a_diagram_takes_no_options_of_a_scenario(options):
    with pytest.raises(ScenarioError, match="must be left out of a diagram"):
        MakePage(PendulumPlant(), duration=1.0, **options)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["own_diagram:main"], "must be a function without arguments"),
        (["own_diagram:Nothing"], "must be importable"),
        (["own_diagram:MakeDiagram", "--delay", "1"], "takes no options of a scenario"),
        (["own_diagram:MakeDiagram", "--duration", "x"], "--duration = 'x'"),
        (["own_diagram:MakeDiagram", "--duration", "-1"], "duration = -1.0: must be"),
        (["collections:Counter"], "must be a function that returns a"),
    ],
    ids=["arguments", "name", "option", "text", "negative", "no diagram"],
)
def test_what_makes_no_page_is_refused(
    with_diagrams, tmp_path, capsys, arguments, message
):
    assert main(["page", *arguments, "-o", str(tmp_path / "page.html")]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_port_without_elements_is_not_shown():
    builder = DiagramBuilder()
    builder.AddNamedSystem("state", Integrator(1))
    builder.AddNamedSystem("nothing", ConstantVectorSource([]))
    builder.ExportInput(builder.GetSubsystemByName("state").get_input_port(), "u")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.get_input_port().FixValue(context, [1.0])
    (loop,) = MakePage(diagram, context=context).data["controllers"]
    assert [*loop["signals"]] == ["state.y0"]


def test_a_diagram_without_signals_is_a_picture():
    """A plant without bodies has ports without elements only."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    plant.Finalize()
    (loop,) = MakePage(builder.Build()).data["controllers"]
    assert loop["signals"] == {}

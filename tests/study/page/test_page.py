"""The living diagram in a real browser: it opens, simulates, and answers to clicks."""

import dataclasses
import json
import math
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from foreign import leaves
from foreign.test_leaves import wired
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Gain, Integrator
from wasm_runs import RunModule
from wasm_scenarios import AssertSameMetrics

import teleop_drake
from teleop_drake import MakePage, WritePage
from teleop_drake.cli import main
from teleop_drake.loops.draw.block_diagram import WriteDiagram
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.numerics.step_polynomials import DEGREE
from teleop_drake.loops.page.model import MakeModel
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.tasks import TaskOf
from teleop_drake.model.tasks.metrics import RunMetrics, RunSentence
from teleop_drake.study.sweep import FlattenMetrics

# What one of them compiles, the others find on the disk.
pytestmark = pytest.mark.xdist_group("machine_code")

SCRIPTS = Path(__file__).parent

STIFFNESS = "environment.layers.bone.stiffness"


@pytest.fixture(scope="module")
def seen(look, tmp_path_factory):
    page = tmp_path_factory.mktemp("page") / "loop.html"
    assert WritePage("one_dof", page, vary={STIFFNESS: (50.0, 400.0)}) == []
    assert page.stat().st_size < 250_000
    text = page.read_text("utf-8")
    assert f"teleop-drake {teleop_drake.__version__}" in text
    # Before everything else in the page.
    watch = f"<body><script>{SCRIPTS.joinpath('watch.js').read_text('utf-8')}</script>"
    page.write_text(text.replace("<body>", watch, 1), "utf-8")
    return look(page, "look.js")


def test_it_opens_without_errors_or_a_network(seen):
    assert seen["errors"] == []
    assert seen["asked"] == []


def test_inputs_are_those_of_the_scenario(seen):
    # The sliders come first, then the fields of the blocks.
    sliders = ["delay", "forward_delay", "return_delay", STIFFNESS]
    assert list(seen["inputs"])[:4] == sliders
    assert seen["inputs"]["delay"]["value"] == 0.1
    assert seen["inputs"][STIFFNESS]["unit"] == "N/m"
    assert seen["wrong"][0] == "delay = 9: must be from 0 to 0.5"
    assert seen["wrong"][1].startswith("input stiff: must be one of delay,")


def AssertSame(result, kind, values, name="one_dof"):
    """Compares with the native run of a scenario.

    Both locate events on polynomials through their rows, which are not the same ones.
    """
    native = simulate(LoadScenario(name, {"controller.kind": kind, **values}))
    assert [x["name"] for x in result["events"]] == [x.name for x in native.events]
    times = [x["time"] for x in result["events"]]
    assert times == pytest.approx([x.time for x in native.events], rel=0, abs=1e-6)
    position = native.Interpolate("tool_position", np.array([0.5, 7.9, 16.1]))[:, 0]
    span = np.ptp(native["tool_position"][:, 0])
    assert result["sampled"][0] == pytest.approx(position, rel=0, abs=1e-6 * span)
    expected = FlattenMetrics(RunMetrics(native))
    missing = expected.keys() - result["metrics"] - {"diverged", "diverged_at"}
    assert {expected[name] for name in missing} <= {None}
    for name, value in result["metrics"].items():
        assert value == pytest.approx(expected[name], rel=1e-6), name
    assert result["sentence"] == RunSentence(native)


@pytest.mark.slow
def test_runs_are_those_of_simulate(seen):
    assert seen["controllers"] == ["direct_force", "adaptive_backstepping"]
    AssertSame(seen["first"], "direct_force", {})
    for kind, result in seen["second"].items():
        AssertSame(result, kind, {"delay": 0.0731, STIFFNESS: 93.7})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kinds", "operators"),
    [
        pytest.param(
            *("one_dof", ["wave_variables"], ["sine"]), marks=pytest.mark.slow
        ),
        ("network_tracking_linear", [], []),
        pytest.param(
            *("puma560_six_axes", ["damped_force"], []), marks=pytest.mark.slow
        ),
    ],
)
def test_choices_tasks_and_arms(look, tmp_path, name, kinds, operators):
    """Metrics where the command reverses, is not sent, or there is none."""
    page = tmp_path / "page.html"
    vary = {"surgeon.kind": operators} if operators else None
    WritePage(name, page, controllers=kinds or None, vary=vary)
    seen = look(page, "choose.js")
    assert len({key.partition(":")[0] for key in seen}) == len(operators) + 1
    for key, result in seen.items():
        operator, _, kind = key.partition(":")
        values = {} if operator == "null" else {"surgeon.kind": operator}
        AssertSame(result, kind, values, name)
        if "q" in result:
            joints = JointsAt(LoadScenario(name).robot.LoadPlant(), result["q"])
            np.testing.assert_allclose(result["arm"][:-1], joints, atol=1e-9)
        assert "NaN" not in result["drawn"]


def JointsAt(plant, q):
    """Returns where the joints of a plant are that move."""
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    joints = map(plant.get_joint, plant.GetJointIndices())
    return [
        joint.frame_on_parent().CalcPoseInWorld(context).translation()
        for joint in joints
        if joint.num_positions()
    ]


def test_the_picture_has_the_values_beside_it(seen):
    assert seen["hasChanged"]
    assert seen["shown"] == [x["metrics"] for x in seen["second"].values()]


def test_a_click_opens_a_box_and_another_one_adds_a_signal(seen):
    assert seen["crumbs"].startswith("Tissue, then bone")
    assert seen["crumbs"].endswith("controller")
    before, after = seen["found"]
    assert len(after) == len(before) + 1
    assert after[0].startswith("controller/")


def test_a_box_has_the_numbers_that_can_be_changed_there(seen):
    assert seen["rows"][0] == "bone stiffness [N/m]"
    assert any(row.startswith("stiffness(empty) [N/m]") for row in seen["rows"])
    assert seen["stiffness"] == 111


def test_packets_are_under_way_as_long_as_the_delay(seen):
    """Of those that are sent every 0.02 s, with 0.0731 s each way, three at 5 s."""
    assert len(seen["marks"]) == 2
    for marks in seen["marks"]:
        x = np.array([float(x) for x in re.findall(r"M([\d.]+) ", marks)]).reshape(
            2, -1
        )
        # The older one is further on its way, to the robot or back from it.
        share = 0.02 / 0.0731
        for ends, sign in zip(x, (1, -1), strict=True):
            length = sign * (ends[1] - ends[0]) / share
            assert ends == pytest.approx(ends[0] + sign * share * length * np.arange(3))
        assert x[0, 0] - share * length == pytest.approx(
            x[1, 0] + share * length - length
        )


@pytest.mark.slow
def test_names_with_html_are_text(tmp_path):
    text = "<b>x<b>"
    more = {"title": text, "story": f"1 {text}"}
    WritePage(
        "one_dof", tmp_path / "a.html", controllers=["direct_force"], overrides=more
    )
    page = (tmp_path / "a.html").read_text("utf-8")
    assert text not in page
    assert "<h1>&lt;b&gt;x" in page and ">1 &lt;b&gt;x" in page


@pytest.mark.parametrize(
    ("key", "words"),
    (("robot.model", "a number"), ("robot.nothing", "unknown key")),
)
def test_what_is_no_number_is_refused(key, words, tmp_path):
    with pytest.raises(ScenarioError, match=words):
        WritePage("one_dof", tmp_path / "a.html", vary={key: (0.0, 1.0)})


def test_a_diagram_by_hand_runs_and_a_block_that_is_not_read_is_named(tmp_path):
    with pytest.raises(UnsupportedSystem, match=r"'block0' .* assigns to self"):
        WritePage(wired(leaves.Assigns)[0], tmp_path / "a.html")
    model = MakeModel(ByHand(), SimulatorConfig(), 1.0)
    times, rows, _ = RunModule(model)
    begin, _, _ = model.Ports()["x:y0"]
    assert rows[-1, begin] == pytest.approx(math.exp(-times[-1]), rel=1e-3)


def test_python_as_it_stands_runs_in_a_page():
    diagram, context = wired(leaves.SawTooth, leaves.Pid, leaves.Filter)
    config = SimulatorConfig(integration_scheme="runge_kutta5", accuracy=1e-8)
    model = MakeModel(diagram, config, 0.5, context)
    times, rows, _ = RunModule(model)
    run = simulate(diagram, context=context, duration=0.5, simulator=config)
    assert times[-1] == run.time[-1]
    for block in ("block0", "block1", "block2"):
        begin, _, _ = model.Ports()[f"{block}:y"]
        assert rows[-1, begin] == pytest.approx(run[f"{block}.y"][-1, 0], abs=1e-9)


def test_the_runs_of_a_page_begin_at_a_context():
    diagram = ByHand()
    context = diagram.CreateDefaultContext()
    context.SetContinuousState([3.0])
    context.SetTime(0.5)
    model = MakeModel(diagram, SimulatorConfig(accuracy=1e-8), 1.0, context)
    times, rows, _ = RunModule(model)
    begin, _, _ = model.Ports()["x:y0"]
    assert times[[0, -1]].tolist() == [0.5, 1.5]
    assert rows[-1, begin] == pytest.approx(3 * math.exp(-1.0), rel=1e-6)
    with pytest.raises(ScenarioError, match=r"^context = 'given': must be left"):
        MakePage("one_dof", context=context)


def ByHand():
    """dx/dt = -x, x(0) = 1."""
    builder = DiagramBuilder()
    x = builder.AddNamedSystem("x", Integrator([1.0]))
    gain = builder.AddNamedSystem("gain", Gain(-1.0, 1))
    builder.Connect(x.get_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), x.get_input_port())
    return builder.Build()


@pytest.mark.slow
def test_the_printed_command_repeats_a_drive(look, tmp_path, monkeypatch, capsys):
    """Every metric, with sliders that were moved after the page was written."""
    monkeypatch.chdir(tmp_path)
    more = ["surgeon.contact_force=[0.02]", "controller.adaptation_rate=12"]
    options = ["--accuracy", "1e-7", *(x for one in more for x in ("--set", one))]
    page = ["drive", "one_dof", *options, "--vary", f"{STIFFNESS}=50:400"]
    assert main([*page, "--output", "drive.html", "--quiet"]) == 0
    seen = look(tmp_path / "drive.html", "repeat.js")
    Path("hand.csv").write_text(seen["csv"], "utf-8")
    program, *words = shlex.split(seen["command"])
    assert program == "teleop-drake"
    capsys.readouterr()
    assert main([*words, "--json", "-", "--quiet"]) == 0
    records = json.loads(capsys.readouterr().out)
    assert len(records) == len(seen["metrics"]) == 2
    for record, metrics in zip(records, seen["metrics"], strict=True):
        assert "collision.time" in metrics
        expected = FlattenMetrics(record["metrics"])
        known = {name: x for name, x in expected.items() if x is not None}
        assert metrics.keys() == known.keys() - {"diverged", "diverged_at"}
        for name, value in metrics.items():
            assert value == pytest.approx(known[name], rel=1e-5, abs=1e-9), name
    # The whole drive is shown.
    assert seen["shown"] == [0, 9]
    assert seen["cursor"] == 9
    assert seen["score"].startswith(
        "one_dof, direct force, forward delay 0.05 s, return delay 0.07 s, bone "
        "stiffness 111 N/m, simulator.accuracy=1.0e-07, controller.adaptation_rate=12, "
        "gentle hand; seed 0; bone after 7.48 s; largest force 0.015"
    )
    assert "--delay 0.1 --set" in seen["later"]


@pytest.mark.slow
def test_a_hand_drives_and_can_be_repeated(look, tmp_path):
    page = tmp_path / "drive.html"
    assert main(["drive", "two_dof_collision", "--output", str(page), "--quiet"]) == 0
    seen = look(page, "drive.js")

    assert seen["end"] > 0.7
    # A stick to the front commands y; what rests within a tenth commands nothing. A
    # gentle hand has half of the full speed.
    assert seen["sticks"] == [0, 0.25]
    assert 0 < max(x["strongMagnitude"] for _, x in seen["rumbles"]) <= 1
    (tmp_path / "hand.csv").write_text(seen["csv"])
    settings = [
        word.replace("hand.csv", str(tmp_path / "hand.csv"))
        for word in seen["command"].split()
        if "=" in word
    ]
    assert list(seen["ends"]) == ["direct_force", "adaptive_backstepping"]
    for kind, position in seen["ends"].items():
        kind_and_end = [f"controller.kind={kind}", f"duration={seen['end']}"]
        native = simulate(LoadScenario("two_dof_collision", settings + kind_and_end))
        moved = native["tool_position"][-1] - native["tool_position"][0]
        assert moved[0] > 0.02
        assert np.ravel(position) == pytest.approx(
            native["tool_position"][-1], rel=0, abs=1e-6
        )


@pytest.mark.slow
def test_a_run_that_ends_before_the_hand_has_its_own_metrics(look, tmp_path):
    """Of a hand that one controller follows longer than the other one."""
    page = tmp_path / "drive.html"
    options = ["two_dof_collision", "--delay", "0.4", "--output", str(page)]
    assert main(["drive", *options, "--quiet"]) == 0
    seen = look(page, "hold.js")
    (tmp_path / "hand.csv").write_text(seen["csv"])
    settings = {"surgeon.kind": "recorded", "surgeon.file": str(tmp_path / "hand.csv")}
    settings |= {"delay": 0.4, "duration": seen["end"]}
    assert "surgeon.contact_force=null" in seen["command"]
    settings["surgeon.contact_force"] = None
    first, second = seen["columns"]
    assert first["reason"] and first["end"] < seen["end"] - 0.1
    rows = {title: cells for title, *cells in seen["table"]}
    for k, column in enumerate((first, second)):
        more = {**settings, "controller.kind": column["kind"]}
        native = simulate(LoadScenario("two_dof_collision", more))
        assert column["end"] == pytest.approx(native.time[-1], rel=0, abs=1e-6)
        AssertSameMetrics(column["metrics"], native, 1e-5)
        for name, label in column["labels"].items():
            if label in rows:
                is_missing = rows[label][k] in ("\N{EN DASH}", "never")
                assert is_missing == (name not in column["metrics"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "more", "reason"),
    [
        pytest.param(
            "puma560_insertion",
            {"surgeon.velocity": [-0.1, 0.0, 0.0], "duration": 2.5},
            "joint wrist_bend leaves its range",
            marks=pytest.mark.slow,
        ),
        ("one_dof", {"delay": 0.5}, "the tool exceeds its speed limit"),
    ],
)
def test_it_ends_where_the_native_run_does(look, tmp_path, name, more, reason):
    page = tmp_path / "page.html"
    WritePage(name, page, controllers=["direct_force"], overrides=more)
    seen = look(page, "end.js")
    scenario = LoadScenario(name, {"controller.kind": "direct_force", **more})
    native = simulate(scenario)
    assert (seen["reason"], native.termination) == (reason, "diverged")
    assert seen["end"] == pytest.approx(native.time[-1], rel=0, abs=1e-9)
    AssertSameMetrics(seen["metrics"], native, 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kinds", "more"),
    [
        pytest.param(
            "two_dof_puncture",
            ["proportional_damping"],
            {"surgeon.kind": "human", "surgeon.stop_time": 0.7, "delay": 0.1}
            | {"sensor.encoder.sample_period": 0.02, "duration": 1.3},
            marks=pytest.mark.slow,
        ),
        ("two_dof_combined", ["direct_force", "wave_variables"], {}),
        pytest.param(
            "network_tracking_coupled",
            [],
            {"duration": 3.0},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_metrics_of_a_page_are_those_of_its_own_rows(look, tmp_path, name, kinds, more):
    """What the page's script measures is what Python does, to the last digits."""
    page = tmp_path / "page.html"
    WritePage(name, page, controllers=kinds or None, overrides=more)
    for seen in look(page, "rows.js"):
        kind = {"controller.kind": seen["kind"]} if kinds else {}
        scenario = LoadScenario(name, {**more, **kind})
        native = simulate(scenario)
        recording = dataclasses.replace(
            native,
            time=np.array(seen["time"]),
            steps=np.array(seen["ends"])[:, np.newaxis] + np.arange(-DEGREE, 1),
            signals={name: np.array(x) for name, x in seen["signals"].items()},
        )
        AssertSameMetrics(seen["metrics"], recording, 1e-9)
        found = [(x["name"], x["time"]) for x in seen["events"]]
        events = TaskOf(scenario).FindEvents(recording)
        assert found == [(x.name, pytest.approx(x.time, rel=1e-13)) for x in events]


@pytest.mark.slow
def test_any_diagram_is_a_page_without_a_model(look, tmp_path):
    builder = DiagramBuilder()
    builder.AddNamedSystem("own", leaves.Assigns())
    WriteDiagram(builder.Build(), tmp_path / "a.html")
    assert "own" in look(tmp_path / "a.html", "diagram.js")

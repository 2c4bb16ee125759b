"""The worked examples in diagrams/: they run, and their pictures are current."""

import ast
import contextlib
import functools
import io
import json
import re
import runpy
import sys
import warnings
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from wasm_runs import RunModule

from teleop_drake import WritePage
from teleop_drake.loops.framework.solver import DefaultSimulator
from teleop_drake.loops.page.model import MakeModel
from teleop_drake.model.blocks.robots import MakeRobot
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import RunMetrics

# A script runs once for all that is asked of it.
pytestmark = pytest.mark.xdist_group("diagrams")

DIRECTORY = Path(__file__).parent.parent / "diagrams"
SCRIPTS = sorted(DIRECTORY.glob("*.py"))

# Of those that build a loop by hand and of those with a part of one's own, one each is
# enough for the short run; the others take longer.
SLOW = ("two_dof_arm", "two_dof_discrete_delay", "own_controller", "own_device")

# How many more ports a MultibodyPlant has depends on the version of Drake.
NUM_IDLE_PORTS = re.compile(r"\d+ more")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Runs a script; tells the picture that it wrote and the lines it printed."""
    # Away from the repository, as a user's own script would be.
    directory = tmp_path_factory.mktemp("diagrams")

    @functools.cache
    def run(script: Path) -> tuple[Path, list[str]]:
        picture = directory / f"{script.stem}.svg"
        with (
            pytest.MonkeyPatch.context() as patch,
            warnings.catch_warnings(action="error"),
            contextlib.redirect_stderr(io.StringIO()) as errors,
            contextlib.redirect_stdout(io.StringIO()) as output,
        ):
            patch.chdir(directory)
            patch.setattr(sys, "argv", [str(script), picture.name])
            patch.setattr(sys, "path", [str(script.parent), *sys.path])
            runpy.run_path(str(script), run_name="__main__")
        assert errors.getvalue() == ""
        return picture, output.getvalue().splitlines()

    return run


def _Graph(picture: Path) -> Counter[tuple[str, str]]:
    """The graph a picture shows: its texts, and the boxes and lines behind them.

    Graphviz writes into the file which box or line of the DOT text each shape is. All
    of that is the diagram's; where on the page it lies is the renderer's.
    """
    root = ElementTree.parse(picture).getroot()
    return Counter(
        (kind, element.text or "")
        for kind in ("title", "text")
        for element in root.iter(f"{{http://www.w3.org/2000/svg}}{kind}")
        if not NUM_IDLE_PORTS.fullmatch(element.text or "")
    )


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    "script",
    [
        pytest.param(x, marks=pytest.mark.slow if x.stem in SLOW else (), id=x.stem)
        for x in SCRIPTS
    ],
)
def test_the_committed_picture_shows_what_the_script_builds(run, script):
    picture, _ = run(script)
    committed = _Graph(script.with_suffix(".svg"))
    assert sum(committed.values()) > 20
    assert _Graph(picture) == committed


@pytest.mark.slow
def test_the_loop_by_hand_is_the_loop_of_the_scenario(run):
    _, lines = run(DIRECTORY / "one_dof_by_hand.py")
    printed = float(re.fullmatch(r"tool velocity after 2 s: (\S+) mm/s .*", *lines)[1])
    recording = simulate(LoadScenario("one_dof", {"duration": 2.0}))
    expected = 1000 * recording.signals["tool_velocity"][-1, 0]
    assert printed == pytest.approx(expected, abs=1e-4)


@pytest.mark.slow
def test_the_arm_by_hand_is_the_arm_of_the_scenario(run):
    _, lines = run(DIRECTORY / "two_dof_arm.py")
    printed = re.fullmatch(r"tool after 1 s: x = (\S+) m, y = (\S+) m", *lines)
    recording = simulate(LoadScenario("two_dof_combined", {"duration": 1.0}))
    expected = recording.signals["tool_position"][-1]
    assert np.array(printed.groups(), dtype=float) == pytest.approx(expected, abs=1e-4)


@pytest.mark.slow
def test_the_puma_by_hand_is_the_puma_of_its_kind(run):
    _, lines = run(DIRECTORY / "puma560.py")
    along, turned = map(float, re.findall(r"\d+\.\d+", *lines))
    robot = MakeRobot(model="puma560", start=np.array([0.6, -0.15, 0.4]))
    context = robot.CreateDefaultContext()
    for name, force in (
        ("control_force", [25.0, 0, 0]),
        ("environment_force", [0] * 3),
    ):
        robot.GetInputPort(name).FixValue(context, force)
    Simulator(robot, context).AdvanceTo(0.5)
    moved = robot.GetOutputPort("tool_position").Eval(context)[0] - 0.6
    assert along == pytest.approx(1000 * moved, rel=5e-3)  # Friction is rounded there.
    assert turned < 5


@pytest.mark.slow
def test_the_own_controller_takes_the_place_of_the_other(run):
    _, lines = run(DIRECTORY / "own_controller.py")
    own, function, direct = (float(line.split()[-2]) for line in lines)
    # The thesis's value for direct force application, section 4.2.
    assert direct == pytest.approx(0.472, rel=0.02)
    assert function == pytest.approx(own, abs=0.002)
    assert own < 0.75 * direct


@pytest.mark.slow
def test_a_discrete_delay_is_its_mean_delay_and_not_its_samples(run):
    _, lines = run(DIRECTORY / "two_dof_discrete_delay.py")
    numbers = [re.findall(r"(\d+\.\d+) mm/s", line) for line in lines[1:]]
    discrete, exact, mean = np.array(numbers, dtype=float)
    assert_allclose(discrete, mean, rtol=0.03)
    assert (np.abs(discrete - exact) > 0.2 * exact).all()


@pytest.mark.slow
def test_the_loop_by_hand_is_one_run_wherever_it_runs():
    """In simulate(), in the page's module, and in a Simulator that is told enough."""
    make = runpy.run_path(str(DIRECTORY / "one_dof_by_hand.py"))["MakeOneDofByHand"]
    recording = simulate(make(), duration=1.0)
    diagram = make()
    simulator = Simulator(diagram)
    simulator.get_mutable_context().SetAccuracy(1e-10)
    config = SimulatorConfig(
        integration_scheme="runge_kutta5", accuracy=1e-9, max_step_size=0.01
    )
    ApplySimulatorConfig(config, simulator)
    simulator.AdvanceTo(1.0)
    model = MakeModel(make(), DefaultSimulator(), 1.0)
    times, rows, _ = RunModule(model)
    assert times[-1] == 1.0
    assert len(list(recording)) > 20
    for name in recording:
        expected = recording[name][-1]
        size = max(np.abs(recording[name]).max(), 1e-9)
        system, port = name.split(".")
        part = diagram.GetSubsystemByName(system)
        context = part.GetMyContextFromRoot(simulator.get_context())
        plain = part.GetOutputPort(port).Eval(context)
        begin, width, _ = model.Ports()[f"{system}:{port}"]
        page = rows[-1, begin : begin + width]
        assert_allclose(plain, expected, rtol=0, atol=1e-6 * size)
        assert_allclose(page, expected, rtol=0, atol=1e-9 * size)


def test_the_own_diagram_overshoots_by_what_the_method_of_steps_says(run):
    _, lines = run(DIRECTORY / "own_diagram.py")
    early, late = (2 * (1 - np.sqrt(x)) / 4 for x in (1.0, 0.6))  # y(t - 0.4) = 1
    peak = 1.28 + 0.4 * late - 2 * late**2 + 4 / 3 * late**3
    printed = [float(re.findall(r"\d+\.\d+", line)[-1]) for line in lines]
    assert printed[0] == early == 0
    assert printed[2] == pytest.approx(100 * (peak - 1), abs=0.005)


@pytest.mark.slow
def test_the_cart_pole_falls_on_the_other_side_of_its_margin(run):
    first, inside, outside = run(DIRECTORY / "delay_on_a_cart_pole.py")[1]
    more, margin = map(float, re.findall(r"(\S+) ms", first)[1:])
    assert margin == pytest.approx(50 + more, abs=0.01)
    for line, share, change in ((inside, 0.97, "decays"), (outside, 1.03, "grows")):
        found = re.fullmatch(r"(\S+) ms late: the push (\w+)", line)
        assert float(found[1]) == pytest.approx(share * margin, abs=0.01)
        assert found[2] == change


def test_the_own_architecture_is_the_wave_line_it_claims_to_be(run):
    _, lines = run(DIRECTORY / "own_architecture.py")
    own, direct = map(float, re.findall(r"\d+\.\d+", *lines))
    assert direct == pytest.approx(0.472, rel=0.02)
    overrides = ["controller.kind=wave_variables", "duration=9.0"]
    overrides.append("controller.wave_variables.impedance=1.0")
    metrics = RunMetrics(simulate(LoadScenario("one_dof", overrides), engine="auto"))
    expected = 1000 * metrics["puncture"]["velocity_overshoot"]
    assert own == pytest.approx(expected, abs=1e-3)


def test_the_own_channel_smooths_what_comes_back(run):
    """With much bandwidth it is the delay alone; the lag makes the overshoot larger."""
    _, lines = run(DIRECTORY / "own_channel.py")
    wide, medium, narrow = (float(re.findall(r"\d+\.\d+", x)[0]) for x in lines)
    assert wide == pytest.approx(0.472, rel=0.02)
    assert wide < medium < narrow


def test_the_own_arm_has_three_axes(run):
    _, lines = run(DIRECTORY / "own_arm.py")
    *mass, force = map(float, re.findall(r"\d+\.\d+", " ".join(lines)))
    assert len(mass) == 3
    metrics = RunMetrics(
        simulate(LoadScenario(DIRECTORY / "own_arm.yaml"), engine="auto")
    )
    expected = metrics["collision"]["initial_impact_force"]
    assert force == pytest.approx(expected, abs=1e-3)


@pytest.mark.slow
def test_the_own_device_moves_the_tool(run):
    _, lines = run(DIRECTORY / "own_device.py")
    moved, force, round_trip = map(float, re.findall(r"\d+\.\d+", *lines))
    assert 1 < moved < 10
    assert 0.01 <= force < 0.1
    assert round_trip > 0


def test_the_own_environment_is_met_where_it_is(run):
    """The tool starts 0.05 m above the floor and comes down at 0.1 m/s or so."""
    _, lines = run(DIRECTORY / "own_environment.py")
    time, force = map(float, re.findall(r"\d+\.\d+", *lines))
    assert 0.5 < time < 0.8
    assert force > 0.2


def test_the_readme_shows_every_script_and_its_picture():
    text = (DIRECTORY / "README.md").read_text()
    for script in SCRIPTS:
        assert f"]({script.name})" in text
        assert f"]({script.stem}.svg)" in text


def _Functions(path: Path) -> dict[str, Any]:
    """Returns what a script, or the first cells of a notebook, define."""
    if path.suffix == ".py":
        return runpy.run_path(str(path))
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    sources = ["".join(x["source"]) for x in cells if x["cell_type"] == "code"]
    names: dict[str, Any] = {}
    for source in sources:
        tree = ast.parse(source)
        kinds = (ast.Import, ast.ImportFrom, ast.FunctionDef)
        tree.body = [node for node in tree.body if isinstance(node, kinds)]
        exec(compile(tree, str(path), "exec"), names)
    return names


NOTEBOOK = DIRECTORY.parent / "notebooks" / "01_building_the_diagram.ipynb"


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("path", "maker", "arguments"),
    [
        pytest.param(
            DIRECTORY / "one_dof_by_hand.py",
            "MakeOneDofByHand",
            (),
            marks=pytest.mark.slow,
        ),
        (DIRECTORY / "own_diagram.py", "MakeDiagram", (0.4,)),
        pytest.param(
            DIRECTORY / "two_dof_arm.py",
            "MakeTwoDofArm",
            (LoadScenario("two_dof_combined"),),
            marks=pytest.mark.slow,
        ),
        (DIRECTORY / "delay_on_a_cart_pole.py", "MakeDiagram", ()),
        (NOTEBOOK, "MakeSmallestLoop", (0.1,)),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_a_diagram_by_hand_is_simulated_and_becomes_a_page(
    path, maker, arguments, tmp_path, monkeypatch
):
    monkeypatch.syspath_prepend(str(path.parent))
    make = _Functions(path)[maker]
    recording = simulate(make(*arguments), duration=0.2)
    assert recording.solver.engine == "compiled"
    other = simulate(make(*arguments), duration=0.2, engine="drake")
    assert set(recording) == set(other)
    for name in recording:
        assert_allclose(
            recording[name][-1], other[name][-1], rtol=1e-4, atol=1e-6, err_msg=name
        )
    WritePage(make(*arguments), tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size > 10_000

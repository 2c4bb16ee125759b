"""Every System of pydrake is drawn, and left out where nothing depends on it.

Each stands beside the loop x' = -x(t - T), whose runs and margins it must not change.
"""

import re

import numpy as np
import pytest
from drake_systems import (
    DELAY,
    NOT_MADE,
    VISUALIZERS,
    WITH_ARGUMENTS,
    AddSystem,
    FindClasses,
    FindSystems,
    MakeBeside,
)
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, PortDataType, System

from teleop_drake import LinearizePorts, WritePage
from teleop_drake.loops.draw.block_diagram import DiagramDot, RenderSvg
from teleop_drake.loops.framework.signals import IsPlant, VectorOutputs
from teleop_drake.loops.framework.solver import DefaultSimulator
from teleop_drake.loops.framework.wiring import InputPorts
from teleop_drake.loops.page.levels import Levels
from teleop_drake.loops.page.model import MakeModel
from teleop_drake.loops.run.readings import Readings
from teleop_drake.model.scenario import ScenarioError

# Systems with continuous states that depend on samples, and why they are refused.
HYBRID = {
    "CompassGait": "must be without packets",
    "with CompassGaitGeometry": "must be without packets",
    "RimlessWheel": "must be without packets",
    "with RimlessWheelGeometry": "must be without packets",
    "SchunkWsgController": "state of SchunkWsgController/.* must be finite",
    "SimIiwaDriver": "must be an equilibrium",  # It counts its samples.
}

MAKERS = {
    **{
        name: lambda builder, name=name: AddSystem(builder, name)
        for name in FindSystems()
    },
    **{f"with {name}": add for name, add in VISUALIZERS.items()},
}

each = pytest.mark.parametrize("name", MAKERS)


def test_the_tables_name_every_class_of_pydrake():
    classes = FindClasses()
    assert len(classes) > 100
    assert classes.keys() >= NOT_MADE
    assert WITH_ARGUMENTS.keys() <= classes.keys()
    assert {name for name in classes if name.endswith("Geometry")} - NOT_MADE == {
        name for name in VISUALIZERS if name.endswith("Geometry")
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", FindSystems())
def test_every_output_keeps_its_place_in_memory(name):
    """A run in Drake's Simulator copies the values from there."""
    diagram = MakeBeside(MAKERS[name])
    system = diagram.GetSubsystemByName(name)
    kinds = [port.get_data_type() for port in InputPorts(system)]
    if PortDataType.kAbstractValued in kinds and not IsPlant(system):
        pytest.skip("it cannot be evaluated with a value that means nothing")
    simulator = Simulator(diagram)
    root = simulator.get_context()
    ports = [port for port in VectorOutputs(system) if port.size()]
    readings = Readings(ports, root)
    try:
        simulator.AdvanceTo(0.01)
        readings.Read()
    except (RuntimeError, SystemExit) as error:
        pytest.skip(f"it cannot be evaluated by itself: {error}")
    for time in (0.01, 0.2, 0.35):
        simulator.AdvanceTo(time)
        found = np.frombuffer(readings.Read())
        own = system.GetMyContextFromRoot(root)
        values = [np.empty(0), *(port.Eval(own) for port in ports)]
        assert_array_equal(found, np.concatenate(values))


@pytest.mark.mostly_slow
@each
def test_every_system_has_a_box_and_its_number(name):
    """The k-th system in a diagram has the number k, which names boxes of a page."""
    diagram = MakeBeside(MAKERS[name])
    dot = DiagramDot(diagram, max_depth=1)
    lcm = r"drakelcminterface(\d+)in \[shape"
    numbers = re.findall(rf"^(?:s(\d+) \[|{lcm})", dot, re.M)
    parts = diagram.GetSystems()
    assert [int(a or b) for a, b in numbers] == list(range(1, len(parts) + 1))
    for part in parts:
        if type(part) is not System:  # Drake alone knows the class.
            assert f"<B>{type(part).__name__}</B>" in dot
    declared = set(re.findall(r"(?:^|;)(\w+) \[", dot, re.M))
    ends = re.findall(r"^([a-z]+\d+\w*)\S* -> (\w+)", dot, re.M)
    assert len(ends) >= 4
    assert {end for edge in ends for end in edge} <= declared


@pytest.mark.slow
def test_one_picture_holds_every_system():
    builder = DiagramBuilder()
    names = FindSystems()
    for name in names:
        AddSystem(builder, name)
    diagram = builder.Build()
    svg = RenderSvg(diagram, max_depth=1)
    assert {f"name={name}" for name in names} <= set(
        re.findall(r">([^<>]*)</text", svg)
    )
    (level, *_) = Levels(diagram)
    shown = re.findall(r'data-box="([^"]*)"', level["svg"].decode())
    assert {*names} <= {*shown}


@pytest.mark.mostly_slow
@each
def test_a_page_leaves_every_system_out_or_runs_it(name):
    diagram = MakeBeside(MAKERS[name])
    model = MakeModel(diagram, DefaultSimulator(), 1.0)
    evaluator = model.run.evaluator
    context = diagram.CreateDefaultContext()
    program = evaluator.program
    y, _ = evaluator.Evaluate(context)
    for _, _, delayed in program.delays:
        y[delayed] = 0.7
    _, dx = evaluator.Evaluate(context, y)
    paths = [block.path for block in evaluator.blocks]
    assert dx[program.states[paths.index("x")]] == [-0.7]
    # What is left out has no signals; all else is a part of the program.
    with_signals = {paths[i] for i, _ in program.signals}
    assert with_signals.isdisjoint(evaluator.left_out)
    if name.startswith("with "):
        assert evaluator.left_out


@pytest.mark.slow
def test_a_page_with_the_default_visualization_runs_in_a_browser(look, tmp_path):
    """The solution is 1 - (t - T) between T and 2 T, as the delay begins with 0."""
    diagram = MakeBeside(VISUALIZERS["AddDefaultVisualization"])
    notes = WritePage(diagram, tmp_path / "page.html", duration=0.35)
    assert notes[0].endswith(
        "inertia_visualizer: left out, without an effect on the signals"
    )
    (found,) = look(tmp_path / "page.html", "rows.js")
    time = np.array(found["time"])
    x = np.array(found["signals"]["x"])[:, 0]
    expected = 1.0 - np.maximum(time - DELAY, 0.0)
    assert_allclose(x, expected, atol=1e-12)
    boxes = look(tmp_path / "page.html", "ports.js")["boxes"]
    assert {"SharedPointerSystem", "inertia_visualizer"} < {*boxes}


@pytest.mark.slow  # Half a minute.
@each
def test_every_system_is_in_a_page(name, tmp_path):
    diagram = MakeBeside(MAKERS[name])
    WritePage(diagram, tmp_path / "page.html", duration=0.35)
    assert (tmp_path / "page.html").stat().st_size > 30_000


@pytest.mark.mostly_slow
@each
def test_linear_models_leave_every_system_out(name):
    diagram = MakeBeside(MAKERS[name])
    port = diagram.GetSubsystemByName("back").get_input_port()
    context = diagram.CreateDefaultContext()
    context.SetContinuousState(np.zeros(context.num_continuous_states()))
    if name in HYBRID:
        with pytest.raises(ScenarioError, match=HYBRID[name]):
            LinearizePorts(diagram, context, port, is_opened=True)
        return
    # Some of the systems do not rest, as a quadrotor that falls.
    model = LinearizePorts(diagram, context, port, is_opened=True, is_moving=True)
    frequencies = np.array([0.5, 3.0])
    expected = np.exp(-1j * DELAY * frequencies) / (1j * frequencies)
    response = model.Response(frequencies)[:, 0, 0]
    assert_allclose(response, expected, rtol=1e-13)
    assert model.by_differences == ()
    assert model.held == ()

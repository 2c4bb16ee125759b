"""Arguments of another class are refused in one line that names what is taken."""

import inspect
import math
import re

import pytest
from pydrake.systems.primitives import Gain, Integrator
from wired import Wired

import teleop_drake
from teleop_drake import DelayMargin, blocks
from teleop_drake.model.scenario import ScenarioError

# Arguments that functions require besides the first one.
REST = {
    "ChartStability": {"key": "controller.G1", "values": [1.0, 2.0]},
    "DelayMargin": {"context": None, "port": None},
    "LinearizePorts": {"context": None, "input_port": None},
    "MakeSimulator": {"config": None},
    "OperateRemotely": {"connect": "localhost:1", "key": "key"},
    "DelayMargins": {"context": None},
    "SaveFigure": {},
    "ServeRobot": {"listen": "localhost:1", "key": "key"},
    "Sweep": {"grid": {"delay": [0.1]}},
    "Tune": {"controller": "direct_force", "gains": ["G1"], "minimize": ["x"]},
    "WriteDiagram": {"path": "unused.svg"},
    "WritePage": {"path": "unused.html"},
}

# Functions that take any text or numbers, or nothing.
OTHERS = {"EstimateLatency", "ScenarioNames", "ShowTable"}

FUNCTIONS = [
    name
    for name in sorted(set(teleop_drake.__all__) - set(blocks.__all__) - OTHERS)
    if inspect.isfunction(getattr(teleop_drake, name))
]


class Something:
    """An object that no function takes."""


@pytest.mark.parametrize("name", FUNCTIONS)
def test_each_public_function_names_what_it_takes(name):
    function = getattr(teleop_drake, name)
    with pytest.raises(ScenarioError, match=r"= a Something: must be ") as error:
        function(Something(), **REST.get(name, {}))
    assert isinstance(error.value, TypeError)
    assert "\n" not in str(error.value)


def MakeLoop():
    return Wired(
        {"x": Integrator(1), "gain": Gain(-2.0, 1)}, {"gain": "x", "x": "gain"}
    )


DIAGRAM = MakeLoop()
CONTEXT = DIAGRAM.CreateDefaultContext()


def Loop(name="gain"):
    """Returns the arguments of DelayMargin() that are right."""
    return {
        "diagram": DIAGRAM,
        "context": CONTEXT,
        "port": DIAGRAM.GetSubsystemByName(name).get_input_port(),
    }


@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        (
            "AnalyzeStability",
            {"scenario": DIAGRAM},
            "scenario = a Diagram: must be a scenario, its name or file; a Diagram is "
            "simulated by .* analysed by LinearizePorts() and DelayMargin()",
        ),
        (
            "DelayMargin",
            {**Loop(), "port": "plant"},
            "port = 'plant': must be an InputPort or OutputPort in the diagram, such "
            "as diagram.GetSubsystemByName('x').get_output_port()",
        ),
        (
            "DelayMargin",
            {**Loop(), "diagram": "one_dof"},
            "diagram = 'one_dof': must be a Diagram; of a scenario, "
            "AnalyzeStability(scenario) finds the margins",
        ),
        (
            "DelayMargin",
            {**Loop(), "context": None},
            "context = null: must be one of Diagram, as "
            "diagram.CreateDefaultContext() makes it",
        ),
        (
            "simulate",
            {"scenario": DIAGRAM, "duration": 1.0, "context": 3},
            "context = 3: must be one of Diagram, as diagram.CreateDefaultContext()",
        ),
        (
            "simulate",
            {"scenario": DIAGRAM, "duration": "1 s"},
            "duration = '1 s': must be a finite number > 0 (s)",
        ),
        (
            "simulate",
            {"scenario": DIAGRAM, "duration": 1.0, "simulator": "rk3"},
            "simulator = 'rk3': must be Drake's SimulatorConfig",
        ),
        (
            "MakeSimulator",
            {"diagram": DIAGRAM, "config": None},
            "config = null: must be Drake's SimulatorConfig",
        ),
        (
            "NamedParameters",
            {"diagram": DIAGRAM, "context": 3},
            "context = 3: must be one of Diagram",
        ),
        (
            "DelayMargin",
            {**Loop(), "context": MakeLoop().CreateDefaultContext()},
            "context = 'a Context': must be one of Diagram",
        ),
        ("Sweep", {"scenario": DIAGRAM}, "grid = null: must be values by key"),
        (
            "Sweep",
            {"scenario": "one_dof"},
            'grid = null: must be values by key, as {"delay": [0.1, 0.2]}',
        ),
        (
            "WriteDiagram",
            {"system": "one_dof", "path": "unused.svg"},
            "system = 'one_dof': must be a System of Drake's, such as a Diagram; "
            "MakeDiagram(scenario) makes one",
        ),
        (
            "PlotStableDelays",
            {"analyses": 3.0},
            "analyses = 3.0: must be a StabilityAnalysis of AnalyzeStability(scenario)",
        ),
    ],
)
def test_the_message_names_the_sister(function, arguments, message):
    pattern = ".*".join(map(re.escape, message.split(".*")))
    with pytest.raises(ScenarioError, match=f"^{pattern}"):
        getattr(teleop_drake, function)(**arguments)


def test_the_right_arguments_are_taken():
    """x' = -2 x(t - T) is stable for T < pi / 4 s."""
    assert DelayMargin(**Loop()) == pytest.approx(math.pi / 4, rel=1e-9)

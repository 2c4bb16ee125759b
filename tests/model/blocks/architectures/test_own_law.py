"""Control laws of a user's own: classes of systems and plain functions."""

import re
from pathlib import Path

import numpy as np
import own_kinds
import pytest
from numpy.testing import assert_array_equal
from pydrake.autodiffutils import AutoDiffXd

from teleop_drake import MakePage
from teleop_drake.cli import main
from teleop_drake.model.blocks.architectures import ARCHITECTURE_KINDS, ARCHITECTURES
from teleop_drake.model.blocks.architectures.damped_force import DampedForce
from teleop_drake.model.blocks.architectures.own_law import FunctionLaw
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError, ScenarioToYaml
from teleop_drake.model.scenario.loading import ScenarioFromYaml
from teleop_drake.model.teleoperator import MakeTeleoperator

SHORT = {"duration": 0.5}


def Run(kind, parameters=(), engine="auto"):
    """Returns the run of one_dof with a law of one's own."""
    changes = {"controller.kind": kind, **SHORT}
    changes |= {f"controller.parameters.{x}": y for x, y in dict(parameters).items()}
    return simulate(LoadScenario("one_dof", changes), engine=engine)


def Largest(a, b, signal="tool_velocity"):
    """Returns the largest difference of a signal of two runs at common times."""
    times = np.linspace(0.01, 0.49, 97)
    return np.abs(a.Interpolate(signal, times) - b.Interpolate(signal, times)).max()


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["compiled", "drake"])
def test_a_function_is_the_block_that_computes_the_same(engine):
    own = Run("own_kinds:Damped", {"damping": 2.0}, engine)
    changes = {"controller.kind": "damped_force", **SHORT}
    section = {"damping": 2.0, "against": "command"}
    scenario = LoadScenario("one_dof", changes | {"controller.damped_force": section})
    assert own.solver.engine == engine
    assert Largest(own, simulate(scenario, engine=engine)) < 1e-9
    # The gain decides something.
    assert Largest(own, Run("own_kinds:Damped", {}, engine)) > 1e-6


@pytest.mark.slow
def test_a_class_is_named_as_it_is():
    own = Run("own_kinds:Unconverted", {"damping": 0.4})
    config = Run("own_kinds:BrakedForce", {"damping": 0.4})
    assert_array_equal(own["tool_velocity"], config["tool_velocity"])


@pytest.mark.slow
def test_a_function_in_the_place_of_a_law(subtests):
    scenario = LoadScenario("one_dof", SHORT)
    laws = {
        "function": own_kinds.Damped,
        "lambda": lambda F_h, v_d, p, v, F_e: F_h + v_d - v,
    }
    for name, law in laws.items():
        with subtests.test(name=name):
            diagram = MakeTeleoperator(scenario, control_law=law)
            own = simulate(scenario, teleoperator=diagram)
            assert Largest(own, Run("own_kinds:Damped")) < 1e-12, name


def test_its_gains_are_numeric_parameters_of_its_context():
    law = FunctionLaw(own_kinds.Damped, [0.0, 0.0], {"offset": [3.0, 4.0]})
    names = [x.name for x in law.kernel_parameters.named]
    assert names == ["damping", "offset"]
    context = law.CreateDefaultContext()
    for i, value in enumerate(([1, 1], [2, 0], [0, 0], [0, 5], [0, 0])):
        law.get_input_port(i).FixValue(context, np.array(value, dtype=float))
    context.get_mutable_numeric_parameter(0).SetAtIndex(0, 10.0)
    force = law.get_output_port().Eval(context)
    assert_array_equal(force, [1 + 20 + 3, 1 - 50 + 4])


@pytest.mark.parametrize("law", ["own", "block"])
def test_it_linearises_exactly(law):
    """Drake's derivatives of F_h + 2 (v_d - v), also of a block of the package."""
    own = FunctionLaw(own_kinds.Damped, [0.0], {"damping": 2.0})
    block = DampedForce(num_axes=1, damping=2.0, against="command")
    dual = {"own": own, "block": block}[law].ToAutoDiffXd()
    context = dual.CreateDefaultContext()
    for i in range(5):
        seed = np.array([AutoDiffXd(0.1 * i, np.eye(5)[i])])
        dual.get_input_port(i).FixValue(context, seed)
    slopes = dual.get_output_port(0).Eval(context)[0].derivatives()
    assert_array_equal(slopes, [1.0, 2.0, 0.0, -2.0, 0.0])


@pytest.mark.slow
def test_a_page_and_a_search_see_its_gains():
    changes = {"controller.kind": "own_kinds:Damped", **SHORT}
    scenario = LoadScenario("one_dof", changes)
    assert scenario.Value("controller.parameters.damping") == 1.0
    assert scenario.controller.parameters == {}
    again = ScenarioFromYaml(ScenarioToYaml(scenario))
    assert again == scenario
    page = MakePage(
        scenario,
        controllers=["own_kinds:Damped"],
        vary={"controller.parameters.damping": (0.1, 3.0)},
    )
    assert not any("damping" in note for note in page.notes)


@pytest.mark.parametrize(
    ("kind", "parameters", "message"),
    [
        ("TwoForces", {}, "control_law: force of TwoForces = [0.0, 0.0]: must be one"),
        ("TooFew", {}, "control_law = 'TooFew(F_h, v_d)': must be a function of (hap"),
        (
            "KeywordOnly",
            {},
            "control_law = 'KeywordOnly(F_h, v_d, p, v, F_e, ",
        ),
        ("Clashing", {}, "control_law = 'time': must be another name for a gain"),
        ("Odd", {}, "Odd: table = <class 'dict'>: must be a number, text, true or"),
        ("Worded", {}, "Worded: mode_name = 'x': must be a number or an array"),
        ("Demanding", {}, "controller.parameters.gain = null: must be given"),
        ("Damped", {"dampin": 1.0}, "controller.parameters.dampin = 1.0: unknown key"),
        (
            "Damped",
            {"damping": "x"},
            "controller.parameters.damping = 'x': must be",
        ),
        (
            "Unconverted",
            {"damping": -1.0},
            "controller.parameters: own_kinds:Unconverted raised ValueError: no motor",
        ),
        ("np", {}, "controller.kind = 'own_kinds:np': must be a dataclass that derive"),
    ],
)
def test_bad_input(kind, parameters, message):
    with pytest.raises(ScenarioError) as error:
        Run(f"own_kinds:{kind}", parameters)
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (
            own_kinds.Unconverted,
            "must be an instance: control_law=Unconverted(...)",
        ),
        (3, "control_law = 3: must be a system or a function"),
        (own_kinds.Demanding, "gains of Demanding = 'gain': must be given"),
    ],
    ids=["class", "number", "no_default"],
)
def test_what_is_no_law_is_refused(law, message):
    with pytest.raises(ScenarioError, match=re.escape(message)):
        MakeTeleoperator("one_dof", control_law=law)


def test_a_gain_that_it_has_not_is_refused():
    with pytest.raises(ScenarioError, match="gains of Damped = 'mass': must be one of"):
        FunctionLaw(own_kinds.Damped, [0.0], {"mass": 1.0})


def test_a_law_without_a_kernel_is_read_as_it_stands():
    recording = Run("own_kinds:Unconverted")
    assert recording.solver.engine == "compiled"
    assert any("machine code of the Python code" in note for note in recording.notes)


@pytest.mark.slow
def test_all_and_an_own_one_side_by_side(tmp_path, monkeypatch, capsys, unrendered):
    monkeypatch.chdir(tmp_path)
    rest = ["--duration", "0.1", "--out", "out", "--quiet"]
    kinds = "all,own_kinds:Damped"
    assert main(["compare", "one_dof", "--controllers", kinds, *rest]) == 0
    table = capsys.readouterr().out
    assert all(kind in table for kind in (*ARCHITECTURES, "own_kinds:Damped"))
    assert main(["run", "one_dof", "--controller", "own_kinds:Damped", *rest]) == 0
    names = [path.name for path in Path("out").iterdir()]
    assert {"one_dof_own_kinds_Damped.npz", "one_dof_own_kinds_Damped.json"} <= {*names}
    assert not [name for name in names if ":" in name]


def test_the_kind_of_a_function_is_made_once():
    kinds = [ARCHITECTURE_KINDS.Find("own_kinds:Damped", "kind") for _ in range(2)]
    assert kinds[0] is kinds[1]
    assert kinds[0].kind == "own_kinds:Damped"

"""Random input: one line that says what is wrong, or a valid scenario; never more."""

import contextlib
import functools
import io
import string
import tempfile
import warnings
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

import teleop_drake.scenario
import teleop_drake.simulation
from teleop_drake.cli import main
from teleop_drake.scenario import (
    CheckSteps,
    LoadScenario,
    ScenarioError,
    ScenarioFromYaml,
    ScenarioNames,
    ScenarioToYaml,
)

SCENARIOS = Path(teleop_drake.__file__).parent / "scenarios"


def Paths(tree, prefix=""):
    """All dotted paths of a tree, of its sections and of its values."""
    items = enumerate(tree) if isinstance(tree, list) else tree.items()
    for key, value in items:
        yield f"{prefix}{key}"
        if isinstance(value, (dict, list)):
            yield from Paths(value, f"{prefix}{key}.")


@functools.cache
def PathsOf(name):
    """All dotted paths of a scenario."""
    return list(Paths(yaml.safe_load(ScenarioToYaml(LoadScenario(name)))))


numbers = (
    st.floats()
    | st.integers()
    | st.sampled_from([0, 1, -1, 0.1, 1e-5, 1e-300, 1e300, 10**400])
)
# What UTF-8 has. By the name of the codec it takes two seconds to find.
letters = st.characters(exclude_categories=["Cs"])
text = st.text(letters, max_size=8) | st.sampled_from(
    ["auto", "up", "sampled", "slider", "direct_force", "1e-3", "nan", "0x10", "1_0"]
)
scalars = numbers | text | st.booleans() | st.none()
values = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            text | st.sampled_from(["kind", "delay", "name", "start", "lower"]),
            inner,
            max_size=3,
        )
    ),
    max_leaves=6,
)
# Most of them nearly right.
matrices = st.lists(st.lists(st.floats(-2, 5), min_size=2, max_size=2), max_size=3)
values = numbers | st.lists(st.floats(-2, 2), max_size=3) | matrices | values


@st.composite
def overrides(draw):
    """Returns the name of a scenario and one to three paths and values."""
    name = draw(st.sampled_from(ScenarioNames()))
    path = st.sampled_from(PathsOf(name))
    misspelt = st.builds(
        lambda path, i, c: path[:i] + c + path[i + 1 :],
        path,
        st.integers(0, 30),
        st.sampled_from(string.printable),
    )
    return name, draw(
        st.lists(st.tuples(path | path | misspelt, values), min_size=1, max_size=3)
    )


def AssertOneLine(error: Exception) -> None:
    assert str(error).isprintable()
    assert len(str(error)) < 1000


class Started(BaseException):
    """A simulation was. No Exception: main() would report it as one of a block."""


def RunMain(argv):
    """Returns exit code, stdout and stderr; raises Started."""

    def start(*args, **kwargs):
        raise Started

    out, err = io.StringIO(), io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        patch.setattr(teleop_drake.simulation, "simulate", start)
        exit_code = main(argv)
    return exit_code, out.getvalue(), err.getvalue()


def AssertBadInput(exit_code, out, err):
    assert exit_code == 2
    assert out == ""
    assert err.startswith("teleop-drake: error: ")
    assert err.count("\n") == 1 and err.endswith("\n")
    assert "Traceback" not in err


@given(overrides())
def test_run(case):
    name, pairs = case
    options = [
        f"{path}={yaml.safe_dump(value, default_flow_style=True)}"
        for path, value in pairs
    ]
    is_valid = False
    with warnings.catch_warnings(), contextlib.suppress(ScenarioError):
        warnings.simplefilter("error")
        scenario = LoadScenario(name, dict(pairs))
        scenario.Validate()
        assert ScenarioFromYaml(ScenarioToYaml(scenario)) == scenario
        CheckSteps(LoadScenario(name, options))
        is_valid = True
    argv = ["run", name, "--quiet", *(f"--set={option}" for option in options)]
    try:
        result = RunMain(argv)
    except Started:
        assert is_valid
    else:
        AssertBadInput(*result)
        assert not is_valid


@given(
    command=st.sampled_from(["run", "show", "compare", "diagram", "list", "swap", ""]),
    scenario=st.sampled_from(["one_dof", "two_dof_puncture", "1dof", ".", "a.yaml"]),
    options=st.dictionaries(
        st.sampled_from(
            [
                *("--delay", "--forward-delay", "--return-delay", "--duration"),
                *("--accuracy", "--controller", "--controllers", "--set", "--depth"),
                "--what",
            ]
        ),
        scalars.map(str) | st.sampled_from(["0.1", "1e-6", "direct_force", "1"]),
        max_size=3,
    ),
)
def test_options(command, scenario, options):
    argv = [command, scenario, *(f"{key}={value}" for key, value in options.items())]
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        try:
            exit_code, out, err = RunMain(argv)
        except Started:
            assert command in ("run", "compare")
            return
        if exit_code == 0:
            assert command in ("show", "diagram")
            assert out and not err
        else:
            AssertBadInput(exit_code, out, err)


@st.composite
def files(draw):
    """Returns the text of a scenario file with a few random edits."""
    name = draw(st.sampled_from(ScenarioNames()))
    lines = (SCENARIOS / f"{name}.yaml").read_text().splitlines()
    for _ in range(draw(st.integers(1, 3))):
        i = draw(st.integers(0, len(lines) - 1))
        kind = draw(st.sampled_from(["drop", "repeat", "insert", "cut", "value"]))
        if kind == "drop":
            del lines[i]
        elif kind == "repeat":
            lines.insert(draw(st.integers(0, len(lines))), lines[i])
        elif kind == "insert":
            lines.insert(i, draw(st.text(letters, max_size=20)))
        elif kind == "cut":
            lines[i] = lines[i][draw(st.integers(0, 10)) :]
        else:
            value = yaml.safe_dump(draw(values), default_flow_style=True)
            lines[i] = lines[i].partition(":")[0] + ": " + value
    return "\n".join(lines)


@given(files() | st.text(letters, max_size=60) | st.binary(max_size=60))
def test_files(content):
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        path = Path(folder) / "a.yaml"
        if isinstance(content, str):
            content = content.encode("utf-8", "surrogatepass")
        path.write_bytes(content)
        try:
            scenario = LoadScenario(path)
        except ScenarioError as error:
            AssertOneLine(error)
        else:
            scenario.Validate()

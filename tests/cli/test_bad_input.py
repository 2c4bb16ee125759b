"""Random input: one line that says what is wrong, or a valid scenario; never more."""

import contextlib
import functools
import io
import string
import sys
import tempfile
import warnings
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

import teleop_drake.loops.framework.files
import teleop_drake.model.run.simulate
import teleop_drake.model.scenario
from teleop_drake.cli import main
from teleop_drake.model.scenario import (
    CheckSteps,
    LoadScenario,
    ScenarioError,
    ScenarioFromYaml,
    ScenarioNames,
    ScenarioToYaml,
)

SCENARIOS = Path(teleop_drake.__file__).parent / "model/scenarios"


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

    out = io.StringIO()
    err = io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        patch.setattr(teleop_drake.model.run.simulate, "simulate", start)
        exit_code = main(argv)
    return exit_code, out.getvalue(), err.getvalue()


def AssertBadInput(exit_code, out, err):
    assert exit_code == 2
    assert out == ""
    assert err.startswith("teleop-drake: error: ")
    assert err.count("\n") == 1 and err.endswith("\n")
    assert "Traceback" not in err


@pytest.mark.slow
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


ONE_LINE = [
    ("robot.mass=1e308", "robot.mass = 1e+308: must be a number (0, or 1e-30 to 1e+30"),
    ("robot.mass=1e-308", "robot.mass = 1e-308: must be a number (0, or 1e-30 to 1e+"),
    (
        "forward_channel={kind: network, sample_period: 0.01, "
        "loss: {kind: burst, probability: 1, burst_length: 1e300}}",
        "forward_channel.loss.burst_length = 1e+300: must be a number (0, or 1e-30",
    ),
    (
        "forward_channel={kind: network, sample_period: 0.01, "
        "loss: {kind: burst, probability: 1, burst_length: 1e20}}",
        "forward_channel.loss.probability = 1.0: must be >= 0 and <= 1, and less than",
    ),
    (
        "surgeon.velocity=[1e308]",
        "surgeon.velocity = 1e+308: must be a list of num",
    ),
    ("surgeon.velocity=[1e30]", "surgeon.velocity = [1e+30]: must be at most 1000 m/s"),
    ("forward_channel.delay=1:30", "forward_channel.delay = '1:30': must be a number"),
    ("duration=1:30.5", "duration = '1:30.5': must be a number"),
    ("duration=1e-30", "duration = 1e-30: must be a finite number >= 1e-06 (s)"),
    ("robot.start=[-1e30]", "robot.start = [-1e+30]: must be within 1e+06 m of the"),
]


@pytest.mark.parametrize(("override", "message"), ONE_LINE)
def test_what_ended_in_a_traceback_is_one_line(override, message):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        code, out, err = RunMain(["run", "one_dof", "--quiet", f"--set={override}"])
    AssertBadInput(code, out, err)
    assert f"error: {message}" in err


@pytest.mark.parametrize("number", ["1:30", "190:20:30", "1:30.5"])
def test_base_60_is_no_number_in_a_file(number, tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text(f"duration: {number}\nrobot: {{model: slider}}\n")
    with pytest.raises(ScenarioError, match=f"duration = '{number}': must be a number"):
        LoadScenario(path)


def test_a_file_without_an_end_is_refused(monkeypatch):
    monkeypatch.setattr(teleop_drake.loops.framework.files, "_MAX_BYTES", 1000)
    for command in ("show", "check"):
        code, out, err = RunMain([command, "/dev/zero"])
        AssertBadInput(code, out, err)
        assert "must have at most 1000 bytes" in err


def test_what_cannot_be_written_is_replaced(monkeypatch):
    """The sign of `analyze` in ASCII."""
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", stream)
    assert main(["analyze", "one_dof"]) == 0
    stream.flush()
    assert b"?" in stream.buffer.getvalue()


def Numbers(tree, prefix=""):
    """The dotted paths of the numbers of a scenario, and of what may be one.

    Of a vector these are the first and the last component.
    """
    items = [*(enumerate(tree) if isinstance(tree, list) else tree.items())]
    if isinstance(tree, list) and not any(isinstance(x, (dict, list)) for x in tree):
        items = [*dict(items[:1] + items[-1:]).items()]
    for key, value in items:
        if isinstance(value, (dict, list)):
            yield from Numbers(value, f"{prefix}{key}.")
        elif value is None or type(value) in (int, float):
            yield f"{prefix}{key}"


VALUES = ("1e30", "-1e30", "1e-30", "1e300", ".inf", ".nan", "-1", "text", "[[1]]")
LIKE_OTHERS = ("haptic_device", "controller", "simulator", "actuator", "sensor")
# A scenario checks these alike for any number of axes.
WITHOUT_AXES = ("task", "duration", "forward_channel", "return_channel")
WITHOUT_AXES += ("divergence_speed_ratio", "divergence_speed")


def SectionsOf(name):
    """The sections of a scenario by their keys, kinds and the number of axes."""
    scenario = LoadScenario(name)
    tree = yaml.safe_load(ScenarioToYaml(scenario))
    sections = {}
    for key, value in tree.items():
        section = value if isinstance(value, dict) else {}
        sort = section.get("kind", section.get("model")), scenario.num_axes
        if key in LIKE_OTHERS:
            sort = type(scenario), scenario.num_axes > 1
        elif key in WITHOUT_AXES:
            sort = section.get("kind"), type(scenario)
        sections[key, *sort] = {key: value}
    return sections


def CasesOf(name):
    """Each number of a scenario with values that are huge, tiny, or of no such type.

    Those of a section that another one has, with fewer axes or by its name before this
    one, are left to that one.
    """
    names = sorted(ScenarioNames(), key=lambda x: (LoadScenario(x).num_axes, x))
    earlier = [key for x in names[: names.index(name)] for key in SectionsOf(x)]
    own = {k: x for k, x in SectionsOf(name).items() if k not in earlier}
    numbers = [path for section in own.values() for path in Numbers(section)]
    return [f"{path}={value}" for path in numbers for value in VALUES]


@pytest.mark.slow
@pytest.mark.parametrize("name", ScenarioNames())
def test_each_number_of_a_scenario(name, subtests):
    """One line or a start; no warning."""
    for override in CasesOf(name):
        with subtests.test(override=override), warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                result = RunMain(["run", name, "--quiet", f"--set={override}"])
            except Started:
                continue
            AssertBadInput(*result)

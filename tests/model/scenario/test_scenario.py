"""Tests of teleop_drake.model.scenario."""

import math
import re
from pathlib import Path

import appendix_a
import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose
from pydrake.systems.analysis import SimulatorConfig
from surfaces import Border

from teleop_drake.model import scenario as dut
from teleop_drake.model.blocks.operators import ConstantVelocityConfig
from teleop_drake.model.blocks.robots import SliderConfig
from teleop_drake.model.scenario import (
    DELAYS,
    CheckSteps,
    LoadOverridden,
    LoadScenario,
    Scenario,
    ScenarioError,
    ScenarioFromYaml,
    ScenarioNames,
    ScenarioToYaml,
    TrackingScenario,
)
from teleop_drake.model.scenario.yaml_text import DumpYaml, ParseYaml

SCENARIOS = Path(dut.__file__).parent.parent / "scenarios"
BUILT_IN = ["one_dof", "two_dof_collision", "two_dof_combined", "two_dof_puncture"]
PUMA = [f"puma560_{x}" for x in ("insertion", "needle_insertion", "wall_sliding")]
PUMA += ["puma560_six_axes"]
SPACE = ["needle_insertion", "wall_sliding", *PUMA]
LEARNING = ["two_dof_learning"]
JOINTS = ["leader_follower"]
TRACKING = ["network_tracking_coupled", "network_tracking_linear"]

MINIMAL = """
duration: 2
robot: {model: slider, start: [0.0]}
surgeon: {velocity: [0.001]}
controller: {kind: direct_force}
"""


@pytest.fixture
def minimal(tmp_path: Path) -> Path:
    path = tmp_path / "mine.yaml"
    path.write_text(MINIMAL)
    return path


def test_names():
    assert ScenarioNames() == sorted(TRACKING + BUILT_IN + SPACE + LEARNING + JOINTS)


# The thesis's table of tasks (section 2.5) and gains (sections 4.2, 5.2).


@pytest.mark.parametrize(
    "name, start, velocity, puncture, surface, contact_force",
    [
        ("one_dof", [0], [0.001], 0.0075, 0.015, [0.005]),
        ("two_dof_puncture", [0.85, 0], [0.1, 0], 1.1, None, None),
        ("two_dof_collision", [0.85, 0], [0.1, 0], None, 1.0, [0.2, 0]),
        ("two_dof_combined", [0.85, 0], [0.1, 0], 1.0, 1.1, [0.2, 0]),
    ],
)
def test_tasks(name, start, velocity, puncture, surface, contact_force):
    scenario = LoadScenario(name)
    assert scenario.name == name
    assert scenario.robot.start.tolist() == start
    assert scenario.surgeon.velocity.tolist() == velocity
    assert Border(scenario, "puncture") == puncture
    assert Border(scenario, "contact") == surface
    force = scenario.surgeon.contact_force
    assert (force if force is None else force.tolist()) == contact_force
    assert scenario.forward_channel.delay == scenario.return_channel.delay == 0.1
    layers = {layer.name: layer for layer in scenario.environment.layers}
    if "tissue" in layers:
        tissue = layers["tissue"]
        assert tissue.start == -math.inf
        assert (tissue.stiffness, tissue.damping, tissue.reference) == (0.01, 0.5, 0)
    if "bone" in layers:
        bone = layers["bone"]
        assert (bone.stiffness, bone.damping, bone.reference) == (150, 0, surface)


@pytest.mark.parametrize("name", BUILT_IN)
def test_gains(name):
    controller = LoadScenario(name).controller
    G1, G2 = (2, 20) if name == "one_dof" else (4, 30)
    assert (controller.Lambda, controller.P) == (1, 1)
    assert (controller.G1, controller.G2) == (G1, G2)
    assert (controller.adaptation_rate, controller.leakage) == (0.1, 0.1)


@pytest.mark.parametrize("name", BUILT_IN + TRACKING + SPACE + LEARNING + JOINTS)
def test_every_value_in_a_file_has_its_source(name):
    for line in (SCENARIOS / f"{name}.yaml").read_text().splitlines():
        # The line has a value, and is neither a section nor one of the texts.
        if re.match(r"\s*(- )?\w+: *[^# ]", line) and not re.match(
            "title|story|description|source", line
        ):
            comment = line.partition("#")[2]
            assert re.search(
                r"eq\. |section|chapter|assumed|fitted|without effect|surface", comment
            ), line


# Round trip.


@pytest.mark.parametrize("name", ["one_dof", "two_dof_combined", TRACKING[0]])
def test_round_trip(name, tmp_path):
    overrides = {
        "controller.Lambda": 2.5,
        "simulator.accuracy": 1e-9,
        "description": "Überprüfung:\n - two lines, 'quotes' and # more",
    }
    if name.startswith("two_dof"):
        overrides["controller.initial_psi"] = [[4.0, -1.0], [-1.0, 3.0]]
    scenario = LoadScenario(name, overrides)
    text = ScenarioToYaml(scenario)
    assert text.isascii()
    path = tmp_path / "other.yaml"
    path.write_text(text)
    loaded = LoadScenario(path)
    assert loaded == scenario
    assert loaded.name == name
    assert loaded.description == overrides["description"]
    assert ScenarioToYaml(loaded) == text
    assert ScenarioFromYaml(text) == scenario
    loaded.controller.G1 += 1
    assert loaded != scenario
    assert scenario != name


# Defaults.


def test_defaults(minimal):
    scenario = LoadScenario(minimal)
    assert scenario.name == "mine"
    assert scenario.num_axes == 1
    assert scenario.duration == 2.0 and isinstance(scenario.duration, float)
    assert scenario.haptic_device.numerator.tolist() == [25, 50]
    assert scenario.haptic_device.denominator.tolist() == [1, 25, 0]
    for channel in (scenario.forward_channel, scenario.return_channel):
        assert channel.kind == "transport"
        assert channel.delay == 0.1
    assert scenario.environment.layers == []
    assert Border(scenario, "contact") is None
    assert Border(scenario, "puncture") is None
    assert scenario.divergence_speed_ratio == 5
    assert scenario.simulator.integration_scheme == "runge_kutta5"
    # A change of a loaded scenario must not change the defaults.
    scenario.haptic_device.numerator[0] = 7
    scenario.simulator.accuracy = 1
    again = LoadScenario(minimal)
    assert again.haptic_device.numerator[0] == 25
    assert again.simulator.accuracy == 1e-8


def test_a_bare_number_is_a_vector_with_one_entry(minimal):
    scenario = LoadScenario(minimal, ["robot.start=-2", "surgeon.velocity=2e-3"])
    assert scenario.robot.start.tolist() == [-2]
    assert scenario.surgeon.velocity.tolist() == [0.002]


@pytest.mark.parametrize(
    ("key", "path"),
    [
        ("duration", "duration"),
        ("robot", "robot.model"),
        ("surgeon", "surgeon.velocity"),
        ("controller", "controller.kind"),
    ],
)
def test_missing(key, path, tmp_path):
    tree = yaml.safe_load(MINIMAL)
    del tree[key]
    file = tmp_path / "a.yaml"
    file.write_text(yaml.safe_dump(tree))
    with pytest.raises(ScenarioError, match=rf"^{path} = null: must be "):
        LoadScenario(file)


# Overrides.


def test_delay_is_that_of_both_channels(tmp_path):
    file = tmp_path / "a.yaml"
    own = "forward_channel: {kind: sampled, sample_period: 0.01}"
    file.write_text(f"{MINIMAL}delay: 0.07\n{own}\n")
    for scenario in (
        LoadScenario("one_dof", {"delay": 0.07}),
        LoadScenario("one_dof", ["return_channel.delay=0.2", "delay=0.07"]),
        LoadScenario(file),
    ):
        assert scenario.forward_channel.delay == scenario.return_channel.delay == 0.07
    assert LoadScenario(file).forward_channel.kind == "sampled"
    _, paths = LoadOverridden("one_dof", ["delay=0", "duration=1"])
    assert paths == [*DELAYS, "duration"]
    file.write_text(MINIMAL + "delay: 0.07\nreturn_channel: {delay: 0.1}\n")
    with pytest.raises(ScenarioError, match=r"delay = 0.07: must be left out, or the"):
        LoadScenario(file)
    with pytest.raises(ScenarioError, match="forward_channel"):
        LoadScenario("network_tracking_linear", {"delay": 0.1})


def test_overrides():
    text = LoadScenario(
        "two_dof_combined",
        [
            "environment.layers.bone.stiffness=300",
            "environment.layers.0.damping=1",
            "surgeon.velocity.0=2e-1",
            "controller.Lambda=[[2, 0.5], [0.5, 2]]",
            "controller.initial_psi=4",
            "haptic_device.numerator.1=60",
            "robot.elbow=up",
            "surgeon.contact_force=null",
            "simulator.use_error_control=false",
            "controller.network.count.1=7",
            "duration=1",
            "duration=3",
        ],
    )
    mapping = LoadScenario(
        "two_dof_combined",
        {
            "environment.layers.bone.stiffness": np.float64(300),
            "environment.layers.tissue.damping": np.int64(1),
            "surgeon.velocity": (0.2, 0.0),
            "controller.Lambda": np.array([[2, 0.5], [0.5, 2]]),
            "controller.initial_psi": 4,
            "haptic_device.numerator": [25, 60],
            "robot.elbow": "up",
            "surgeon.contact_force": None,
            "simulator.use_error_control": False,
            "controller.network.count": [5, 7],
            "duration": 3.0,
        },
    )
    assert text == mapping
    tissue, _, bone = text.environment.layers
    assert (tissue.damping, bone.stiffness, text.duration) == (1, 300, 3)
    assert text.surgeon.velocity.tolist() == [0.2, 0]
    assert text.controller.Lambda.tolist() == [[2, 0.5], [0.5, 2]]
    assert (text.controller.initial_psi, text.surgeon.contact_force) == (4, None)
    assert text.controller.network.count == [5, 7]
    assert text.simulator.use_error_control is False


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *(("1e-2", 0.01), ("+1e3", 1000.0), ("1E0", 1.0), ("1.5e3", 1500.0)),
        *((".5", 0.5), ("-.5", -0.5), ("+.5e1", 5.0), ("1.e2", 100.0)),
        *(("1_000", 1000), ("1_0e3", 1e4), ("0x10", 16), ("1e-400", 0.0)),
        *(("1e3x", "1e3x"), ("e3", "e3"), ("1e", "1e"), ("-", "-"), (".e3", ".e3")),
        *(("'1e-2'", "1e-2"), ("!!str 1e-2", "1e-2"), ("1e-2.5", "1e-2.5")),
    ],
)
def test_numbers_as_people_write_them(text, value):
    """Numbers such as 1e-2, 1.5e3 and -.5, which YAML 1.1 reads as text."""
    tree = ParseYaml(f"[{text}]", "it")
    assert tree == [value] and type(tree[0]) is type(value)
    assert ParseYaml(DumpYaml(tree), "it") == tree


def test_the_step_is_the_one_that_was_given():
    """The delay limits the steps of the Simulator, not the field of the scenario."""
    # One string is one override.
    scenario = LoadScenario("one_dof", "simulator.max_step_size=0.3")
    scenario.forward_channel.delay = 0.001
    scenario.Validate()
    assert scenario.simulator.max_step_size == 0.3


@pytest.mark.parametrize(
    ("overrides", "field"),
    [
        (["duration=1e6"], "simulator.max_step_size"),
        (["forward_channel.delay=1e-6"], "forward_channel.delay"),
        (["forward_channel={kind: variable, delay: 2e-5, drift: 1e-6}"],
         "forward_channel.delay"),
        (["return_channel={kind: network, delay: 0.1, sample_period: 1e-6}"],
         "return_channel.sample_period"),
    ],
)  # fmt: skip
def test_number_of_steps(overrides, field):
    with pytest.raises(ScenarioError, match=rf"^duration = .* with {field} = ") as info:
        CheckSteps(LoadScenario("one_dof", overrides))
    assert "\n" not in str(info.value)
    CheckSteps(LoadScenario("one_dof", {"simulator.max_step_size": 5e-5}))


# Derived numbers.


def test_initial_psi():
    assert LoadScenario("one_dof").initial_psi.tolist() == [[4.3]]
    # (1 + Lambda d_e)/m, with Lambda = 2, d_e = 0.5, m = 0.5 in the tissue ...
    auto = ["controller.initial_psi=auto", "controller.Lambda=2"]
    assert LoadScenario("one_dof", auto).initial_psi == pytest.approx(4)
    # ... and 1/m in free space.
    auto.append("robot.start=[0.01]")
    assert LoadScenario("one_dof", auto).initial_psi == pytest.approx(2)
    # It is also 1/m in front of all layers.
    auto[-1] = "environment.layers.tissue.start=0.005"
    assert LoadScenario("one_dof", auto).initial_psi == pytest.approx(2)


@pytest.mark.parametrize(
    ("overrides", "smallest", "written"),
    [
        # (1 + Lambda d_e)/m with Lambda = 1, d_e = 0.5 and m = 20 kg.
        ({"robot.mass": 20.0}, "0.075", 0.04),
        ({"controller.initial_psi": 0.02}, "0.02", 0.01),
    ],
)
def test_a_small_initial_psi_names_the_bound_to_write(overrides, smallest, written):
    given = {"controller.initial_psi": "auto", **overrides}
    message = (
        rf"controller\.initial_psi = .*, with the smallest singular value {smallest} "
        r"1/kg: must be larger than controller\.minimum_psi = 0\.1; "
        rf"write minimum_psi: {written}$"
    )
    with pytest.raises(ScenarioError, match=message):
        LoadScenario("one_dof", given)
    given["controller.minimum_psi"] = written
    assert LoadScenario("one_dof", given).initial_psi[0, 0] > written


@pytest.mark.parametrize("value", [0.0, -1.0, [[1.0, 2.0], [2.0, 1.0]]])
def test_an_initial_psi_has_a_positive_determinant(value):
    law = {"controller.kind": "adaptive_backstepping"}
    with pytest.raises(ScenarioError, match="2 x 2 matrix with positive determinant"):
        LoadScenario("two_dof_collision", {**law, "controller.initial_psi": value})


def test_initial_psi_of_the_arm():
    collision = LoadScenario("two_dof_collision")
    q = collision.robot.JointPositions(collision.robot.start)
    J = appendix_a.J(q)
    expected = J @ np.linalg.inv(appendix_a.M(q)) @ J.T
    assert_allclose(collision.initial_psi, expected, rtol=1e-3)
    # In tissue the damping acts along x only.
    combined = LoadScenario("two_dof_combined")
    assert_allclose(combined.initial_psi, np.diag([1.5, 1.0]) @ expected, rtol=1e-3)


def Layers(*layers: tuple[float, float]) -> dict:
    return {
        "environment.layers": [
            {"name": f"layer_{i}", "start": start, "stiffness": stiffness}
            for i, (start, stiffness) in enumerate(layers)
        ]
    }


@pytest.mark.parametrize(
    ("layers", "surface", "puncture"),
    [
        ([], None, None),
        ([(-math.inf, 5)], None, None),
        # The empty space in front of the first layer has no stiffness.
        ([(1, 5)], 1, None),
        ([(1, 5), (2, 0)], 1, 2),
        # A tool that starts inside the first layer has no surface in front of it.
        ([(-1, 5), (1, 0)], None, 1),
        ([(-math.inf, 1), (1, 5), (2, 3), (3, 4)], 1, 2),
    ],
)
def test_surface_and_puncture(layers, surface, puncture):
    scenario = LoadScenario("one_dof", Layers(*layers))
    assert Border(scenario, "contact") == surface
    assert Border(scenario, "puncture") == puncture


# Invalid values, each with the beginning of the one-line message.

BAD_ONE_DOF = [
    ("return_channel.delay=", "return_channel.delay = null: must be a number"),
    ("return_channel.kind=transprot", "return_channel.kind = 'transprot': must be one"),
    ("robot.model=robot", "robot.model = 'robot': must be one of slider, two_link_arm"),
    ("robot.start=[0.015]", "robot.start = [0.015]: must be in front of the contact"),
    ("robot.elbow=up", "robot.elbow = 'up': must be null for the slider robot"),
    ("surgeon.velocity=[0]", "surgeon.velocity = [0.0]: must be non-zero"),
    ("surgeon.stop_time=-1", "surgeon.stop_time = -1.0: must be a finite number >= 0"),
    ("haptic_device.numerator=[1, 2, 3, 4]", "haptic_device.numerator = [1.0, 2.0, 3"),
    ("haptic_device.denominator=[0, 1]", "haptic_device.denominator = [0.0, 1.0]"),
    ("environment.layers.bone.name=free", "environment.layers.2.name = 'free': must b"),
    ("environment.layers.1={name: x}", "environment.layers.x.start = null: must be"),
    ("environment.layers=1", "environment.layers = 1: must be a list"),
    ("environment=1", "environment = 1: must be a mapping with the keys kind"),
    (
        "controller.Lambda=0",
        "controller.Lambda = 0.0: must be positive, or a symmetric",
    ),
    ("controller.network.lower=", "controller.network.lower = null: must be a list"),
    ("controller.G2=auto", "controller.G2 = 'auto': must be a number or a matrix"),
    ("controller.minimum_psi=5", "controller.initial_psi = 4.3, with the smallest si"),
    ("divergence_speed_ratio=1", "divergence_speed_ratio = 1.0: must be a finite num"),
    ("simulator.integration_scheme=ode45", "simulator.integration_scheme = 'ode45': "),
    ("simulator.use_error_control=1", "simulator.use_error_control = 1: must be true"),
    ("simulator.start_time=1", "simulator.start_time = 1.0: must be 0 s"),
    ("simulator.publish_every_time_step=true", "simulator.publish_every_time_step = "),
    ("name=../escape", "name = '../escape': must be one line of text without / and"),
    ("description=3", "description = 3: must be text"),
    ("forward_chanel.delay=1", "forward_chanel.delay = 1: unknown key 'forward_chanel"),
    ("duration.x=1", "duration.x = 1: unknown key 'x', there is nothing below"),
    ("duration=2020-13-01", "override of 'duration': must be valid YAML (month"),
    ("duration=!!python/name:os.system x", "override of 'duration' at line 1"),
    ('description="\\ud800"', "override of 'description' at line 1"),
]


def AssertRefused(message, name, overrides):
    with pytest.raises(ScenarioError) as info:
        LoadScenario(name, overrides)
    assert str(info.value).startswith(message)
    assert str(info.value).isprintable()


@pytest.mark.parametrize(
    ("override", "message"),
    BAD_ONE_DOF,
)
def test_bad_values(override, message):
    AssertRefused(message, "one_dof", [override])


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["robot.mass=1"], "robot.mass = 1.0: must be null for the two_link_arm robot"),
        (["controller.G1=[[1, 2], [0, 1]]"], "controller.G1 = [[1.0, 2.0], [0.0, 1.0]"),
        (["controller.P=[[1, 0], [0]]"], "controller.P = [[1, 0], [0]]: must be a num"),
        (["controller.minimum_psi=3"], "controller.initial_psi = 'auto', with the sm"),
        # Types are checked before values.
        (["duration=-1", "environment.layers=x"], "environment.layers = 'x': must be"),
    ],
)
def test_bad_values_of_the_arm(overrides, message):
    AssertRefused(message, "two_dof_combined", overrides)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("controller.kind=direct_force", "controller.kind = 'direct_force': must be o"),
        ("controller.G2=20", "controller.G2 = 20: unknown key 'G2', must be one of"),
        ("robot={model: slider, start: [0]}", "robot.model = 'slider': must be one of"),
        ("gravity=9.81", "gravity = [9.81]: must be a list of 2 finite numbers"),
        ("trajectory=null", "trajectory = null: must be a mapping with the keys"),
        ("trajectory.centre=[1]", "trajectory.centre = [1.0]: must be a list of 2"),
        # Both ends are in reach, but the shoulder in between is not.
        (
            "trajectory={centre: [0.1, 0], amplitude: [0.9, 0]}",
            "trajectory.amplitude = [0.9, 0.0]: must keep the trajectory in reach ([0",
        ),
        ("disturbance.kind=cubic", "disturbance.kind = 'cubic': must be one of"),
        ("disturbance.gain=.inf", "disturbance.gain = inf: must be a finite number or"),
        ("divergence_speed=0", "divergence_speed = 0.0: must be a finite number > 0 ("),
    ],
)
def test_bad_values_of_tracking(override, message):
    AssertRefused(message, "network_tracking_linear", [override])


def test_tracking_scenario():
    scenario = LoadScenario(
        "network_tracking_linear", ["disturbance.gain=[[1, 2], [3, 4]]"]
    )
    assert isinstance(scenario, TrackingScenario)
    assert scenario.num_axes == 2
    assert scenario.disturbance.gain.tolist() == [[1, 2], [3, 4]]
    # Section 3.4.
    controller = scenario.controller
    assert (controller.Lambda, controller.G1) == (35, 1)
    assert (controller.adaptation_rate, controller.leakage) == (5, 0.001)
    assert LoadScenario("network_tracking_coupled").disturbance.gain == 10
    # No delay limits the step.
    step = LoadScenario("network_tracking_linear", ["simulator.max_step_size=2"])
    assert step.simulator.max_step_size == 2
    # A trajectory of a single point is allowed.
    LoadScenario("network_tracking_linear", ["trajectory.amplitude=[0, 0]"])
    scenario.trajectory.amplitude = [2, 0]
    with pytest.raises(ScenarioError, match=r"^trajectory.amplitude = \[2.0, 0.0\]"):
        scenario.Validate()


@pytest.mark.parametrize(
    ("override", "suggestion"),
    [
        ("controller.kind=adaptive_backsteping", "adaptive_backstepping"),
        ("forward_channel.dealy=1", "delay"),
        ("environment.layers.bonee.start=1", "bone"),
        ("controller={kinds: direct_force}", "kind"),
    ],
)
def test_suggestions(override, suggestion):
    with pytest.raises(ScenarioError, match=rf"\(did you mean '{suggestion}'\?\)"):
        LoadScenario("one_dof", [override])


# Bad files.


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "must hold a mapping of scenario fields, not null"),
        (b"[1, 2]", r"must hold a mapping of scenario fields, not \[1, 2\]"),
        (b"robot: [}", "at line 1, column 9: must be valid YAML"),
        (b"a: 1\nduration: 1\nduration: 2", r"column 1: .*duplicate key 'duration'"),
        (b"\xff\xfe\x00", r"must be readable \(not UTF-8 text\)"),
        (b"[" * 101, "must be valid YAML .nested more than 100 deep"),
        (b"? {a: b}\n: 1", "must be valid YAML"),
        (b"1: 2", "^1 = 2: unknown key 1, must be one of name"),
        (b"robot: 1", "^robot = 1: must be a mapping"),
        (b"simulator: {accuracy: high}", "^simulator.accuracy = 'high': must be a num"),
    ],
)
def test_bad_files(text, message, tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_bytes(text)
    with pytest.raises(ScenarioError, match=message) as info:
        LoadScenario(path)
    assert str(info.value).isprintable()
    if not message.startswith("^"):
        assert str(info.value).startswith(f"scenario file {str(path)!r}")


def test_local_file_without_extension(minimal, monkeypatch):
    monkeypatch.chdir(minimal.parent)
    minimal.rename("task")
    assert LoadScenario("task").name == "task"


# Scenarios edited in Python.


def test_validate_takes_lists_and_numpy():
    scenario = LoadScenario("two_dof_combined")
    scenario.surgeon.velocity = [0.2, 0]
    scenario.robot.start = (0.9, 0.0)
    scenario.controller.G1 = np.diag([4.0, 5.0])
    scenario.controller.network.count = np.array([3, 4])
    scenario.duration = 1
    scenario.Validate()
    assert scenario.num_axes == 2
    assert Border(scenario, "contact") == 1.1


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ({"duration": "long"}, "duration = 'long': must be a number"),
        ({"simulator": SimulatorConfig(accuracy=-1)}, "simulator.accuracy = -1.0"),
        (
            {"surgeon": ConstantVelocityConfig(velocity=[math.nan, 0])},
            "surgeon.velocity",
        ),
    ],
)
def test_validate(edit, message):
    scenario = LoadScenario("two_dof_combined")
    for key, value in edit.items():
        setattr(scenario, key, value)
    with pytest.raises(ScenarioError) as info:
        scenario.Validate()
    assert str(info.value).startswith(message)


def test_scenario_made_in_python(minimal):
    scenario = Scenario(
        name="mine",
        duration=2,
        robot=SliderConfig(start=[0]),
        surgeon=ConstantVelocityConfig(velocity=[0.001]),
        controller=dut.ControllerConfig(kind="direct_force"),
    )
    scenario.Validate()
    assert scenario == LoadScenario(minimal)


def test_what_an_override_leaves_out_of_a_mapping_can_be_set_too():
    overrides = ["forward_channel={delay: 0.2}", "forward_channel.seed=3"]
    channel = dut.LoadScenario("one_dof", overrides).forward_channel
    assert (channel.delay, channel.seed) == (0.2, 3)
    with pytest.raises(dut.ScenarioError, match="unknown key 'sed'"):
        dut.LoadScenario("one_dof", [overrides[0], "forward_channel.sed=3"])

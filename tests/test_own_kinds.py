"""Kinds of a user's own, by name: in run, compare, sweep, analyze and diagram."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import own_kinds
import pytest
import yaml
from grids import Slow
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.cli import main
from teleop_drake.model.blocks.operators import ConstantVelocityOperator
from teleop_drake.model.blocks.systems.haptic_device import HapticDevice
from teleop_drake.model.channels import ChannelConfig
from teleop_drake.model.channels.kinds import CHANNEL_KINDS
from teleop_drake.model.kinds import KindConfig, KindTable
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError, ScenarioToYaml
from teleop_drake.model.scenario.loading import ScenarioFromYaml
from teleop_drake.model.teleoperator import MakeTeleoperator

DIAGRAMS = Path(__file__).parent.parent / "diagrams"
CHANNEL = "return_channel={kind: own_channel:BandLimitedChannel, bandwidth: 50}"
LAW = ["controller.kind=own_kinds:BrakedForce", "controller.parameters.damping=0.4"]
ROBOT = ["robot={model: own_kinds:PuckConfig, start: [0], mass: 0.8}"]
OPERATOR = "surgeon.kind=own_kinds:FadingConfig"
SHORT = "duration=0.1"


@pytest.fixture(autouse=True)
def _Path(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(DIAGRAMS))
    monkeypatch.chdir(tmp_path)


def Run(capsys, *args):
    assert main([*args, "--quiet"]) == 0
    return capsys.readouterr().out


def Options(*overrides):
    return [x for override in overrides for x in ("--set", override)]


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    "own",
    Slow([[CHANNEL, *LAW], [CHANNEL], LAW, [*ROBOT, *LAW], [OPERATOR]], but=[1, 2, 4]),
    ids=str,
)
def test_commands(own, capsys):
    options = Options(*own, SHORT)
    summary = json.loads(Run(capsys, "run", "one_dof", *options, "--json", "-"))
    assert summary["metrics"]["diverged"] is False
    recording = simulate(LoadScenario("one_dof", [*own, SHORT]))
    expected = recording["tool_velocity"][-1].tolist()
    assert summary["final"]["velocity"] == expected
    said = Run(capsys, "analyze", "one_dof", *options)
    assert ("the low-pass counts as a delay of 0.02 s" in said) == (CHANNEL in own)
    diagram = ["diagram", "one_dof", *options, "-o", "loop.dot", "--depth", "3"]
    assert main(diagram) == 0
    assert ("low_pass" in Path("loop.dot").read_text()) == (CHANNEL in own)


def test_show_and_list_run_nothing_of_a_scenario(tmp_path, capsys):
    Path("mailed.py").write_text("open('ran', 'w').close()")
    Path("mine.yaml").write_text("duration: 1.0\nforward_channel: {kind: 'mailed:X'}\n")
    Path("link.yaml").write_text("kind: mailed:X")
    assert main(["show", "one_dof", "--set", "task=mailed:X"]) == 0
    assert "task = mailed:X" in capsys.readouterr().err
    for options in (["--delay", "0.1"], ["--channel", "link.yaml"]):
        assert main(["show", "mine.yaml", *options]) == 0
        out, err = capsys.readouterr()
        assert yaml.safe_load(out)["forward_channel"]["kind"] == "mailed:X"
        assert "forward_channel.kind = mailed:X" in err
    assert main(["show", "one_dof", "--channel", "mailed:X"]) == 0
    assert main(["list"]) == 0
    assert not Path("ran").exists()
    assert main(["run", "mine.yaml"]) == 2
    assert Path("ran").exists()


@pytest.mark.slow
@pytest.mark.xdist_group("sweep")  # In a process of its own.
def test_compare_and_sweep(capsys, unrendered):
    table = Run(
        capsys,
        "compare",
        "one_dof",
        *Options(CHANNEL, "controller.parameters.damping=0.4", SHORT),
        "--controllers",
        "direct_force,own_kinds:BrakedForce",
    )
    assert "own_kinds:BrakedForce" in table
    Run(
        capsys,
        *("sweep", "one_dof", *Options(CHANNEL, SHORT), "--delay", "0.05,0.1"),
        *("--engine", "drake"),
        *("--vary", "controller.parameters.damping=0.1,0.4"),
        *("--controllers", "own_kinds:BrakedForce", "--out", "out", "--jobs", "1"),
    )
    rows = [
        json.loads(line) for line in Path("out/runs.jsonl").read_text().splitlines()
    ]
    assert len([row for row in rows if row.get("metrics")]) == 4


def test_a_scenario_keeps_it():
    scenario = LoadScenario("one_dof", [CHANNEL, *LAW])
    again = ScenarioFromYaml(ScenarioToYaml(scenario))
    assert again == scenario
    assert again.return_channel.bandwidth == 50
    assert again.return_channel.kind == "own_channel:BandLimitedChannel"
    # Given together, too.
    law = {"controller.kind": "own_kinds:BrakedForce"}
    law["controller.parameters"] = {"damping": 0.4}
    scenario = LoadScenario("one_dof", law)
    assert ScenarioFromYaml(ScenarioToYaml(scenario)) == scenario


@pytest.mark.slow
def test_a_robot_without_a_plant(capsys, in_this_process, unrendered):
    """It works wherever nothing derives from its inertia, which it does not tell."""
    direct = Options(*ROBOT, "controller.kind=direct_force", SHORT)
    recording = simulate(LoadScenario("one_dof", direct[1::2]), engine="drake")
    slider = "robot={model: slider, start: [0], mass: 0.8, damping: 0}"
    scenario = LoadScenario("one_dof", [slider, *direct[3::2]])
    expected = simulate(scenario, engine="drake")
    assert_allclose(recording["tool_position"], expected["tool_position"], atol=1e-9)
    Run(
        capsys,
        *("sweep", "one_dof", *direct, "--delay", "0.05,0.1"),
        "--jobs",
        "1",
        "--engine",
        "drake",
    )
    options = [*direct, "--set", "controller.initial_psi=1"]
    assert "wave" in Run(
        capsys, "compare", "one_dof", *options, "--controllers", "wave_variables"
    )
    smith = "controller.kind=smith_predictor"
    with pytest.raises(ScenarioError, match="robot does not report its inertia"):
        MakeTeleoperator(LoadScenario("one_dof", [*ROBOT, smith]))


@pytest.mark.slow
def test_systems_in_the_operators_hand():
    """Who and what the scenario has, made by oneself, gives the scenario's run."""
    scenario = LoadScenario("one_dof", ["controller.kind=direct_force", SHORT])
    device = scenario.haptic_device
    own = MakeTeleoperator(
        scenario,
        operator=ConstantVelocityOperator(velocity=scenario.surgeon.velocity),
        haptic_device=HapticDevice(
            numerator=device.numerator, denominator=device.denominator, num_axes=1
        ),
    )
    mine = simulate(scenario, teleoperator=own)
    expected = simulate(scenario)
    assert_array_equal(mine["tool_velocity"], expected["tool_velocity"])
    assert mine.has_constant_command
    # One that does not tell what it commands is measured by what arrives.
    fading = own_kinds.Fading(np.array(scenario.surgeon.velocity))
    other = MakeTeleoperator(scenario, operator=fading)
    assert not simulate(scenario, teleoperator=other).has_constant_command


def test_systems_in_place_of_the_channels():
    """An exact delay of one's own is the one of the scenario."""
    scenario = LoadScenario("one_dof", [SHORT])
    channel = scenario.forward_channel
    own = MakeTeleoperator(
        scenario,
        forward_channel=channel.MakeChannel(size=2, initial_value=[0, 0]),
        return_channel=channel.MakeChannel(size=2, initial_value=[0, 0]),
    )
    expected = simulate(scenario)["tool_velocity"]
    assert_array_equal(simulate(scenario, teleoperator=own)["tool_velocity"], expected)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "return_channel.kind=no_module:X",
            "return_channel.kind = 'no_module:X': must",
        ),
        (
            "return_channel.kind=own_kinds:BrakedForce",
            "return_channel.kind = 'own_kinds:BrakedForce': must be a dataclass that "
            "derives from teleop_drake.model.channels.base.ChannelConfig",
        ),
        (
            "return_channel={kind: own_channel:BandLimitedChannel, bandwidht: 50}",
            "return_channel.bandwidht = 50: unknown key 'bandwidht', must be one of",
        ),
        ("controller.kind=own_kinds:X", "controller.kind = 'own_kinds:X': must be imp"),
        (
            "controller={kind: own_kinds:BrakedForce, parameters: {damping: -1}}",
            "controller.parameters.damping = -1.0: must be a finite number >= 0",
        ),
    ],
)
def test_bad_input(override, message):
    with pytest.raises(ScenarioError) as error:
        LoadScenario("one_dof", [override])
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


def test_an_unknown_kind_falls_nowhere():
    """A kind that is in no table has no other one's meaning."""

    @dataclass(kw_only=True, eq=False)
    class Unlisted(ChannelConfig):
        kind = "unlisted"

        def MakeChannel(self, **_):
            raise AssertionError

    assert "unlisted" not in CHANNEL_KINDS.names
    with pytest.raises(ScenarioError, match="kind = 'unlisted': must be one of"):
        LoadScenario("one_dof", ["forward_channel.kind=unlisted"])


def test_entry_points(monkeypatch):
    class Entry:
        value = "own_channel:BandLimitedChannel"

    def EntryPoints(*, group, name):
        assert group == "teleop_drake.kinds"
        return [Entry] if name == "band_limited" else []

    monkeypatch.setattr("importlib.metadata.entry_points", EntryPoints)
    scenario = LoadScenario("one_dof", ["return_channel={kind: band_limited}"])
    assert scenario.return_channel.kind == "own_channel:BandLimitedChannel"


def test_kinds_are_named_by_their_place():
    class Base(KindConfig):
        pass

    class Own(Base):
        pass

    table = KindTable(Base, [Own], noun="thing")
    assert table.names == (f"{__name__}:{Own.__qualname__}",)
    assert own_kinds.BrakedForce.kind == "own_kinds:BrakedForce"

"""The command that repeats a drive by hand."""

import shlex
from pathlib import Path

import pytest
import yaml

from teleop_drake.cli import main
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.scenario.tree import ToTree
from teleop_drake.study.page.hand import HandData

DELAYS = ["delay", "forward_delay", "return_delay"]
SINE = {"surgeon.kind": "sine", "surgeon.frequency": 3.0}
NETWORK = "{kind: network, delay: 0.2, sample_period: 0.01}"


@pytest.fixture
def shown(tmp_path, monkeypatch, capsys):
    """Returns a function that returns the scenario of a command."""
    monkeypatch.chdir(tmp_path)
    Path("hand.csv").write_text("time,v_x,v_y\n0,0,0\n1,0.1,0\n", "utf-8")

    def Show(command):
        program, _, name, _, _, *words = shlex.split(command)
        assert program == "teleop-drake"
        assert main(["show", name, *words]) == 0
        return yaml.safe_load(capsys.readouterr().out)

    return Show


@pytest.mark.mostly_slow
@pytest.mark.parametrize("is_named", [True, False], ids=["name", "scenario"])
@pytest.mark.parametrize(
    "overrides",
    [
        {},
        {"delay": 0.3, "duration": 2.0, "controller": "wave_variables"},
        {"environment.layers.bone.stiffness": 321.0, "simulator.accuracy": 1e-6},
        {**SINE, "surgeon.velocity": [0.07, 0.0], "robot.start": [0.4, 0.2]},
        ["surgeon.stop_time=3", "surgeon.contact_force=[0.1, 0.1]"],
        [f"channel={NETWORK}", "forward_channel.seed=4"],
    ],
    ids=["none", "replaced", "numbers", "operator", "hold", "channels"],
)
def test_it_has_every_setting_but_the_operator(shown, overrides, is_named):
    name = "two_dof_collision"
    scenario = LoadScenario(name, overrides)
    source = name if is_named else scenario
    data = HandData(scenario, source, overrides, ["direct_force"], DELAYS)
    if not is_named:
        Path(f"{name}.yaml").write_text(data["yaml"], "utf-8")
    command = f"{data['command']} {data['options']['delay']}0.25 --duration 7"
    found = shown(f"{command} {data['surgeon']}")
    expected = ToTree(scenario) | {"duration": 7.0}
    for channel in ("forward_channel", "return_channel"):
        expected[channel]["delay"] = 0.25
    expected["surgeon"] = {
        **{"kind": "recorded", "file": "hand.csv", "contact_force": None},
        **{"stop_time": None, "velocity": list(scenario.surgeon.velocity)},
    }
    for section in expected:
        if section not in ("controller", "title", "story"):
            assert found[section] == expected[section], section
    for key, value in expected["controller"].items():
        assert found["controller"][key] == value or key == "kind"


def test_a_file_is_named_as_it_was_given(tmp_path):
    path = tmp_path / "a b.yaml"
    scenario = LoadScenario("one_dof")
    data = HandData(scenario, path, (), ["direct_force"], DELAYS)
    assert shlex.split(data["command"])[2] == str(path)
    assert data["options"]["forward_delay"] == "--forward-delay "

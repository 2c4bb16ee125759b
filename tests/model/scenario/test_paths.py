"""Messages for unknown paths and wrong types: one line, with the correct form."""

import pytest

from teleop_drake import Explore, LayeredForceField, LoadScenario, PlotRun, simulate
from teleop_drake.loops.framework.validation import ScenarioError


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ({"delai": 0.1}, "(did you mean 'delay'?)"),
        (
            {"bone.stiffness": 1.0},
            "bone.stiffness = 1.0: must be the full path, "
            "environment.layers.bone.stiffness",
        ),
        ({"mass": 1.0}, "mass = 1.0: must be the full path, robot.mass"),
        ({"damping": 1.0}, "environment.layers.free.damping, ..."),
    ],
)
def test_a_path_that_is_not_there(override, message):
    with pytest.raises(ScenarioError) as error:
        LoadScenario("one_dof", override)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_one_number_is_no_range_of_a_page():
    with pytest.raises(ScenarioError, match=r"delay = 0\.1: must be values to vary it"):
        Explore("one_dof", delay=0.1)


@pytest.mark.slow
def test_one_text_is_no_list_of_signals():
    recording = simulate(LoadScenario("one_dof", {"duration": 0.1}))
    message = r"signals = 'tool_velocity': must be a list of names: \['tool_velocity'\]"
    with pytest.raises(ScenarioError, match=message):
        PlotRun(recording, signals="tool_velocity")
    with pytest.raises(ScenarioError, match=message):
        Explore("one_dof", signals="tool_velocity")


def test_a_dict_is_no_layer():
    message = r"layers\.0 = .*: must be a LayerConfig\(name=\.\.\., start=\.\.\.\)"
    with pytest.raises(ScenarioError, match=message):
        LayeredForceField([{"name": "a", "start": 0.0}], 1)

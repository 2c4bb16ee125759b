"""Tests of teleop_drake.figures.explore."""

import sys

import pytest

from teleop_drake import Explore, ScenarioError

SHORT = {"duration": 0.2, "simulator.accuracy": 1e-4}
STIFFNESS = "environment.layers.bone.stiffness"


def Make(**ranges):
    return Explore(
        "one_dof",
        SHORT,
        controllers=["direct_force"],
        signals=["tool_velocity"],
        engine="drake",
        **ranges,
    )


def test_a_slider_that_is_turned_shows_other_runs():
    explorer = Make(delay=(0, 0.5, 0.05), **{STIFFNESS: [50, 100, 400]})
    assert explorer.values == {"delay": 0.1, STIFFNESS: 100.0}
    slider = explorer.sliders["delay"]
    assert slider.value == 0.1 and len(slider.options) == 11
    assert not slider.continuous_update  # With machine code it would be so.
    assert explorer.sliders[STIFFNESS].description == "bone stiffness [N/m]"
    first = explorer.picture.value
    slider.value = 0.05
    assert explorer.picture.value != first
    (run,) = explorer.Runs().values()
    channels = run.scenario.forward_channel, run.scenario.return_channel
    assert [channel.delay for channel in channels] == [0.05, 0.05]
    assert explorer.Runs()["direct force"] is run  # It is not simulated again.
    slider.value = 0.1
    assert explorer.picture.value == first
    assert explorer.status.value.startswith("simulated and drawn in ")
    assert explorer.picture.alt.startswith("2 panels: velocity")


def test_without_ipywidgets_there_is_a_still_picture(monkeypatch):
    import IPython.display

    shown = []
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    monkeypatch.setattr(IPython.display, "display", shown.append)
    explorer = Make(delay=(0, 0.5))
    assert explorer.sliders == {} and explorer.picture is None
    explorer._ipython_display_()
    (image,) = shown
    assert image.data.startswith(b"\x89PNG")


def test_a_value_that_is_refused_is_told():
    # Neither end is refused.
    explorer = Make(**{"surgeon.velocity.0": (-0.002, 0.002, 0.001)})
    first = explorer.picture.value
    explorer.sliders["surgeon.velocity.0"].value = 0.0
    assert explorer.picture.value == first
    assert "surgeon.velocity = [0.0]: must be non-zero" in explorer.status.value


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({}, "ranges = {}: must be one number"),
        ({"delay": (0.5, 0.1)}, "delay = .*: must be .least, largest"),
        ({"delay": (0.1, 0.5, 1.0)}, "the step > 0 and within the range"),
        ({"delay": 0.5}, "delay = 0.5: must be .least, largest"),
        ({"delay": []}, "must be .least"),
        ({"delay": (-0.1, 0.5)}, "forward_channel.delay = -0.1: must be"),
        ({"surgeon.speed": (0, 1)}, "unknown key 'speed'"),
        ({"controller.kind": (0, 1)}, "must be a number in the scenario"),
    ],
)
def test_bad_ranges_are_refused_at_once(ranges, message):
    with pytest.raises(ScenarioError, match=message):
        Make(**ranges)


def test_a_task_with_one_controller_has_its_own_figure():
    explorer = Explore(
        "network_tracking_linear", SHORT, **{"controller.leakage": (0.0, 1.0)}
    )
    assert "disturbance y [N]" in explorer.picture.alt
    assert explorer.values == {"controller.leakage": 0.0}  # The nearest to 0.001.
    assert explorer.sliders["controller.leakage"].continuous_update  # Machine code.

"""The page that plays recorded runs."""

import json
import re
from dataclasses import replace

import pytest
from pydrake.geometry import Meshcat
from scene_recordings import MakeRecording

from teleop_drake.model.scenario import LoadScenario
from teleop_drake.study.figures.scene import MakeReplay


def Panel(replay):
    return re.findall(r'<div id="panel" [^>]*>(.*)</div>', replay.html)[0]


@pytest.fixture(scope="module")
def replay():
    return MakeReplay({"</script>": MakeRecording(), "adaptive": MakeRecording()})


def test_the_page_says_what_is_seen(replay):
    panel = Panel(replay)
    assert "adaptive</b> (0.1 s forward, 0.2 s back)" in panel
    marks = re.findall(r"</span> ([^<]*)", panel)
    assert marks[1] == "ghost: the robot as the operator feels it"
    assert marks[3:] == ["tissue", "free", "bone"]
    (text,) = re.findall(r"<script>const replay = (.*);</script>", replay.html)
    data = json.loads(text)
    assert data["slow"][0] == pytest.approx([0.95, 1.35])


def test_a_tracking_has_no_ghost():
    recording = replace(
        MakeRecording("two_dof_combined"),
        scenario=LoadScenario("network_tracking_linear"),
        surfaces=(),
        termination="interrupted",
    )
    del recording.signals["return_packet_received"]
    meshcat = Meshcat(0)
    lines = Panel(MakeReplay(recording, meshcat)).split("<br>")
    assert [re.sub("<[^>]*>", "", line) for line in lines] == [
        *("network_tracking_linear", "network tracking (interrupted at 2 s)"),
        *("■ the robot", "➔ force on the tool"),
    ]
    assert meshcat.HasPath("/teleop/run_0/robot/tip")
    assert not meshcat.HasPath("/teleop/run_0/ghost")


def test_the_page_stands_alone(replay):
    """It asks no network for anything, and no name in it can end its script."""
    page = re.sub(r"<script.*?</script>", "", replay.html, flags=re.DOTALL)
    assert "http" not in page
    assert re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=", replay.html) == []
    assert ">&lt;/script&gt;</b>" in replay.html


def test_a_notebook_shows_it():
    replay = MakeReplay(MakeRecording(kind="adaptive_backstepping"))
    assert replay._repr_html_().startswith("<iframe srcdoc=")
    assert ">adaptive backstepping</b>" in replay.html
    assert repr(replay).startswith("<Replay of one_dof, 2")


def test_what_does_not_fit_into_one_scene():
    with pytest.raises(ValueError, match="must be one or more"):
        MakeReplay({})
    arm = MakeRecording("two_dof_combined")
    with pytest.raises(ValueError, match=r"num_axes = \[1, 2\]: must be the same"):
        MakeReplay({"slider": MakeRecording(), "arm": arm})

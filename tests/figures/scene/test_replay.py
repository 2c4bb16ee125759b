"""Recorded runs as an animation, and the page that plays them."""

import json
import re

import numpy as np
import pytest
from pydrake.geometry import Meshcat
from scene_recordings import RETURN_DELAY, SPEED, MakeRecording

from teleop_drake.figures.scene import MakeReplay
from teleop_drake.figures.scene.pen import AnimationPen, NeededFrames
from teleop_drake.figures.scene.replay import AnimateRuns, PictureTimes
from teleop_drake.figures.scene.stage import SCENE
from teleop_drake.figures.style import COLORS


def PageData(replay):
    (text,) = re.findall(r"<script>const replay = (.*);</script>", replay.html)
    return json.loads(text)


@pytest.fixture(scope="module")
def pair():
    return {
        "direct </script> force": MakeRecording(),
        "adaptive": MakeRecording(kind="adaptive_backstepping"),
    }


@pytest.fixture(scope="module")
def replay(pair):
    return MakeReplay(pair)


def test_there_may_be_more_runs_than_colours():
    run = MakeRecording(duration=1.1)
    runs = {f"law {i}": run for i in range(len(COLORS) + 1)}
    data = PageData(MakeReplay(runs))
    colors = [run["color"] for run in data["runs"]]
    assert colors == [*COLORS, COLORS[0]]


def test_what_is_left_out_is_told_by_the_rest():
    frames = np.arange(0, 1000, 10)
    x = np.where(frames < 500, 0.0, 1.0) + np.sin(frames / 100)
    values = np.stack([x, 2 * x], axis=1)
    needed = NeededFrames(frames, values)
    told = np.interp(frames, frames[needed], values[needed, 1])
    assert np.abs(told - values[:, 1]).max() <= 5e-4 * np.ptp(values[:, 1])
    assert len(needed) < 90
    # A line needs its ends, and so does what stands still.
    assert NeededFrames(frames, frames[:, None] * 3.0) == [0, 99]
    assert NeededFrames(frames, np.ones((100, 3))) == [0, 99]


def test_pictures_are_dense_where_something_happens():
    times = PictureTimes([MakeRecording()])
    assert times[0] == 0.0 and times[-1] == 2.0
    steps = np.diff(times)
    assert steps.max() < 0.035
    assert np.diff(times[(times > 0.95) & (times < 1.25)]).max() < 0.008


@pytest.fixture(scope="module")
def tracks(pair):
    """What the animation is made of."""
    pens = []
    with pytest.MonkeyPatch.context() as patch:
        make = AnimationPen.MakeAnimation
        patch.setattr(
            AnimationPen, "MakeAnimation", lambda pen: pens.append(pen) or make(pen)
        )
        AnimateRuns(pair, Meshcat(0))
    (pen,) = pens
    return pen._tracks


def test_the_ghost_is_late(tracks):
    """In the animation, the ghost is where the tool was a return delay before."""
    for run in (0, 1):
        for name, delay in (("robot/tip", 0.0), ("hand", RETURN_DELAY)):
            track = tracks[f"{SCENE}/run_{run}/{name}", "position"]
            frames = np.array(sorted(track))
            x = np.array([track[frame][0] for frame in frames])
            expected = SPEED * np.maximum(frames / 1000 - delay, 0.0)
            np.testing.assert_allclose(x, expected, atol=1e-6)
        # The ghost's carriage is the hand's, not the robot's.
        ghost = tracks[f"{SCENE}/run_{run}/ghost/carriage", "pose"]
        assert ghost[1500][0] == pytest.approx(1.3e-3, abs=1e-6)


def test_packets_take_as_long_as_the_channel(tracks):
    """A dot rises from the tool to the hand in one delay, at the x where it left."""
    track = tracks[f"{SCENE}/run_0/return/0", "position"]
    first, second = sorted(track)[:2]
    assert (first, second) == (0, 200)
    assert track[first][0] == track[second][0] == 0.0
    assert track[second][2] > track[first][2]
    shown = tracks[f"{SCENE}/run_0/return/0", "visible"]
    assert shown[0] and not shown[200]


def test_the_page_says_what_the_delay_does(replay):
    data = PageData(replay)
    assert data["subtitle"] == "0.1 s delay forward, 0.2 s back"
    assert [run["name"] for run in data["runs"]][1] == "adaptive"
    assert data["end"] == 2.0
    assert data["slow"][0] == pytest.approx([0.95, 1.35])
    assert {label["text"] for label in data["labels"]} >= {"bone", "free", "tissue"}


def test_a_task_without_contact_is_seen_to_its_end():
    """The tool goes on behind the puncture, which is all that stops the other tasks."""
    recording = MakeRecording("two_dof_puncture")
    recording.signals["tool_position"] = np.linspace([0.85, 0.0], [1.3, 0.0], 101)
    _, stage = AnimateRuns({"run": recording}, Meshcat(0))
    ends = stage.centre[0] + np.array([-0.5, 0.5]) * stage.width
    assert ends[0] < 0.85 and 1.3 < ends[1] < 1.6
    # Onto bone it is seen only as far as there is something to see.
    recording = MakeRecording("two_dof_combined")
    recording.signals["tool_position"] = np.linspace([0.85, 0.0], [1.8, 0.0], 101)
    _, stage = AnimateRuns({"run": recording}, Meshcat(0))
    assert stage.centre[0] + 0.5 * stage.width < 1.4


def test_the_page_stands_alone(replay, tmp_path):
    """It asks no network for anything, and no name in it can end its script."""
    page = re.sub(r"<script.*?</script>", "", replay.html, flags=re.DOTALL)
    assert "http" not in page
    assert re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=", replay.html) == []
    assert "direct <\\/script> force" in replay.html
    path = tmp_path / "scene.html"
    replay.Save(path)
    assert path.read_text(encoding="utf-8") == replay.html
    assert list(tmp_path.iterdir()) == [path]


def test_a_notebook_shows_it(pair):
    replay = pair["adaptive"].Animate()
    assert replay._repr_html_().startswith("<iframe srcdoc=")
    assert PageData(replay)["runs"][0]["name"] == "adaptive backstepping"
    assert repr(replay).startswith("<Replay of one_dof, 2")


def test_what_does_not_fit_into_one_scene(pair):
    with pytest.raises(ValueError, match="must be one or more"):
        MakeReplay({})
    arm = MakeRecording("two_dof_combined")
    with pytest.raises(ValueError, match=r"num_axes = \[1, 2\]: must be the same"):
        MakeReplay({**pair, "arm": arm})

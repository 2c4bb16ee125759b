"""The page of a replay in a real browser: it opens, objects are there, they move."""

import base64
import importlib.util
import io
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scene_recordings import MakeRecording

from teleop_drake.figures.scene import MakeReplay

# The page is opened once for all that is asked of it.
pytestmark = pytest.mark.xdist_group("browser")

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
BROWSER = next(filter(None, map(shutil.which, NAMES)), None)

# Before everything else in the page: time goes by frame, as the test says, and it is
# known when all objects have arrived.
CLOCK = """
<script>
const errors = [], frames = [], fetched = [];
window.addEventListener("error", (e) => errors.push(e.message));
window.requestAnimationFrame = (f) => frames.push(f);
function pump(now) { for (const f of frames.splice(0)) f(now); }
const fetch_ = window.fetch;
window.fetch = (...x) => { fetched.push(fetch_(...x)); return fetched.at(-1); };
</script>
"""

ARRIVED = """
Promise.all(fetched).then(() => new Promise((done) => setTimeout(done, 200)))
  .then(() => { pump(0); return document.getElementById("clock").textContent; })
"""

# Looks at the page from inside.
LOOK = """
(() => {
  const node = (path) => viewer.scene_tree.find(path.split("/"));
  const children = (path) => Object.keys(node(path).children);
  const run = "teleop/scale/world/run_0", scrub = document.getElementById("time");
  const go = (t) => { scrub.value = t; scrub.oninput(); };
  const views = [0.1, 1.9].map((t) => {
    go(t);
    return {
      tip: node(run + "/robot/tip").object.position.x,
      hand: node(run + "/hand").object.position.x,
      picture: viewer.capture_image(160, 100),
    };
  });
  const play = document.getElementById("play");
  document.getElementById("speed").value = 0.5;
  let now = 0;
  const advances = [0.1, 1.0].map((t) => {
    go(t);
    pump(now);
    play.click();
    for (let i = 0; i < 10; ++i) pump((now += 20));
    play.click();
    return Number(scrub.value) - t;
  });
  const requests = performance.getEntriesByType("resource").map((x) => x.name);
  return {
    errors, views, advances,
    runs: children("teleop/scale/world"),
    parts: children(run),
    slabs: children(run + "/environment"),
    requests: requests.filter((x) => !x.startsWith("data:")),
  };
})()
"""


def MakePictures():
    """The script that makes the pictures of the README, whose browser this is."""
    if BROWSER is None:
        pytest.skip("no browser: `apt-get install chromium` brings one")
    script = Path(__file__).parents[3] / "diagrams/scene/make_pictures.py"
    spec = importlib.util.spec_from_file_location("make_pictures", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    module = MakePictures()
    replay = MakeReplay({"first": MakeRecording()})
    page = tmp_path_factory.mktemp("page") / "scene.html"
    text = replay.html.replace("<body>", "<body>" + CLOCK, 1)
    page.write_text(text, encoding="utf-8")
    browser = module.Browser(page, (500, 200))
    try:
        assert browser.Evaluate(ARRIVED) == "0.000 s"
        return browser.Evaluate(LOOK)
    finally:
        browser.Close()


def test_it_opens_without_errors_or_a_network(seen):
    assert seen["errors"] == []
    assert seen["requests"] == []


def test_the_objects_are_there(seen):
    assert seen["runs"] == ["run_0"]
    assert set(seen["parts"]) >= {
        *("robot", "ghost", "hand", "tool_force", "hand_force", "command"),
        *("beads", "forward", "return", "environment"),
    }
    assert set(seen["slabs"]) == {"tissue", "puncture", "contact"}


def test_scrubbing_moves_robot_and_ghost(seen):
    """At 1 mm/s, felt 0.2 s later."""
    first, second = seen["views"]
    assert (first["tip"], first["hand"]) == pytest.approx((1e-4, 0.0), abs=2e-6)
    assert (second["tip"], second["hand"]) == pytest.approx((1.9e-3, 1.7e-3), abs=2e-6)


def test_it_plays_at_a_speed_and_slower_around_a_contact(seen):
    """0.2 s at half the speed; at the contact ten times slower."""
    assert seen["advances"] == pytest.approx([0.1, 0.01], abs=1e-3)


def test_pictures_differ_between_two_times(seen):
    first, second = (
        np.asarray(
            Image.open(io.BytesIO(base64.b64decode(x["picture"].partition(",")[2])))
        )
        for x in seen["views"]
    )
    assert first.shape == second.shape
    # Neither is empty: there are many colours.
    for picture in (first, second):
        assert len(np.unique(picture.reshape(-1, picture.shape[2]), axis=0)) > 100
    changed = np.any(first != second, axis=2).mean()
    assert 0.005 < changed < 0.9


@pytest.mark.slow
def test_the_pictures_of_the_readme_can_be_made(tmp_path, monkeypatch):
    """By their script, here of a run that needs no simulation."""
    module = MakePictures()
    monkeypatch.setattr(module, "NUM_FRAMES", 2)
    monkeypatch.setattr(
        module,
        "simulate",
        lambda scenario: MakeRecording(kind=scenario.controller.kind, duration=4.0),
    )
    module.main(tmp_path)
    assert Image.open(tmp_path / "page.png").size == module.PAGE_SIZE
    assert Image.open(tmp_path / "scene.png").size == (1280, 720)
    moving = Image.open(tmp_path / "scene.webp")
    assert (moving.n_frames, moving.size) == (2, (960, 540))
    first = np.asarray(moving.convert("RGB"))
    moving.seek(1)
    assert (first != np.asarray(moving.convert("RGB"))).any()

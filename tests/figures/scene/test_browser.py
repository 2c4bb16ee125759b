"""The page of a replay in a real browser: it opens, objects are there, they move."""

import base64
import importlib.util
import io
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scene_recordings import MakeRecording

from teleop_drake.figures.scene import MakeReplay

BROWSER = next(
    filter(
        None,
        map(
            shutil.which,
            ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable"),
        ),
    ),
    None,
)

# Software graphics, because test machines have no others.
OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-dev-shm-usage", "--no-first-run"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--window-size=760,360", "--virtual-time-budget=2000"),
)

# Looks at the page from inside and writes down what it sees.
WITNESS = """
<script>
const seen = {errors: [], pictures: [], x: []};
window.addEventListener("error", (e) => seen.errors.push(e.message));
function node(path) { return viewer.scene_tree.find(path.split("/")); }
function children(path) { return Object.keys(node(path).children); }
function look(t) {
  const scrub = document.getElementById("time");
  scrub.value = t;
  scrub.oninput();
  const x = {};
  for (const name of ["robot/tip", "hand"]) {
    x[name] = node("teleop/scale/world/run_0/" + name).object.position.x;
  }
  seen.x.push(x);
  seen.pictures.push(viewer.capture_image(320, 200));
  seen.lag = document.querySelector(".lag").textContent;
}
const wait = setInterval(() => {
  if (!document.getElementById("clock")?.textContent) return;
  clearInterval(wait);
  seen.runs = children("teleop/scale/world");
  seen.parts = children("teleop/scale/world/run_0");
  seen.slabs = children("teleop/scale/world/run_0/environment");
  look(0.1);
  look(1.9);
  seen.requests = performance.getEntriesByType("resource").map((x) => x.name)
    .filter((x) => !x.startsWith("data:"));
  const e = document.createElement("pre");
  e.id = "seen";
  e.textContent = JSON.stringify(seen);
  document.body.appendChild(e);
}, 50);
</script>
"""


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    if BROWSER is None:
        pytest.skip("no browser: `apt-get install chromium` brings one")
    replay = MakeReplay({"first": MakeRecording()})
    folder = tmp_path_factory.mktemp("page")
    page = folder / "scene.html"
    # Before the player, so that it hears of its errors.
    page.write_text(replay.html.replace("<body>", "<body>" + WITNESS, 1))
    result = subprocess.run(
        [BROWSER, *OPTIONS, f"--user-data-dir={folder}", "--dump-dom", page.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    found = re.search(r'<pre id="seen">(.*?)</pre>', result.stdout, re.DOTALL)
    assert found, result.stderr[-2000:]
    return json.loads(found[1].replace("&amp;", "&").replace("&gt;", ">"))


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
    first, second = seen["x"]
    assert first == pytest.approx({"robot/tip": 1e-4, "hand": 0.0}, abs=2e-6)
    assert second == pytest.approx({"robot/tip": 1.9e-3, "hand": 1.7e-3}, abs=2e-6)
    assert seen["lag"] == "felt 0.20 mm behind where the tool is"


def test_pictures_differ_between_two_times(seen):
    first, second = (
        np.asarray(Image.open(io.BytesIO(base64.b64decode(x.partition(",")[2]))))
        for x in seen["pictures"]
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
    if BROWSER is None:
        pytest.skip("no browser: `apt-get install chromium` brings one")
    script = Path(__file__).parents[3] / "diagrams/scene/make_pictures.py"
    spec = importlib.util.spec_from_file_location("make_pictures", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "NUM_FRAMES", 2)
    monkeypatch.setattr(
        module,
        "simulate",
        lambda scenario: MakeRecording(kind=scenario.controller.kind, duration=4.0),
    )
    module.main(tmp_path)
    assert Image.open(tmp_path / "scene.png").size == (1280, 720)
    moving = Image.open(tmp_path / "scene.webp")
    assert (moving.n_frames, moving.size) == (2, (960, 540))
    first = np.asarray(moving.convert("RGB"))
    moving.seek(1)
    assert (first != np.asarray(moving.convert("RGB"))).any()

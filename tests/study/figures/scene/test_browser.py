"""The page of a replay in a real browser: it opens, objects are there, they move."""

import numpy as np
import pytest
from browsers import MakePictures
from numpy.testing import assert_allclose
from PIL import Image
from scene_recordings import MakeRecording

from teleop_drake.study.figures.scene import MakeReplay

# The page is opened once for all that is asked of it.
pytestmark = pytest.mark.xdist_group("browser")

# Before everything else in the page: frames are drawn when the test says, and it is
# known when all objects have arrived.
CLOCK = """<body><script>
const errors = [], frames = [], fetched = [];
window.addEventListener("error", (e) => errors.push(e.message));
window.requestAnimationFrame = (f) => frames.push(f);
function pump(now) { for (const f of frames.splice(0)) f(now); }
const fetch_ = window.fetch;
window.fetch = (...x) => { fetched.push(fetch_(...x)); return fetched.at(-1); };
</script>"""

# Looks at the page from inside.
LOOK = """
(async () => {
  await Promise.all(fetched);
  await new Promise((done) => setTimeout(done, 200));
  pump(0);
  const node = (path) => viewer.scene_tree.find(["teleop", ...path.split("/")]);
  const go = (t) => {
    viewer.animator.pause();
    viewer.animator.seek(t);
    viewer.animator.display_progress(t);
    pump(0);
  };
  const x = (t) => (go(t), ["robot", "ghost"].map(
    (name) => node(`run_0/${name}/tip`).object.position.x));
  const pictures = [0.1, 1.9].map((t) => (go(t), viewer.capture_image(160, 100)));
  const paces = [0.1, 1.0, 1.9].map((t) => (go(t), viewer.animator.mixer.timeScale));
  return {
    errors, paces, tips: [x(0.1), x(1.9)], title: document.title,
    is_moving: pictures[0] != pictures[1],
    parts: Object.keys(node("run_0").children),
    slabs: Object.keys(node("run_0/environment").children),
    requests: performance.getEntriesByType("resource").map((x) => x.name)
      .filter((name) => !name.startsWith("data:")),
  };
})()
"""


@pytest.mark.slow
def test_the_page_shows_a_run_and_plays_it(tmp_path):
    text = MakeReplay({"first": MakeRecording()}).html
    page = tmp_path / "scene.html"
    page.write_text(text.replace("<body>", CLOCK, 1), encoding="utf-8")
    browser = MakePictures().Browser(page, (500, 200))
    try:
        seen = browser.Evaluate(LOOK)
    finally:
        browser.Close()
    assert seen["errors"] == seen["requests"] == []
    assert seen["title"] == "one_dof"
    assert set(seen["parts"]) >= {"robot", "ghost", "environment"}
    assert set(seen["slabs"]) == {"tissue", "puncture", "contact"}
    # At 1 mm/s, felt 0.2 s later.
    tips = np.ravel(seen["tips"])
    assert_allclose(tips, [1e-4, 0.0, 1.9e-3, 1.7e-3], atol=2e-6)
    assert seen["is_moving"]
    # At the contact ten times slower.
    assert seen["paces"] == pytest.approx([1.0, 0.1, 1.0])


@pytest.mark.slow
def test_the_pictures_of_the_readme_can_be_made(tmp_path, monkeypatch):
    """By their script, here of a run that needs no simulation."""
    module = MakePictures()
    monkeypatch.setattr(module, "NUM_FRAMES", 2)
    monkeypatch.setattr(module, "simulate", lambda _: MakeRecording(duration=4.0))
    module.main(tmp_path)
    names = "page.png", "scene.png", "scene.webp"
    sizes = []
    for name in names:
        with Image.open(tmp_path / name) as picture:
            sizes.append(picture.size)
    page = tuple(module.PAGE_SCALE * x for x in module.PAGE_SIZE)
    assert sizes == [page, module.SIZE, module.ANIMATED_SIZE]

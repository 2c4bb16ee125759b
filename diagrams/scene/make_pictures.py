"""Makes the pictures of the living diagram and of the scene.

    python diagrams/scene/make_pictures.py [FOLDER]

simulates case III with both controllers, makes the pages of `teleop-drake page` and
`replay`, opens them in a headless Chromium and takes their pictures: `page.png`; a
still of the scene, `scene.png`; and an animation of the contact, `scene.webp`. They are
written into the folder of this script by default. Chromium (`apt-get install chromium`)
is necessary; it draws without a graphics card.
"""

import base64
import io
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from teleop_drake import WritePage
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.study.figures.scene import MakeReplay

SCENARIO = "two_dof_combined"
CONTROLLERS = ("direct_force", "adaptive_backstepping")

STILL = 2.6  # s: one tool has bounced off the bone, and is still felt in contact
BEGIN, END = 2.25, 2.85  # s, of the animated picture
NUM_FRAMES, FRAME_MS = 40, 120
SIZE, ANIMATED_SIZE = (1280, 720), (960, 540)
# In the README the page is 830 px wide, and the names of ports are 9 px high.
PAGE_SIZE = (900, 1000)
PAGE_SCALE = 2

PATIENCE = 120  # s, for an answer of the browser


class Browser:
    """A headless Chromium that shows one page.

    It is controlled by the protocol of its developer tools, JSON through two pipes.
    """

    def __init__(self, page: Path, size: tuple[int, int] = SIZE, scale: int = 1):
        program = shutil.which("chromium") or shutil.which("google-chrome")
        if program is None:
            raise SystemExit("no browser: `apt-get install chromium` brings one")
        # Processes of the browser may still write there during the deletion.
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        width, height = size
        # Chromium reads from file descriptor 3 and writes to 4. A plain sh does not
        # support descriptors of two digits, so bash redirects them.
        command = [
            *("bash", "-c", f'exec "$@" 3<&{to_browser} 4>&{from_browser}', "bash"),
            *(program, "--headless", "--no-sandbox", "--disable-dev-shm-usage"),
            *("--use-gl=angle", "--use-angle=swiftshader"),
            *("--enable-unsafe-swiftshader", "--hide-scrollbars"),
            *(f"--window-size={width},{height}", "--remote-debugging-pipe"),
            f"--user-data-dir={self._profile.name}",
        ]
        self._process = subprocess.Popen(
            command,
            pass_fds=(to_browser, from_browser),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._rest, self._count, self._session = b"", 0, None
        target = self.Call("Target.createTarget", url=page.as_uri())["targetId"]
        attached = self.Call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        self.Call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=False,
        )
        # An empty page, which is complete at once, precedes the page.
        there = "location.href != 'about:blank' && document.readyState == 'complete'"
        while not self.Evaluate(there):
            pass

    def Call(self, method, **parameters):
        """Calls a method of the developer tools and returns its result."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._rest:
                if not select.select([self._read], [], [], PATIENCE)[0]:
                    raise RuntimeError(f"the browser is silent for {PATIENCE} s")
                chunk = os.read(self._read, 1 << 20)
                if not chunk:
                    raise RuntimeError("the browser has ended")
                self._rest += chunk
            text, _, self._rest = self._rest.partition(b"\0")
            answer = json.loads(text)
            if answer.get("id") == self._count:
                return answer["result"]

    def Evaluate(self, expression: str):
        """Returns the value of a JavaScript expression; waits if it is a promise."""
        answer = self.Call(
            "Runtime.evaluate",
            expression=expression,
            awaitPromise=True,
            returnByValue=True,
        )
        return answer["result"].get("value")

    def Picture(self, time: float) -> Image.Image:
        """Returns a picture of the page at a time of the runs, in s."""
        # After three frames everything is drawn.
        self.Evaluate(
            "new Promise((done) => { viewer.gui.hide(); viewer.animator.pause();"
            f"viewer.animator.seek({time});"
            "requestAnimationFrame(() => requestAnimationFrame(() => "
            "requestAnimationFrame(() => done(1)))); })"
        )
        return self.Screenshot()

    def Screenshot(self) -> Image.Image:
        """Returns a picture of the current page."""
        data = self.Call("Page.captureScreenshot")["data"]
        return Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")

    def Close(self) -> None:
        """Ends the browser."""
        self._process.terminate()
        self._process.wait()
        os.close(self._read)
        os.close(self._write)
        self._profile.cleanup()


def MakePagePicture(path: Path) -> None:
    """Makes the picture of the living diagram, at the same time as the still."""
    with tempfile.TemporaryDirectory() as temporary:
        page = Path(temporary) / "page.html"
        WritePage(SCENARIO, page, controllers=CONTROLLERS)
        browser = Browser(page, PAGE_SIZE, PAGE_SCALE)
        try:
            browser.Evaluate(
                f"teleop.ready.then(() => {{ setCursor({STILL}); say('') }})"
            )
            browser.Screenshot().quantize(256).save(path, optimize=True)
        finally:
            browser.Close()


def main(folder: Path) -> None:
    """Makes the pictures in a folder."""
    MakePagePicture(folder / "page.png")
    recordings = {
        kind.replace("_", " "): simulate(
            LoadScenario(SCENARIO, {"controller.kind": kind, "duration": 4.0})
        )
        for kind in CONTROLLERS
    }
    with tempfile.TemporaryDirectory() as temporary:
        page = Path(temporary) / "scene.html"
        MakeReplay(recordings).Save(page)
        browser = Browser(page)
        try:
            ready = "viewer.animator.actions.length > 0"
            while not browser.Evaluate(ready):
                pass
            browser.Picture(STILL).save(folder / "scene.png", optimize=True)
            times = np.linspace(BEGIN, END, NUM_FRAMES)
            frames = [browser.Picture(t).resize(ANIMATED_SIZE) for t in times]
        finally:
            browser.Close()
    frames[0].save(
        folder / "scene.webp",
        save_all=True,
        append_images=frames[1:],
        duration=[FRAME_MS] * (NUM_FRAMES - 1) + [1500],
        loop=0,
        quality=55,
        method=6,
    )
    print(*(f"Written: {folder / x}" for x in ("page.png", "scene.png", "scene.webp")))


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent))

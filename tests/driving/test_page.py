"""The page in a real browser: a key that is pressed there moves the hand."""

import asyncio
import json
import shutil
import subprocess
import time
import urllib.request

import pytest
from pydrake.geometry import Meshcat

from teleop_drake.driving import MakeControls
from teleop_drake.scenario import LoadScenario

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))),
    None,
)
OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-dev-shm-usage", "--no-first-run"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--remote-debugging-port=0",),
)


def Until(what, seconds=60):
    """Waits for what is not None, and returns it."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found = what()
        if found is not None:
            return found
        time.sleep(0.1)
    raise TimeoutError


async def Press(websocket_url, keys):
    from tornado.websocket import websocket_connect

    connection = await websocket_connect(websocket_url)
    for number, code in enumerate(keys):
        parameters = {"type": "keyDown", "code": code, "key": code}
        call = {"id": number, "method": "Input.dispatchKeyEvent", "params": parameters}
        await connection.write_message(json.dumps(call))
        await connection.read_message()
    connection.close()


@pytest.mark.slow
def test_a_key_moves_the_hand(tmp_path):
    pytest.importorskip("tornado")
    if BROWSER is None:
        pytest.skip("no browser: `apt-get install chromium` brings one")
    meshcat = Meshcat()
    controls = MakeControls(meshcat, LoadScenario("two_dof_collision"))
    browser = subprocess.Popen(
        [BROWSER, *OPTIONS, f"--user-data-dir={tmp_path}", meshcat.web_url()],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        Until(lambda: meshcat.GetNumActiveConnections() or None)
        # Chromium writes down which port it took.
        file = tmp_path / "DevToolsActivePort"
        port = Until(lambda: file.read_text().split()[0] if file.exists() else None)
        with urllib.request.urlopen(f"http://localhost:{port}/json") as answer:
            (page,) = [x for x in json.load(answer) if x["type"] == "page"]

        def Pressed():
            """Presses until the page has its controls."""
            keys = ["ArrowRight", "ArrowDown"]
            asyncio.run(Press(page["webSocketDebuggerUrl"], keys))
            command = controls.Command(0.0).tolist()
            return command if command[0] else None

        x, y = Until(Pressed)
        assert x > 0 > y
        asyncio.run(Press(page["webSocketDebuggerUrl"], ["Space"]))
        assert Until(lambda: True if not controls.Command(0.0).any() else None)
    finally:
        browser.terminate()
        browser.wait(timeout=30)

"""A browser without a window that opens pages and runs scripts in them."""

import importlib.util
import shutil
import subprocess
import time
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parent / "study/page"
SIZE = 1280, 720


def MakePictures():
    """The script that makes the pictures of the README, whose browser this is."""
    if not (shutil.which("chromium") or shutil.which("google-chrome")):
        pytest.skip("no browser: `apt-get install chromium` brings one")
    script = Path(__file__).parents[1] / "diagrams/scene/make_pictures.py"
    spec = importlib.util.spec_from_file_location("make_pictures", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def ReadAxe():
    """The script of axe-core, which finds what keeps a page from being accessible."""
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("no npm, which brings axe-core")
    command = [npm, "root", "--global"]
    root = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    axe = Path(root.strip()) / "axe-core/axe.min.js"
    if not axe.exists():
        pytest.skip("no axe-core: `npm install --global axe-core` brings it")
    return axe.read_text("utf-8")


@pytest.fixture(scope="session")
def session_browser(tmp_path_factory):
    """Starts a browser once for the tests of all files."""
    empty = tmp_path_factory.mktemp("browser") / "empty.html"
    empty.touch()
    browser = MakePictures().Browser(empty, SIZE)
    yield browser
    browser.Close()


@pytest.fixture(scope="module")
def browser(session_browser):
    """Returns the browser, and closes the last page of a file after its tests."""
    yield session_browser
    # A page that stays open takes processor time from the tests of other files.
    session_browser.Call("Page.navigate", url="about:blank")


@pytest.fixture(scope="module")
def look(browser):
    """Returns what a script finds in a page, opened in a window of a size."""

    def Look(page, script, *, link="", size=SIZE, is_dark=False):
        browser.Call(
            "Emulation.setDeviceMetricsOverride",
            width=size[0],
            height=size[1],
            deviceScaleFactor=1,
            mobile=False,
        )
        scheme = {
            "name": "prefers-color-scheme",
            "value": "dark" if is_dark else "light",
        }
        browser.Call("Emulation.setEmulatedMedia", features=[scheme])
        # Another state of a page that is open would be no new page.
        browser.Call("Page.navigate", url="about:blank")
        url = page.as_uri() + link
        browser.Call("Page.navigate", url=url)
        is_there = f"location.href == '{url}' && 'teleop' in window"
        while not browser.Evaluate(is_there):
            time.sleep(0.02)
        answer = browser.Call(
            "Runtime.evaluate",
            expression=SCRIPTS.joinpath(script).read_text("utf-8"),
            awaitPromise=True,
            returnByValue=True,
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    return Look

"""A browser that runs the scripts of this folder in pages."""

import time
from pathlib import Path

import pytest
from browsers import MakePictures

SCRIPTS = Path(__file__).parent


@pytest.fixture(scope="module")
def look(tmp_path_factory):
    """Returns what a script finds in a page; all are opened in one browser."""
    empty = tmp_path_factory.mktemp("browser") / "empty.html"
    empty.touch()
    browser = MakePictures().Browser(empty, (1280, 720))

    def Look(page, script):
        browser.Call("Page.navigate", url=page.as_uri())
        is_there = f"location.href == '{page.as_uri()}' && 'teleop' in window"
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

    yield Look
    browser.Close()

"""The browser that makes the pictures of the README."""

import importlib.util
import shutil
from pathlib import Path

import pytest


def MakePictures():
    """The script that makes the pictures of the README, whose browser this is."""
    if not (shutil.which("chromium") or shutil.which("google-chrome")):
        pytest.skip("no browser: `apt-get install chromium` brings one")
    script = Path(__file__).parents[1] / "diagrams/scene/make_pictures.py"
    spec = importlib.util.spec_from_file_location("make_pictures", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module

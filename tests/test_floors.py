"""Each floor has a README of one screen, and the lowest one stands alone."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import teleop_drake
from teleop_drake import loops

PACKAGE = Path(teleop_drake.__file__).parent
TESTS = Path(__file__).parent

# The tests of the copy have the settings of the short run, and search nothing.
CONFTEST = """\
from hypothesis import settings

settings.register_profile("short", derandomize=True, max_examples=15, deadline=None)
settings.load_profile("short")
"""


@pytest.mark.parametrize("floor", ["loops", "model", "study"])
@pytest.mark.usefixtures("in_an_empty_folder", "in_this_process")
def test_a_floor_has_a_readme_of_one_screen(floor):
    text = (PACKAGE / floor / "README.md").read_text("utf-8")
    assert text.count("\n") <= 50
    names = re.findall(r"^\| `([A-Za-z]+)` \| ", text, re.M)
    assert len(names) == 6
    assert set(names) <= set(teleop_drake.__all__)
    if floor == "loops":
        assert set(names) <= set(loops.__all__)
    rooms = set(re.findall(r"`(\w+)/`", text))
    folders = {x.parent.name for x in (PACKAGE / floor).glob("*/*")}
    assert rooms == folders - {"__pycache__"}
    for code in re.findall(r"```python\n(.*?)```", text, re.S):
        exec(compile(code, f"{floor}/README.md", "exec"), {})


def test_names_of_loops_take_systems():
    """Those that the package exports as well are the same, or take scenarios, too."""
    same = [x for x in loops.__all__ if getattr(loops, x) is getattr(teleop_drake, x)]
    assert set(loops.__all__) - set(same) == {
        *("Compile", "MakePage", "WritePage", "simulate"),
    }


@pytest.mark.slow
def test_loops_alone_pass_their_tests(tmp_path):
    """A copy without the floors above, in a folder where nothing else is."""
    package = tmp_path / "teleop_drake"
    tests = tmp_path / "tests"
    skipped = shutil.ignore_patterns("__pycache__")
    shutil.copytree(PACKAGE / "loops", package / "loops", ignore=skipped)
    shutil.copytree(TESTS / "loops", tests / "loops", ignore=skipped)
    for helper in TESTS.glob("*.py"):
        if not helper.name.startswith(("test_", "conftest")):
            shutil.copy(helper, tests)
    shutil.copy(TESTS.parent / "pyproject.toml", tmp_path)
    (package / "__init__.py").write_text('"""The lowest floor alone."""\n')
    (tests / "conftest.py").write_text(CONFTEST)
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "2", "tests/loops"]
    environment = {
        **os.environ,
        "PYTHONPATH": str(tmp_path),
        "OPENBLAS_NUM_THREADS": "1",
    }
    done = subprocess.run(
        [*command, "--dist", "loadgroup"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:]

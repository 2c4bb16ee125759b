"""The modules of the page's script, and how they are joined."""

import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest

import teleop_drake
from teleop_drake.loops.page.script import JoinModules

MODULES = sorted(
    Path(teleop_drake.__file__).parent.joinpath("loops/page/js").glob("*.js")
)

# The script of a page, and that of the report.
MAINS = "main.js", "report.js"

DECLARATION = re.compile(
    r"^(?:export )?(?:async )?(?:function|class|const|let) (\w+)", re.M
)
FUNCTION = re.compile(
    r"(export )?(async )?(function|class) \w+"
    r"|  (async )?(get )?(?!if|for|while|constructor|switch)\w+\(.*\) \{"
)


@pytest.mark.parametrize("main", MAINS)
def test_each_module_is_joined_after_those_that_it_imports(main):
    script = JoinModules(main)
    texts = {path.name: path.read_text("utf-8") for path in MODULES}
    begins = {name: script.find(text.splitlines()[0]) for name, text in texts.items()}
    for name, begin in begins.items():
        for imported in re.findall(r'"\./(\w+\.js)"', texts[name]):
            assert begin < 0 or 0 <= begins[imported] < begin, (name, imported)
    assert begins[main] > 0
    assert not re.search(r"^(import|export) ", script, re.M)


def test_each_module_is_used():
    scripts = "".join(map(JoinModules, MAINS))
    for path in MODULES:
        assert path.read_text("utf-8").splitlines()[0] in scripts, path.name


def test_top_level_names_differ_between_modules():
    """One script has all of them."""
    names = Counter(
        name for path in MODULES for name in DECLARATION.findall(path.read_text())
    )
    assert [name for name, count in names.items() if count > 1] == []


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_each_function_has_a_comment(path):
    lines = path.read_text("utf-8").splitlines()
    found = [i for i, line in enumerate(lines) if FUNCTION.match(line)]
    without = [lines[i] for i in found if not lines[i - 1].strip().startswith("//")]
    assert without == []
    assert max(map(len, lines)) <= 100


@pytest.mark.slow
def test_eslint_finds_nothing():
    if not shutil.which("eslint"):
        pytest.skip("no eslint: `npm install --global eslint` brings one")
    root = Path(__file__).parents[3]
    config = "tests/study/page/eslint.config.mjs"
    scripts = ["teleop_drake/loops/page/js", "tests/study/page"]
    command = ["eslint", "--config", config, *scripts]
    done = subprocess.run(
        command, cwd=root, capture_output=True, check=False, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr

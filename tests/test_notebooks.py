"""The notebooks: they run in a kernel of their own, and are committed clean."""

import ast
import importlib
import os
import re
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

import IPython.display
import make_gallery
import nbformat
import numpy as np
import pytest
from grids import Slow
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from PIL import Image
from pydrake.systems.primitives import Adder

from teleop_drake.study.figures.notebook import ShowDiagram, ShowTable

TESTS = Path(__file__).parent
FAILING = TESTS / "failing_notebook.ipynb"
NOTEBOOKS = sorted((TESTS.parent / "notebooks").glob("*.ipynb"))

MAX_LINES = 80
"""Lines of code of a notebook that a class can read in an hour."""

MAX_LINES_FOR_DEVELOPERS = 125
"""Lines of code of the notebook on the compiler."""

# Runs before the first cell. Importing Drake's module first keeps it from putting its
# own filter in front.
STRICT = f"""\
import sys, warnings
import pydrake.common.deprecation
warnings.simplefilter("error", DeprecationWarning)
assert sys.executable == {sys.executable!r}, sys.executable
"""


def Read(path):
    return nbformat.read(path, as_version=4)


def CodeCells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def Execute(notebook, directory):
    """Executes a notebook in place; raises what its cells raise or print to stderr.

    Deprecation warnings are errors.
    """
    strict = nbformat.v4.new_code_cell(STRICT)
    notebook.cells.insert(0, strict)
    NotebookClient(
        notebook,
        timeout=600,
        kernel_name="python3",
        resources={"metadata": {"path": str(directory)}},
    ).execute(
        env=os.environ
        | {
            "DRAKE_DEPRECATION_RUNTIME_SEVERITY": "error",
            "IPYTHONDIR": str(directory / "ipython"),
        }
    )
    notebook.cells.remove(strict)
    for cell in CodeCells(notebook):
        for output in cell.outputs:
            assert output.get("name") != "stderr", output.text


@pytest.mark.parametrize("path", Slow(NOTEBOOKS, but=[]), ids=lambda path: path.stem)
def test_runs(path, tmp_path):
    notebook = Read(path)
    for file in path.parent.glob("*.py"):
        shutil.copy(file, tmp_path)
    for name in ("classics", "league"):
        shutil.copytree(path.parent / name, tmp_path / name)
    Execute(notebook, tmp_path)
    cells = CodeCells(notebook)
    shown = [
        output.data
        for cell in cells
        for output in cell.outputs
        if output.output_type in ("display_data", "execute_result")
    ]
    pictures = [
        data
        for data in shown
        if "image/png" in data or "<svg" in data.get("text/html", "")
    ]
    assert len(pictures) >= 3
    # The page that simulates is in the notebook itself, and needs no kernel.
    assert any("<iframe srcdoc" in data.get("text/html", "") for data in shown)
    # It is the one that the gallery shows, but for the colours of the palette.
    now = make_gallery.PictureOf(notebook, path.stem)
    shown = Image.open(make_gallery.PathOf(path.stem)).convert("RGB")
    assert shown.size == now.size
    assert np.abs(np.subtract(shown, now, dtype=float)).mean() < 2


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_they_take_from_the_package_is_there(path):
    """All that a notebook imports, anywhere in it."""
    for cell in CodeCells(Read(path)):
        for node in ast.walk(ast.parse(cell.source)):
            if isinstance(node, ast.ImportFrom):
                module = importlib.import_module(node.module)
                for alias in node.names:
                    name = f"{node.module}.{alias.name}"
                    has_file = hasattr(module, "__path__") and find_spec(name)
                    assert hasattr(module, alias.name) or has_file, name


@pytest.mark.parametrize(
    ("number", "error"),
    Slow(
        [
            (0, "AssertionError"),
            (1, "DeprecationWarning"),
            (2, "DrakeDeprecationWarning"),
            (3, "something is wrong"),
        ],
        but=[],
    ),
)
def test_the_runner_notices_a_failure(number, error, tmp_path):
    notebook = Read(FAILING)
    notebook.cells = [CodeCells(notebook)[number]]
    with pytest.raises((CellExecutionError, AssertionError), match=error):
        Execute(notebook, tmp_path)


def test_tables_and_diagrams_are_shown(monkeypatch):
    shown = []
    monkeypatch.setattr(IPython.display, "display", shown.append)
    ShowTable(("a", "b"), (1, 2.5))
    ShowDiagram(Adder(1, 1))
    table, diagram = (x.data for x in shown)
    assert table == "| a | b |\n| --- | --- |\n| 1 | 2.5 |"
    assert diagram.startswith('<svg style="max-width: 100%; height: auto" width=')


def test_a_row_that_does_not_fit_its_head_is_refused():
    with pytest.raises(ValueError, match=r"row \('x',\): must have 2 cells, and has 1"):
        ShowTable(("a", "b"), ("x",))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_tables_come_from_data(path):
    """No notebook takes cells out of a text that was printed."""
    for cell in CodeCells(Read(path)):
        called = [
            node.func.attr
            for node in ast.walk(ast.parse(cell.source))
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
        ]
        assert {*called}.isdisjoint({"split", "strip", "splitlines", "getvalue"})


@pytest.mark.parametrize("path", [*NOTEBOOKS, FAILING], ids=lambda path: path.stem)
def test_is_committed_clean(path):
    notebook = Read(path)
    nbformat.validate(notebook)
    assert notebook.metadata == {
        "kernelspec": {
            "display_name": "Python 3",
            "language": "python",
            "name": "python3",
        },
        "language_info": {"name": "python"},
    }
    assert all(cell.metadata == {} for cell in notebook.cells)
    assert all(cell.source.strip() for cell in notebook.cells)
    for cell in CodeCells(notebook):
        assert cell.outputs == []
        assert cell.execution_count is None


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_is_a_story_with_the_public_api(path):
    notebook = Read(path)
    first = notebook.cells[0]
    last = notebook.cells[-1]
    assert first.cell_type == last.cell_type == "markdown"
    assert first.source.startswith("# ")
    assert "to run" in first.source
    assert last.source.startswith("## Things to try\n\n* ")
    code = [cell.source for cell in CodeCells(notebook)]
    assert code[0].startswith(("import ", "from "))
    for source in code:
        assert "pydrake.all" not in source
        # Nothing private is imported or called.
        assert not re.search(r"(\.|import |, )_[a-zA-Z]", source), source
        # What runs here is Python: no magic, no shell.
        ast.parse(source)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_is_short(path):
    """Lines of code are those that are neither empty nor a comment."""
    code = "\n".join(cell.source for cell in CodeCells(Read(path)))
    lines = [line.strip() for line in code.splitlines()]
    is_on_compiler = path.stem == "11_machine_code"
    most = MAX_LINES_FOR_DEVELOPERS if is_on_compiler else MAX_LINES
    assert sum(line != "" and line[0] != "#" for line in lines) <= most
    assert "UseStyle" not in code and "matplotlib" not in code


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_gallery_was_made_by_this_code(path):
    """`python notebooks/make_gallery.py NAME` makes it anew."""
    picture = Image.open(make_gallery.PathOf(path.stem))
    assert picture.text["Code"] == make_gallery.CodeHash(Read(path))


def test_the_page_of_the_gallery_is_current():
    page = make_gallery.FOLDER / "README.md"
    assert page.read_text("utf-8") == make_gallery.MakePage()


def test_other_notebooks_that_they_name_are_there():
    stems = {path.stem for path in NOTEBOOKS}
    for path in NOTEBOOKS:
        assert set(re.findall(r"`(\d\d_\w+)`", path.read_text("utf-8"))) <= stems

"""The command `teleop-drake docs`, and the site that Sphinx makes for it."""

import contextlib
import io
import json
import os
import re
import runpy
import shutil
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from browsers import ReadAxe
from nbformat import write
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

import teleop_drake
from teleop_drake.cli import main
from teleop_drake.cli.commands.docs import PAGES, PARTS

# Extensions of Sphinx call what its next version deprecates.
pytestmark = pytest.mark.filterwarnings(
    "ignore::DeprecationWarning", "ignore::PendingDeprecationWarning"
)

DOCS = Path(teleop_drake.__file__).parent / "docs"


def Pages(folder: Path) -> list[Path]:
    """The pages of a site, without the templates of its theme."""
    return [page for page in folder.rglob("*.html") if page.parent.name != "_static"]


def Broken(folder: Path) -> list[str]:
    """The links of a folder of HTML pages that lead nowhere within it."""
    ids: dict[Path, set[str]] = {}

    def Ids(page: Path) -> set[str]:
        if page not in ids:
            ids[page] = set(re.findall(r'id="([^"]+)"', page.read_text("utf-8")))
        return ids[page]

    broken = []
    for page in Pages(folder):
        text = re.sub(r"<script.*?</script>", "", page.read_text("utf-8"), flags=re.S)
        for link in re.findall(r'(?:href|src)="([^"]+)"', text):
            if re.match(r"\w+:", link):
                continue
            path, _, anchor = link.partition("?")[0].partition("#")
            target = page.parent / path if path else page
            if not target.is_file() or (anchor and anchor not in Ids(target)):
                broken.append(f"{page.relative_to(folder)}: {link}")
    return broken


def test_the_pages_are_named(capsys):
    assert main(["docs"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 8
    for line in lines:
        path, title = re.split(r"\s{2,}", line)
        assert Path(path).read_text("utf-8").startswith(f"# {title}\n")


def test_the_pictures_of_the_pages_are_in_the_package():
    for page in PAGES:
        for picture in re.findall(r"!\[[^]]*\]\(([^)]+)\)", page.read_text("utf-8")):
            path = (page.parent / picture).resolve(strict=True)
            assert path.is_relative_to(Path(teleop_drake.__file__).parent)


def test_the_site_needs_sphinx(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "sphinx.application", None)
    assert main(["docs", "--out", str(tmp_path / "site")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "pip install 'teleop-drake[docs]'" in line


def test_an_unknown_part_is_refused(tmp_path, capsys):
    assert main(["docs", "--out", str(tmp_path), "--parts", "live,films"]) == 2
    assert "--parts = 'films': must be one of live, api" in capsys.readouterr().err


def test_an_installed_package_says_that_it_has_no_notebooks(
    tmp_path, capsys, monkeypatch
):
    built = []

    def MakeSite(**arguments):
        built.append(arguments)
        return SimpleNamespace(build=lambda: None, statuscode=0)

    monkeypatch.setattr("sphinx.application.Sphinx", MakeSite)
    monkeypatch.setattr("teleop_drake.cli.commands.docs._PACKAGE", tmp_path / "none")
    assert main(["docs", "--out", str(tmp_path / "site"), "--quiet"]) == 0
    shown = capsys.readouterr()
    assert shown.out == f"{tmp_path / 'site' / 'index.html'}\n"
    assert "notebooks: left out" in shown.err
    assert "a checkout of the repository" in shown.err
    assert built[0]["tags"] == list(PARTS)


def test_each_public_name_has_an_entry_in_the_reference():
    entries = [
        entry
        for page in (DOCS / "api").glob("*.rst")
        for entry in re.findall(r"^\.\. auto\w+:: (\w+)$", page.read_text(), re.M)
    ]
    assert sorted(entries) == sorted(teleop_drake.__all__)


def Configuration(*parts):
    """Returns the names of conf.py when the site has some parts."""
    tags = SimpleNamespace(has=parts.__contains__)
    return runpy.run_path(str(DOCS / "conf.py"), {"tags": tags})


def test_the_site_has_all_pages_and_runs_notebooks_on_request():
    configuration = Configuration()
    source = ["# Index\n"]
    configuration["_AddContents"](None, configuration["root_doc"], source)
    assert re.findall(r"(?m)^/teleop_drake/(?!.*\*)(.*)", source[0]) == [
        str(page.relative_to(DOCS.parent).with_suffix("")) for page in PAGES[1:]
    ]
    assert configuration["nb_execution_mode"] == "off"
    assert Configuration("notebooks")["nb_execution_mode"] == "cache"
    others = {"pyproject.toml", "tests"}
    assert others <= set(configuration["exclude_patterns"]) - {"README.md"}


def test_docstrings_are_markdown():
    lines = """Title of |v| and C_, not C_e or `|x|`.

    a = b*c_

| in | C_+ |
|----|-----|
| -  | `x_` |

Args:
    **k: `a_`.""".splitlines()
    Configuration()["_ReadMarkdown"](lines)
    expected = r"""Title of \|v\| and C\_, not C_e or `|x|`.

::

    a = b*c_

.. list-table::
   :header-rows: 1

   * - in
     - C\_+
   * - \-
     - `x_`

Args:
    **k: `a_`."""
    assert "\n".join(lines) == expected


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site without what takes minutes, made without a warning."""
    out = tmp_path_factory.mktemp("site")
    with contextlib.redirect_stderr(io.StringIO()) as told:
        assert main(["docs", "--out", str(out), "--parts", "live,api", "--quiet"]) == 0
    assert told.getvalue() == ""
    return out


@pytest.mark.slow
def test_the_site(site):
    """Every link leads somewhere, and nothing comes from elsewhere."""
    assert Broken(site) == []
    for path in Pages(site):
        text = path.read_text("utf-8")
        assert not re.search(r'(?:src|<link[^>]* href)="(?:/|https?:)', text), path
    entry = (site / "teleop_drake/docs/api/architectures.html").read_text("utf-8")
    assert 'id="teleop_drake.AdaptiveBackstepping"' in entry and "5.31" in entry
    assert "<math" in (site / "notebooks/07_stability.html").read_text("utf-8")
    (site / "broken.html").write_text('<a href="nowhere.html">', "utf-8")
    assert Broken(site) == ["broken.html: nowhere.html"]
    (site / "broken.html").unlink()


def Open(browser, page, size=(1280, 720), *, is_dark=False):
    """Opens a page in a window of a size, and waits until it is complete."""
    width, height = size
    browser.Call(
        "Emulation.setDeviceMetricsOverride",
        width=width,
        height=height,
        deviceScaleFactor=1,
        mobile=False,
    )
    scheme = {"name": "prefers-color-scheme", "value": "dark" if is_dark else "light"}
    browser.Call("Emulation.setEmulatedMedia", features=[scheme])
    browser.Call("Page.navigate", url=page.as_uri())
    there = f"location.href == '{page.as_uri()}' && document.readyState == 'complete'"
    while not browser.Evaluate(there):
        time.sleep(0.02)


@pytest.mark.slow
@pytest.mark.parametrize("is_dark", [False, True], ids=["light", "dark"])
def test_axe_finds_nothing_in_the_site(browser, site, is_dark):
    axe = ReadAxe()
    docs = site / "teleop_drake/docs"
    for page in (site / "index.html", docs / "guide.html", docs / "api/channels.html"):
        Open(browser, page, is_dark=is_dark)
        found = browser.Evaluate(f"{axe}; axe.run().then((x) => JSON.stringify(x))")
        faults = json.loads(found)["violations"]
        assert [(fault["id"], fault["nodes"][0]["html"]) for fault in faults] == []


@pytest.mark.slow
def test_the_first_screen_has_a_slider_and_the_curve_that_it_moves(browser, site):
    Open(browser, site / "index.html")
    box = "JSON.stringify(document.querySelector('iframe').getBoundingClientRect())"
    frame = json.loads(browser.Evaluate(box))
    assert frame["bottom"] <= 720
    size = round(frame["width"]), round(frame["height"])
    Open(browser, site / "live/start.html", size)
    script = """teleop.ready.then(async () => {
      const scope = () => document.querySelector("#scopes svg[role=img]");
      const curve = () => scope().innerHTML;
      const slider = document.querySelector("#inputs input[type=range]");
      const boxes = [slider, scope()].map((part) =>
        part.getBoundingClientRect().toJSON());
      const before = curve();
      slider.value = slider.max;
      slider.dispatchEvent(new Event("input", { bubbles: true }));
      const begin = performance.now();
      while (curve() === before && performance.now() - begin < 20000)
        await new Promise((go) => setTimeout(go, 50));
      return JSON.stringify([boxes, curve() !== before]);
    })"""
    boxes, is_moved = json.loads(browser.Evaluate(script))
    assert is_moved
    for box in boxes:
        assert 0 < box["top"] < box["bottom"] <= frame["height"]


@pytest.mark.slow
def test_a_notebook_shows_its_outputs_and_runs_once(tmp_path, monkeypatch):
    from sphinx.application import Sphinx

    # The configuration changes it.
    monkeypatch.setenv("PYTHONPATH", os.environ.get("PYTHONPATH", ""))
    folder = tmp_path / "sources"
    runs = tmp_path / "runs.txt"
    (folder / "notebooks").mkdir(parents=True)
    (folder / "teleop_drake/docs").mkdir(parents=True)
    shutil.copy(PAGES[0], folder / "teleop_drake/docs")
    code = f'import classics\nopen("{runs}", "a").write("run\\n")\nprint(6 * 7, "& 1")'
    for text in ("# First", "# Second"):
        cells = [new_markdown_cell(text), new_code_cell(code)]
        write(new_notebook(cells=cells), folder / "notebooks/00_test.ipynb")
        site = Sphinx(
            srcdir=folder,
            confdir=DOCS,
            outdir=tmp_path / "site",
            doctreedir=tmp_path / "doctrees",
            buildername="html",
            confoverrides={"nb_execution_cache_path": str(tmp_path / "cache")},
            status=None,
            warning=None,
            tags=["notebooks"],
        )
        site.build()
        page = (tmp_path / "site/notebooks/00_test.html").read_text("utf-8")
        assert text[2:] in page and "42 &amp; 1" in page
        assert "http://localhost:8888/lab/tree/notebooks/00_test.ipynb" in page
        assert runs.read_text() == "run\n"

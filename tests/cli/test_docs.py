"""The command `teleop-drake docs`."""

import html
import re
import sys
from pathlib import Path

import IPython.display
import pytest
from IPython.core.formatters import DisplayFormatter
from nbformat.v4 import new_code_cell, new_markdown_cell, new_output

import teleop_drake
from teleop_drake.cli import main
from teleop_drake.cli.site import PAGES, Site, _CellHtml
from teleop_drake.study.figures.notebook import ShowTable


def Broken(folder: Path) -> list[str]:
    """The links of a folder of HTML pages that lead nowhere within it."""
    ids: dict[Path, set[str]] = {}

    def Ids(page: Path) -> set[str]:
        if page not in ids:
            ids[page] = set(re.findall(r'id="([^"]+)"', page.read_text("utf-8")))
        return ids[page]

    broken = []
    for page in folder.rglob("*.html"):
        text = re.sub(r"<script.*?</script>", "", page.read_text("utf-8"), flags=re.S)
        for link in re.findall(r'(?:href|src)="([^"]+)"', text):
            if re.match(r"\w+:", link):
                continue
            path, _, anchor = link.partition("#")
            target = page.parent / path if path else page
            if anchor.startswith("_"):  # pdoc links to private bases, and omits them.
                anchor = ""
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


def test_the_site_needs_pdoc(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "pdoc", None)
    assert main(["docs", "--out", str(tmp_path / "site")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "pip install 'teleop-drake[docs]'" in line


@pytest.mark.slow
def test_each_page_has_a_side_bar_with_all_titles(tmp_path):
    """A site without what takes long; it opens under any path."""
    Site(tmp_path, [], print).Write()
    titles = [re.escape(html.escape(page.read_text("utf-8").splitlines()[0][2:]))
              for page in PAGES[1:]]  # fmt: skip
    for page in PAGES[1:]:
        text = (tmp_path / f"{page.stem}.html").read_text("utf-8")
        assert re.search(".*".join(titles), text, re.S)
        assert text.count('aria-current="page"') == 1
    assert Broken(tmp_path) == []
    # Nothing comes from elsewhere, and nothing is told from the root of a server.
    for path in tmp_path.glob("*.html"):
        assert not re.search(r'(?:src|<link[^>]* href)="(?:/|\w+:)', path.read_text())


def test_an_installed_package_says_that_it_has_no_notebooks(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("teleop_drake.cli.site._NOTEBOOKS", tmp_path / "none")
    options = ["--out", str(tmp_path), "--parts", "notebooks", "--quiet"]
    assert main(["docs", *options]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert "notebooks: left out" in line and "a checkout of the repository" in line
    assert not (tmp_path / "notebooks").exists()


def test_a_cell_of_a_notebook_has_its_outputs():
    code = new_code_cell("1 < 2")
    code.outputs = [new_output("execute_result", {"text/plain": "1 < 2"})]
    assert "<pre>1 &lt; 2</pre>" in _CellHtml(code)
    code.outputs = [new_output("display_data", {"image/png": "QUJD"})]
    assert 'src="data:image/png;base64,QUJD"' in _CellHtml(code)
    code.outputs = [new_output("display_data", {"text/html": "<b>x</b>"})]
    assert "<b>x</b>" in _CellHtml(code)


def test_a_table_of_a_notebook_is_a_table_of_the_site(monkeypatch):
    """Cells that are empty or have a bar in them stay in their columns."""
    shown = []
    monkeypatch.setattr(IPython.display, "display", shown.append)
    ShowTable(("", "b", "c"), ("", "x", "$1$"), ("|v|", "", "*y*"))
    (table,) = shown
    data, _ = DisplayFormatter().format(table)
    code = new_code_cell("ShowTable(...)")
    code.outputs = [new_output("display_data", data)]
    rows = re.findall(r"<tr>(.*?)</tr>", _CellHtml(code), re.S)
    cells = [re.findall(r"<t[hd]>(.*?)</t[hd]>", row, re.S) for row in rows]
    assert [row[:2] for row in cells] == [["", "b"], ["", "x"], ["|v|", ""]]
    assert cells[0][2] == "c"
    assert "<math" in cells[1][2]
    assert cells[2][2] == "<em>y</em>"


def test_links_of_notebooks_are_those_of_the_site(tmp_path):
    folder = Path(teleop_drake.__file__).parents[1] / "notebooks"
    text = "[a](../teleop_drake/docs/learning.md#b), [c](solutions.md)"
    site = Site(tmp_path, ["api"], print)
    assert site.WithLinks(text, folder, "../") == "[a](../learning.html#b), c"


def test_formulas_of_notebooks_are_mathml():
    pytest.importorskip("latex2mathml")
    assert "<mfrac>" in _CellHtml(new_markdown_cell(r"$\frac{1}{2}$"))


def test_an_unknown_part_is_refused(tmp_path, capsys):
    assert main(["docs", "--out", str(tmp_path), "--parts", "live,films"]) == 2
    assert "--parts = 'films': must be one of live, api" in capsys.readouterr().err


@pytest.mark.slow
def test_the_site(tmp_path, capsys):
    """Every link of the pages and of the reference leads somewhere."""
    site = tmp_path / "site"
    options = ["--parts", "live,api", "--quiet"]
    assert main(["docs", "--out", str(site), *options]) == 0
    assert capsys.readouterr().out == f"{site / 'index.html'}\n"
    laws = (site / "api/teleop_drake/model/laws/backstepping.html").read_text("utf-8")
    assert "5.31" in laws and 'href="../../../index.html"' in laws
    pages = (site / "stability.html").read_text("utf-8")
    assert "<table>" in pages and 'href="index.html"' in pages
    assert (site / "live/drive.html").stat().st_size > 100_000
    assert Broken(site) == []
    (site / "index.html").write_text('<a href="nowhere.html">', "utf-8")
    assert Broken(site) == ["index.html: nowhere.html"]

"""The command `teleop-drake docs`."""

import re
import sys
from pathlib import Path

import pytest

import teleop_drake
from teleop_drake.cli import main
from teleop_drake.cli.commands.docs import PAGES


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
def test_the_site(tmp_path, capsys):
    """Every link of the pages and of the reference leads somewhere."""
    site = tmp_path / "site"
    assert main(["docs", "--out", str(site)]) == 0
    assert capsys.readouterr().out == f"{site / 'index.html'}\n"
    laws = (site / "teleop_drake/laws/backstepping.html").read_text("utf-8")
    assert "5.31" in laws
    pages = (site / "stability.html").read_text("utf-8")
    assert "<table>" in pages and 'href="index.html"' in pages
    assert Broken(site) == []
    (site / "index.html").write_text('<a href="nowhere.html">', "utf-8")
    assert Broken(site) == ["index.html: nowhere.html"]

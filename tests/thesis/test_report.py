import base64
import csv
import dataclasses
import json
import re
from html import escape
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest

from teleop_drake.cli import main
from teleop_drake.thesis.figures import FIGURES
from teleop_drake.thesis.report import SelectFigures

pytestmark = pytest.mark.xdist_group("thesis")

VOID = {"meta", "img", "br"}

# Of a browser: what an SVG is.
NAMESPACE = "http://www.w3.org/2000/svg"


@pytest.fixture(scope="module")
def page(reproduced):
    return (reproduced.folder / "report.html").read_text(encoding="utf-8")


class Outline(HTMLParser):
    """Collects anchors and links, and checks that every tag is closed."""

    def __init__(self, page):
        super().__init__()
        self.open = []
        self.ids = []
        self.links = []
        self.sources = []
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            elif name == "href":
                self.links.append(value)
            elif name in ("src", "srcset", "data"):
                self.sources.append(value)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_every_file_is_there(reproduced):
    assert reproduced.paths[-1].name == "report.html"
    assert len(set(reproduced.paths)) == len(reproduced.paths)
    assert set(reproduced.folder.iterdir()) == set(reproduced.paths)
    names = {path.name for path in reproduced.paths}
    assert {"ledger.json", "ledger.csv"} < names
    for figure in reproduced.figures:
        assert {f"{figure.stem}.png", f"{figure.stem}.svg"} < names
    for path in reproduced.paths:
        if path.suffix == ".png":
            assert path.read_bytes().startswith(b"\x89PNG\r\n")
            assert path.stat().st_size > 5000
        elif path.suffix == ".svg":
            assert sum(1 for _ in ElementTree.parse(path).iter()) > 50


def test_each_run_is_simulated_once(reproduced, progress_lines):
    finished = [line for line in progress_lines if re.search(r": \w+, [\d.]+ s$", line)]
    assert len(finished) > 8
    assert len({line.split(": ")[0] for line in finished}) == len(finished)
    for figure in reproduced.figures:
        assert reproduced.lines.count(f"figure {figure.number}") == 1


def test_report_is_self_contained(page):
    outline = Outline(page)
    assert len(set(outline.ids)) == len(outline.ids)
    for link in outline.links:
        assert link.removeprefix("#") in outline.ids
    for source in outline.sources:
        assert source.startswith("data:image/svg+xml;base64,")
    assert "<link" not in page
    assert "url(" not in page and "@import" not in page
    assert "://" not in page.replace(NAMESPACE, "")
    assert len(page.encode()) < 4e6


def test_report_has_every_figure(reproduced, page):
    for figure in reproduced.figures:
        assert f'id="{figure.stem}"' in page
        assert f"Figure {figure.number}: {escape(figure.title)}" in page
        assert escape(figure.caption) in page
    # That of a run is live and needs no picture.
    (source,) = Outline(page).sources
    picture = reproduced.folder / "figure_2_1.svg"
    assert base64.b64decode(source.split(",")[1]) == picture.read_bytes()


def test_ledger_files(reproduced, page, ledger):
    rows = [dataclasses.asdict(row) for row in ledger]
    text = (reproduced.folder / "ledger.json").read_text(encoding="utf-8")
    assert json.loads(text) == rows
    with open(reproduced.folder / "ledger.csv", encoding="utf-8", newline="") as file:
        records = list(csv.DictReader(file))
    assert records == [{k: str(v) for k, v in row.items()} for row in rows]
    for row in rows:
        assert escape(row["claim"]) in page


def test_select_figures(subtests):
    assert [x.number for x in SelectFigures(["5.7", "4.1"])] == ["4.1", "5.7"]
    assert len(SelectFigures()) == len(FIGURES)
    for only in (["4.1", "9.9"], [""], []):
        with (
            subtests.test(only=only),
            pytest.raises(ValueError, match=r"must be one of 2\.1, 2\.4, .*5\.20"),
        ):
            SelectFigures(only)


@pytest.mark.slow
def test_command(tmp_path, monkeypatch, capsys, unrendered):
    monkeypatch.chdir(tmp_path)
    assert main(["reproduce", "--only", "2.4, 2.1"]) == 0
    captured = capsys.readouterr()
    assert captured.err == "figure 2.1\nfigure 2.4\n"
    assert captured.out.count("\n") == 1
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        f"figure_2_{i}.{suffix}" for i in (1, 4) for suffix in ("png", "svg")
    }
    options = ["--quiet", "--out", "quiet", "--format", "pdf,svg"]
    assert main(["reproduce", "--only", "2.4", *options]) == 0
    assert capsys.readouterr().err == ""
    assert {path.name for path in (tmp_path / "quiet").iterdir()} == {
        "figure_2_4.pdf",
        "figure_2_4.svg",
    }


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--only", "4.1,9.9"], ["--only", "'9.9'", "2.1, 2.4", "5.20"]),
        (["--only", ""], ["--only", "2.1, 2.4", "5.20"]),
        (["--format", "jpg"], ["--format", "'jpg'", "png, svg"]),
        (["--out", "/dev/null/x"], ["--out", "/dev/null/x", "folder"]),
    ],
)
def test_bad_input(arguments, parts, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["reproduce", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    for part in parts:
        assert part in captured.err

"""Reproduces the thesis: figures, ledger and a report in one HTML file.

The ledger has the claims of chapters 3 to 6, each measured on runs and given a verdict.

A claim with a number is `reproduced` if our number is within the tolerance, and
`refuted` if not. It is `reproduced in kind` if what the number stands for holds
although the number is another, or if fields of the scenario were fitted to it. A claim
without a number is turned into a criterion that can be measured; it is `reproduced` if
the criterion holds and `refuted` if not. Where no run can decide, it is `not
determinable`. No verdict is written down anywhere: each follows from recordings and
linear models.
"""

import base64
import csv
import dataclasses
import io
import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from string import Template

from teleop_drake.files import Replacing
from teleop_drake.thesis.claims import (
    chapter3,
    chapter4,
    chapter5_bone,
    chapter5_tissue,
    conclusions,
)
from teleop_drake.thesis.claims.claim import VERDICTS, Row
from teleop_drake.thesis.figures import FIGURES, ThesisFigure, WritePicture
from teleop_drake.thesis.runs import ThesisRuns
from teleop_drake.validation import Refuse

FORMATS = ("png", "svg")
"""What figures are written as, unless something else is asked for."""

CLAIMS = [
    *chapter3.CLAIMS,
    *chapter4.CLAIMS,
    *chapter5_tissue.CLAIMS,
    *chapter5_bone.CLAIMS,
    *conclusions.CLAIMS,
]
"""All claims, in the thesis's order."""

_CHAPTERS = {
    "2": "The loop and the task",
    "3": "A network that learns a disturbance",
    "4": "One degree of freedom",
    "5": "Two degrees of freedom",
}


def Ledger(runs: ThesisRuns) -> list[Row]:
    """Returns a row for each claim, in the thesis's order."""
    return [claim.Judge(runs) for claim in CLAIMS]


def SelectFigures(only: Sequence[str] | None = None) -> list[ThesisFigure]:
    """Returns figures by their numbers, such as "4.1", in order; None: all.

    Raises:
        ValueError: If there is no such figure, or no number at all.
    """
    if only is None:
        return list(FIGURES.values())
    unknown = [number for number in only if number not in FIGURES]
    if unknown or not only:
        Refuse("figure", unknown or None, f"one of {', '.join(FIGURES)}")
    return [figure for number, figure in FIGURES.items() if number in only]


def Reproduce(
    out: Path,
    *,
    only: Sequence[str] | None = None,
    formats: Sequence[str] = FORMATS,
    progress: Callable[[str], None] = lambda line: None,
    runs: ThesisRuns | None = None,
) -> list[Path]:
    """Simulates what the thesis simulates and writes what comes out.

    Each figure becomes `figure_4_1.png` and the like. Without `only` there are also
    `ledger.json` and `ledger.csv` with a record for each claim, and `report.html`,
    which contains all of it. Every file appears complete or not at all, and replaces
    one of the same name.

    Args:
        only: Numbers of figures, to make these and nothing else.
        formats: Of the figures: png, svg or pdf. The report is made of svg, which is
            therefore written with it in any case.
        progress: Called with one line of text when a run or a figure is finished.
        runs: Where the runs come from; None: simulated here.

    Returns:
        The paths of all files, the report being the last.

    Raises:
        ValueError: If there is no such figure.
        OSError: If a file cannot be written.
        RuntimeError: If nothing here can lay out a block diagram.
    """
    figures = SelectFigures(only)
    runs = runs or ThesisRuns(progress)
    if only is None:
        formats = list(dict.fromkeys([*formats, "svg"]))
    paths = []
    commands = {}
    for figure in figures:
        runs.used.clear()
        paths += WritePicture(figure.make(runs), out / figure.stem, formats)
        commands[figure.number] = "\n".join(runs.used)
        progress(f"figure {figure.number}")
    if only is None:
        rows = Ledger(runs)
        records = [dataclasses.asdict(row) for row in rows]
        texts = {
            "ledger.json": json.dumps(records, indent=2, ensure_ascii=False) + "\n",
            "ledger.csv": _LedgerCsv(records),
            "report.html": _Html(out, rows, commands),
        }
        for name, text in texts.items():
            with Replacing(out / name) as temporary:
                temporary.write_text(text, encoding="utf-8", newline="")
            paths.append(out / name)
    return paths


def _LedgerCsv(records: Sequence[Mapping[str, str]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(records[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    return text.getvalue()


def _Html(out: Path, rows: Sequence[Row], commands: Mapping[str, str]) -> str:
    """Returns the report, with the commands behind each figure by its number."""
    sections = []
    for chapter, title in _CHAPTERS.items():
        figures = "\n".join(
            _FigureHtml(out, figure, commands[number])
            for number, figure in FIGURES.items()
            if number.startswith(f"{chapter}.")
        )
        sections.append((f"chapter-{chapter}", f"Chapter {chapter}: {title}", figures))
    links = [("ledger", "Ledger of claims"), *(section[:2] for section in sections)]
    counts = Counter(row.verdict for row in rows)
    verdicts = ", ".join(f"{counts[x]} {x}" for x in VERDICTS if counts[x])
    template = (resources.files(__package__) / "report.html").read_text("utf-8")
    return Template(template).substitute(
        package=version("teleop-drake"),
        drake=version("drake"),
        contents=_Lines(f'<li><a href="#{a}">{title}</a></li>' for a, title in links),
        summary=f"Of {len(rows)} claims: {verdicts}.",
        rows=_Lines(map(_RowHtml, rows)),
        chapters=_Lines(
            f'<section id="{anchor}"><h2>{title}</h2>\n{html}\n</section>'
            for anchor, title, html in sections
        ),
    )


def _Lines(lines: Iterable[str]) -> str:
    return "\n".join(lines)


def _RowHtml(row: Row) -> str:
    texts = {name: escape(x) for name, x in dataclasses.asdict(row).items()}
    return (
        '<tr id="{key}"><td>{place}</td><td>{claim}<br><small>{criterion}</small></td>'
        "<td>{thesis}</td><td>{ours}</td><td>{tolerance}</td>"
        '<td class="{style}">{verdict}</td><td>{reason}{commands}</td></tr>'
    ).format(style=row.verdict.split()[-1], commands=_RunsHtml(row.runs), **texts)


def _FigureHtml(out: Path, figure: ThesisFigure, commands: str) -> str:
    """Returns a figure that brings its own data, so that the page needs no files."""
    data = base64.b64encode((out / f"{figure.stem}.svg").read_bytes()).decode()
    title = escape(f"Figure {figure.number}: {figure.title}")
    return (
        f'<figure id="{figure.stem}"><img alt="{title}" '
        f'src="data:image/svg+xml;base64,{data}">\n'
        f"<figcaption><strong>{title}.</strong> {escape(figure.caption)}"
        f"{_RunsHtml(commands)}</figcaption></figure>"
    )


def _RunsHtml(commands: str) -> str:
    """Returns the commands of runs, a line each, folded away."""
    if not commands:
        return ""
    lines = "<br>".join(
        f"<code>{escape(command)}</code>" for command in commands.splitlines()
    )
    return f"<details><summary>Runs</summary>{lines}</details>"

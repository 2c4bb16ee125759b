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
import dataclasses
import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from html import escape
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from string import Template

from teleop_drake.loops.framework.files import WriteText
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.page.document import PackedData
from teleop_drake.loops.page.script import JoinModules, ReadPart
from teleop_drake.study.sweep.folder import WriteCsv
from teleop_drake.thesis.claims import (
    chapter3,
    chapter4,
    chapter5_bone,
    chapter5_tissue,
    conclusions,
)
from teleop_drake.thesis.claims.claim import VERDICTS, Claim, Row
from teleop_drake.thesis.figures import FIGURES, ThesisFigure, WritePicture
from teleop_drake.thesis.live import FigureOf, Laboratory
from teleop_drake.thesis.runs import ThesisRuns

FORMATS = ("png", "svg")
"""The default formats of figures."""

CLAIMS = [
    *chapter3.CLAIMS,
    *chapter4.CLAIMS,
    *chapter5_tissue.CLAIMS,
    *chapter5_bone.CLAIMS,
    *conclusions.CLAIMS,
]
"""All claims, in the thesis's order."""

_TITLES = {
    "lab-one_dof": "Chapter 4: one degree of freedom",
    "lab-two_dof_puncture": "Chapter 5, case I: the arm, through tissue",
    "lab-two_dof_collision": "Chapter 5, case II: the arm, on to bone",
    "lab-two_dof_combined": (
        "Chapter 5, case III: the arm, through tissue and on to bone"
    ),
    "ledger": "Ledger of all claims",
    "chapter-2": "Chapter 2: the loop and the task",
    "chapter-3": "Chapter 3: a network that learns a disturbance",
}
"""The titles of the report's sections, keyed by their ids."""


def Ledger(runs: ThesisRuns) -> list[Row]:
    """Returns a row for each claim, in the thesis's order."""
    return [claim.Judge(runs) for claim in CLAIMS]


def SelectFigures(only: Sequence[str] | None = None) -> list[ThesisFigure]:
    """Returns figures in the thesis's order.

    Args:
        only: The numbers of the figures, such as "4.1"; None: all figures.

    Raises:
        ValueError: If there is no such figure, or `only` is empty.
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
    """Repeats the simulations of the thesis, and writes figures, ledger and report.

    The files of a figure have names such as `figure_4_1.png`. Without `only` there are
    also `ledger.json` and `ledger.csv` with a record for each claim, and `report.html`,
    which contains all figures and claims. Every file appears complete or not at all,
    and replaces a file of the same name.

    Args:
        only: Numbers of figures, to make these and nothing else.
        formats: The formats of figures: png, svg or pdf. With the report, svg is always
            written, because the report contains it.
        progress: Called with one line of text when a run or a figure is finished.
        runs: The runs to use; None: they are simulated here.

    Returns:
        The paths of all files; the report is the last.

    Raises:
        ValueError: If there is no such figure.
        OSError: If a file cannot be written.
        RuntimeError: If no program is installed that can lay out a block diagram.
    """
    figures = SelectFigures(only)
    runs = runs or ThesisRuns(progress)
    if only is None:
        formats = list(dict.fromkeys([*formats, "svg"]))
    paths = []
    commands = {}
    for figure in figures:
        # `used` collects the commands of the runs that this figure requests.
        runs.used.clear()
        paths += WritePicture(figure.make(runs), out / figure.stem, formats)
        commands[figure.number] = "\n".join(runs.used)
        progress(f"figure {figure.number}")
    if only is None:
        rows = Ledger(runs)
        records = [dataclasses.asdict(row) for row in rows]
        texts = {
            "ledger.json": json.dumps(records, indent=2, ensure_ascii=False) + "\n",
            "report.html": _Html(out, rows, commands),
        }
        paths.append(WriteCsv(out / "ledger.csv", records))
        for name, text in texts.items():
            WriteText(out / name, text)
            paths.append(out / name)
    return paths


def _Html(out: Path, rows: Sequence[Row], commands: Mapping[str, str]) -> str:
    """Returns the report; `commands` has the commands of each figure's runs."""
    counts = Counter(row.verdict for row in rows)
    tasks = dict.fromkeys(figure.task for figure in FIGURES.values() if figure.live)
    data = {"labs": [Laboratory(task, _ClaimsOf(task)) for task in tasks]}
    # The figures of each section, by the section's id.
    sections: dict[str, list[str]] = {"ledger": []}
    for number, figure in FIGURES.items():
        if figure.live:
            name = f"lab-{figure.task}"
            html = _LiveFigure(figure, rows, commands[number])
        else:
            name = f"chapter-{number[0]}"
            html = _Picture(out, figure, commands[number])
        sections.setdefault(name, []).append(html)
    buttons = {"": f"all {len(rows)} claims"}
    buttons |= {x: f"{counts[x]} {x}" for x in VERDICTS if counts[x]}
    template = (resources.files(__package__) / "report.html").read_text("utf-8")
    return Template(template).substitute(
        package=version("teleop-drake"),
        drake=version("drake"),
        style=ReadPart("base.css") + ReadPart("report.css"),
        contents="\n".join(
            f'<li><a href="#{name}">{title}</a></li>'
            for name, title in _TITLES.items()
            if name in sections
        ),
        filter="\n".join(
            f'<button value="{x}" aria-pressed="{not x!s}">{text}</button>'.lower()
            for x, text in buttons.items()
        ),
        labs=_Sections("lab", sections),
        rows=_Claims(_ROW, rows),
        chapters=_Sections("chapter", sections),
        data=PackedData(data),
        script=JoinModules("report.js"),
    )


def _ClaimsOf(task: str) -> list[Claim]:
    """Returns the claims that are shown beside the figures of a task."""
    numbers = {number for number, figure in FIGURES.items() if figure.task == task}
    return [claim for claim in CLAIMS if FigureOf(claim) in numbers]


_SECTIONS = {
    "lab": (
        '<section class="lab" id="{name}"><h2>{title}</h2>\n'
        '<div class="controls"></div>\n{figures}</section>'
    ),
    "chapter": '<section id="{name}"><h2>{title}</h2>{figures}</section>',
}
"""The sections with figures: of a task, with a place for its sliders, and a chapter."""


def _Sections(kind: str, sections: Mapping[str, Sequence[str]]) -> str:
    """Returns the sections of a kind, each with its figures."""
    return "\n".join(
        _SECTIONS[kind].format(
            name=name, title=_TITLES[name], figures="\n".join(figures)
        )
        for name, figures in sections.items()
        if name.startswith(kind)
    )


_ROW = (
    '<tr id="{key}" data-verdict="{verdict}"><td>{place}</td>'
    "<td>{claim}<br><small>{criterion}</small></td>"
    "<td>{thesis}</td><td>{ours}</td><td>{tolerance}</td>"
    '<td class="{style}">{judged}</td><td>{reason}{commands}</td></tr>'
)
"""A claim in the ledger."""

_CLAIM = (
    '<li id="claim-{key}" data-verdict="{verdict}">{claim} '
    '<b class="{style}">{judged}</b><br>'
    '<small>Thesis: {thesis}. Ours: {ours}. <a href="#{key}">Why</a></small>'
    '<p class="now"></p></li>'
)
"""A claim beside a live figure, with a place for its current verdict."""


def _Claims(template: str, rows: Sequence[Row]) -> str:
    """Returns claims with their verdicts, each formatted by a template."""
    items = []
    for row in rows:
        texts = {name: escape(x) for name, x in dataclasses.asdict(row).items()}
        texts |= {"style": row.verdict.split()[-1], "commands": _RunsHtml(row.runs)}
        texts["judged"] = escape(_Judged(row))
        items.append(template.format_map(texts))
    return "\n".join(items)


def _Judged(row: Row) -> str:
    """Returns a verdict, with the difference of our number from the thesis's."""
    return f"{row.verdict} ({row.difference})" if row.difference else row.verdict


def _LiveFigure(figure: ThesisFigure, rows: Sequence[Row], commands: str) -> str:
    """Returns a figure with its claims, and with a place for the plots of its runs."""
    own = [
        row
        for claim, row in zip(CLAIMS, rows, strict=True)
        if FigureOf(claim) == figure.number
    ]
    return (
        f'<figure id="{figure.stem}" data-signals="{",".join(figure.live)}">'
        f'<div class="said">{_CaptionHtml(figure, commands)}<ul>'
        + _Claims(_CLAIM, own)
        + '</ul></div><div class="live"></div></figure>'
    )


def _Picture(out: Path, figure: ThesisFigure, commands: str) -> str:
    """Returns a figure with its picture inside, so that the page needs no files."""
    data = base64.b64encode((out / f"{figure.stem}.svg").read_bytes()).decode()
    return (
        f'<figure id="{figure.stem}"><img alt="{_Title(figure)}" '
        f'src="data:image/svg+xml;base64,{data}">\n'
        f"{_CaptionHtml(figure, commands)}</figure>"
    )


def _Title(figure: ThesisFigure) -> str:
    return escape(f"Figure {figure.number}: {figure.title}")


def _CaptionHtml(figure: ThesisFigure, commands: str) -> str:
    return (
        f"<figcaption><strong>{_Title(figure)}.</strong> {escape(figure.caption)}"
        f"{_RunsHtml(commands)}</figcaption>"
    )


def _RunsHtml(commands: str) -> str:
    """Returns the commands of runs as a folded list, with a line for each."""
    if not commands:
        return ""
    lines = "<br>".join(
        f"<code>{escape(command)}</code>" for command in commands.splitlines()
    )
    return f"<details><summary>Runs</summary>{lines}</details>"

"""Reproduces the thesis: figures, ledger and a report in one HTML file."""

import base64
import csv
import dataclasses
import io
import json
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path

from teleop_drake.files import Replacing
from teleop_drake.thesis import studies
from teleop_drake.thesis.claims import requests
from teleop_drake.thesis.claims.claim import VERDICTS, Row
from teleop_drake.thesis.figures import FIGURES
from teleop_drake.thesis.figures.figure import ThesisFigure, WritePicture
from teleop_drake.thesis.ledger import FutureWork, Ledger
from teleop_drake.thesis.runs import ThesisRuns
from teleop_drake.thesis.studies import STUDIES
from teleop_drake.thesis.studies.study import Study
from teleop_drake.validation import Refuse

FORMATS = ("png", "svg")
"""What figures are written as, unless something else is asked for."""

_CHAPTERS = {
    "2": "The loop and the task",
    "3": "A network that learns a disturbance",
    "4": "One degree of freedom",
    "5": "Two degrees of freedom",
    "6": "Future work",
}


def SelectFigures(only: Sequence[str] | None = None) -> list[ThesisFigure]:
    """Returns figures by their numbers, in the thesis's order, then ours (6.1, ...).

    Args:
        only: Numbers such as "4.1"; None: all.

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
    jobs: int = 2,
    formats: Sequence[str] = FORMATS,
    progress: Callable[[str], None] | None = None,
) -> list[Path]:
    """Simulates what the thesis simulates and writes what comes out.

    Each figure becomes `figure_4_1.png` and the like. Without `only` there are also the
    figures of our own studies, `ledger.json` and `ledger.csv` with a record for each
    claim, and `report.html`, which contains all of it. Every file appears complete or
    not at all, and replaces one of the same name.

    Args:
        out: An existing folder.
        only: Numbers of figures, to make these and nothing else.
        jobs: Number of processes that simulate.
        formats: Of the figures: png, svg or pdf. The report is made of svg, which is
            therefore written with it in any case.
        progress: Called with one line of text when a run or a figure is finished,
            possibly from another thread.

    Returns:
        The paths of all files, the report being the last.

    Raises:
        ValueError: If there is no such figure, or jobs is less than 1.
        OSError: If a file cannot be written.
        RuntimeError: If nothing here can lay out a block diagram.
    """
    figures = SelectFigures(only)
    with ThesisRuns(jobs, progress) as runs:
        if only is None:
            return WriteReport(runs, out, formats, progress)
        return WriteFigures(runs, out, figures, formats, progress)


def WriteFigures(
    runs: ThesisRuns,
    out: Path,
    figures: Sequence[ThesisFigure],
    formats: Sequence[str] = FORMATS,
    progress: Callable[[str], None] | None = None,
) -> list[Path]:
    """Writes figures of the thesis, see Reproduce."""
    runs.Prefetch(request for figure in figures for request in figure.requests)
    paths: list[Path] = []
    for figure in figures:
        paths += WritePicture(figure.make(runs), out / figure.stem, formats)
        _Report(progress, f"figure {figure.number}")
    return paths


def WriteReport(
    runs: ThesisRuns,
    out: Path,
    formats: Sequence[str] = FORMATS,
    progress: Callable[[str], None] | None = None,
) -> list[Path]:
    """Writes all figures, the studies, the ledger and the report, see Reproduce."""
    formats = list(dict.fromkeys([*formats, "svg"]))
    figures = list(FIGURES.values())
    runs.Prefetch(request for figure in figures for request in figure.requests)
    # The workers go on with these while the figures are drawn.
    runs.Prefetch([*requests.REQUESTS, *studies.REQUESTS])
    paths = WriteFigures(runs, out, figures, formats, progress)
    results = []
    for make in STUDIES:
        study = make(runs)
        for name, picture in study.figures.items():
            paths += WritePicture(picture, out / f"study_{name}", formats)
        results.append(study)
        _Report(progress, study.title)
    rows = [*Ledger(runs), *FutureWork(runs)]
    texts = {
        "ledger.json": _LedgerJson(rows),
        "ledger.csv": _LedgerCsv(rows),
        "report.html": _Html(out, rows, results, _RunsHtml(runs)),
    }
    for name, text in texts.items():
        with Replacing(out / name) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="")
        paths.append(out / name)
    return paths


def _Report(progress: Callable[[str], None] | None, line: str) -> None:
    if progress is not None:
        progress(line)


def _LedgerJson(rows: Sequence[Row]) -> str:
    records = [dataclasses.asdict(row) for row in rows]
    return json.dumps(records, indent=2, ensure_ascii=False) + "\n"


def _LedgerCsv(rows: Sequence[Row]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([field.name for field in dataclasses.fields(Row)])
    writer.writerows(dataclasses.astuple(row) for row in rows)
    return text.getvalue()


# The report.

_STYLE = """
body { font: 16px/1.5 Georgia, "Times New Roman", serif; color: #1a1a1a;
  background: #fff; max-width: 62rem; margin: 0 auto; padding: 1.5rem; }
h1, h2, h3, nav, table, figcaption { font-family: "Helvetica Neue", Helvetica, Arial,
  sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; }
h2 { font-size: 1.3rem; margin-top: 3rem; border-bottom: 1px solid #999; }
h3 { font-size: 1.05rem; margin-top: 2rem; }
a { color: #0055a0; }
nav ul { list-style: none; padding: 0; columns: 2; }
nav a { text-decoration: none; }
figure { margin: 1.5rem 0 2.5rem; break-inside: avoid; }
figure img { width: 100%; max-height: 95vh; object-fit: contain; }
figcaption { font-size: 0.85rem; color: #333; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.8rem; line-height: 1.35; width: 100%; }
caption { text-align: left; padding: 0.3rem 0; }
th, td { text-align: left; vertical-align: top; padding: 0.35rem 0.5rem;
  border-bottom: 1px solid #ccc; }
th { border-bottom: 2px solid #555; }
tr { break-inside: avoid; }
td small { color: #555; }
#ledger th:nth-child(2), #ledger th:nth-child(7) { width: 27%; }
#ledger th:nth-child(4) { width: 17%; }
td[class] { font-weight: bold; }
td.reproduced { color: #00684a; }
td.kind { color: #0055a0; }
td.refuted { color: #a03c00; }
td.determinable { color: #555; }
@media print {
  @page { margin: 15mm; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  nav { display: none; }
  h2 { break-before: page; margin-top: 0; }
  #ledger h2 { break-before: auto; }
  .scroll { overflow: visible; }
  figure { margin: 0.5rem 0; }
  figure img { max-height: 105mm; }
}
"""

_TITLE = "Teleoperation under delay: the thesis of 2012, simulated again"

_INTRODUCTION = """
P. P. Sarda, <cite>Control of a Teleoperating Robotic Arm Subject to Time Delays</cite>,
MS thesis, The University of Texas at Arlington, 2012. Its figures have here the numbers
that they have there. Every curve and every number of ours comes from simulations done
when this file was made, by teleop-drake {package} with Drake {drake}. What the thesis
leaves open is a field of a scenario, marked there as assumed or fitted.
"""

_LEDGER_INTRODUCTION = """
One row for each claim, turned into something that can be measured; the verdicts are
computed from the runs. <em>Reproduced</em>: our number is within the tolerance, or the
criterion holds. <em>Reproduced in kind</em>: the number is another but what it stands
for holds, or what the thesis leaves open was fitted to it. <em>Refuted</em>: neither.
<em>Not determinable</em>: no run can decide.
"""

_OWN_CLAIMS = {
    "A-": (
        "Plain alternatives",
        "How much of that is owed to the adaptive controller: the same comparisons "
        "with a plain alternative. Here the claims are ours.",
    ),
    "F-": (
        "Future work",
        "What section 6.3 leaves to future work, and what the rows above leave open. "
        "Here too the claims are ours.",
    ),
}
"""By the beginning of their keys: title and introduction of the rows that are ours."""


def _Html(out: Path, rows: Sequence[Row], results: Sequence[Study], runs: str) -> str:
    sections = [("ledger", "Ledger of claims", _LedgerHtml(rows))]
    for chapter, title in _CHAPTERS.items():
        figures = [x for x in FIGURES.values() if x.number.startswith(f"{chapter}.")]
        html = "\n".join(_FigureHtml(out, figure) for figure in figures)
        sections.append((f"chapter-{chapter}", f"Chapter {chapter}: {title}", html))
    for i, study in enumerate(results, 1):
        sections.append((f"study-{i}", study.title, _StudyHtml(out, study)))
    sections.append(("runs", "Runs behind the figures", runs))
    introduction = _INTRODUCTION.format(
        package=version("teleop-drake"), drake=version("drake")
    )
    contents = "\n".join(
        f'<li><a href="#{anchor}">{escape(title)}</a></li>'
        for anchor, title, _ in sections
    )
    body = "\n".join(
        f'<section id="{anchor}"><h2>{escape(title)}</h2>\n{html}\n</section>'
        for anchor, title, html in sections
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{_TITLE}</title>
<style>{_STYLE}</style>
</head>
<body>
<h1>{_TITLE}</h1>
<p>{introduction}</p>
<nav><ul>
{contents}
</ul></nav>
{body}
</body>
</html>
"""


def _LedgerHtml(rows: Sequence[Row]) -> str:
    claims = [row for row in rows if not row.key.startswith(tuple(_OWN_CLAIMS))]
    counts = Counter(row.verdict for row in claims)
    summary = ", ".join(f"{counts[x]} {x}" for x in VERDICTS if counts[x])
    return "\n".join(
        [
            f"<p>{_LEDGER_INTRODUCTION}</p>",
            f"<p><strong>Of {len(claims)} claims: {summary}.</strong></p>",
            _ClaimsHtml(claims),
            *(
                f"<h3>{title}</h3>\n<p>{introduction}</p>\n"
                + _ClaimsHtml(row for row in rows if row.key.startswith(beginning))
                for beginning, (title, introduction) in _OWN_CLAIMS.items()
            ),
        ]
    )


def _ClaimsHtml(rows: Iterable[Row]) -> str:
    headers = ["Place", "Claim", "Thesis", "Ours", "Tolerance", "Verdict", "Why"]
    lines = []
    for row in rows:
        texts = {name: escape(x) for name, x in dataclasses.asdict(row).items()}
        lines.append(
            '<tr id="{key}"><td>{place}</td><td>{claim}<br><small>{criterion}</small>'
            "</td><td>{thesis}</td><td>{ours}</td><td>{tolerance}</td>"
            '<td class="{style}">{verdict}</td><td>{reason}</td></tr>'.format(
                style=row.verdict.split()[-1], **texts
            )
        )
    return _TableHtml(headers, lines)


def _FigureHtml(out: Path, figure: ThesisFigure) -> str:
    return _PictureHtml(
        out / f"{figure.stem}.svg",
        f"Figure {figure.number}: {figure.title}",
        figure.caption,
    )


def _PictureHtml(svg: Path, title: str, caption: str = "") -> str:
    """Returns a picture that brings its own data, so that the page needs no files."""
    data = base64.b64encode(svg.read_bytes()).decode()
    return (
        f'<figure id="{svg.stem}"><img alt="{escape(title)}" '
        f'src="data:image/svg+xml;base64,{data}">\n'
        f"<figcaption><strong>{escape(title)}.</strong> {escape(caption)}"
        "</figcaption></figure>"
    )


def _StudyHtml(out: Path, study: Study) -> str:
    paragraphs = (f"<p>{escape(text)}</p>" for text in study.text.split("\n\n"))
    pictures = (
        _PictureHtml(out / f"study_{name}.svg", name.replace("_", " ").capitalize())
        for name in study.figures
    )
    headers, rows = study.table
    tables = [_TableHtml(headers, map(_LineHtml, rows))] if rows else []
    return "\n".join([*paragraphs, *pictures, *tables])


def _TableHtml(headers: Sequence[str], lines: Iterable[str]) -> str:
    head = "".join(f"<th>{escape(header)}</th>" for header in headers)
    return (
        f'<div class="scroll"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n'
        + "\n".join(lines)
        + "\n</tbody></table></div>"
    )


def _LineHtml(cells: Iterable[object]) -> str:
    return f"<tr>{''.join(f'<td>{escape(str(cell))}</td>' for cell in cells)}</tr>"


def _RunsHtml(runs: ThesisRuns) -> str:
    """Returns a table of the runs that the figures show."""
    recordings = {}
    for figure in FIGURES.values():
        for name, overrides in figure.requests:
            options = "".join(f" --set {path}={x}" for path, x in overrides.items())
            recordings[f"teleop-drake run {name}{options}"] = runs(name, **overrides)
    return _TableHtml(
        ["Command", "End", "Simulated time [s]", "Solver, accuracy", "Steps"],
        (
            _LineHtml(
                (
                    command,
                    recording.termination,
                    f"{recording.time[-1]:.4g}",
                    f"{recording.solver.scheme}, {recording.solver.accuracy:g}",
                    recording.solver.steps,
                )
            )
            for command, recording in recordings.items()
        ),
    )

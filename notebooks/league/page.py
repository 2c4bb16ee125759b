"""The league's table in docs/architectures.md, and its sentences with their rows."""

import re

from league.claims import CLAIMS
from league.statistics import FOLDER, ReadTable, Row

PAGE = FOLDER.parents[1] / "teleop_drake/docs/architectures.md"

HEADER = (
    "architecture",
    "gains",
    "runs that come to rest (share)",
    "time from contact to rest (s)",
    "largest force (times a free mass's impact)",
    "time to the bone (times the commanded time)",
    "stiffness lost at 1 rad/s (share of the bone's)",
    "stiffness lost from 0.3 to 10 rad/s (share)",
    "error of the felt impedance (0 to 1)",
    "Z-width (decades)",
    "least Llewellyn parameter",
    "passive by design",
)

SHOWN = ("compromise", "gentlest", "quickest")
"""The members in the table; that of the rule is in the files only."""


def TableRows() -> list[list[str]]:
    """Returns the cells of each row of the table, in the order of HEADER."""
    felt = {
        (row["architecture"], row["member"]): row for row in ReadTable("league_felt")
    }
    # Members of an architecture with the same numbers have a line together.
    names: dict[tuple[str, ...], list[str]] = {}
    for row in ReadTable():
        if row["runs"] == "all" and row["member"] in SHOWN:
            cells = _Cells(row, felt[row["architecture"], row["member"]])
            names.setdefault(cells, []).append(row["member"])
    rows = []
    for (architecture, *cells, passive), members in names.items():
        is_first = members[0] == SHOWN[0]
        ends = (architecture, passive) if is_first else ("", "")
        rows.append([ends[0], ", ".join(members), *cells, ends[1]])
    return rows


def _Cells(row: Row, felt: Row) -> tuple[str, ...]:
    """Returns the cells of a member but for its name."""
    return (
        str(row["architecture"]),
        _WithInterval(row, "at_rest", "{:.1%}"),
        _WithInterval(row, "rest", "{:.2f}"),
        _WithInterval(row, "impact", "{:.2f}"),
        _WithInterval(row, "arrival", "{:.2f}"),
        f"{felt['loss_at_1']:.2f}",
        f"{felt['loss_in_band']:.2f}",
        f"{felt['impedance_error']:.2f}",
        f"{round(felt['z_width'], 1) + 0.0:.1f}",
        _Text(felt["llewellyn"], "{:.2f}"),
        str(felt["passive_by_design"]),
    )


def _WithInterval(row: Row, name: str, form: str) -> str:
    """Returns a number with its interval, as in `0.71 (0.66 to 0.84)`."""
    value, low, high = (
        _Text(row[f"{name}{end}"], form) for end in ("", "_low", "_high")
    )
    interval = f" ({low} to {high})" if low != high else ""
    return (value + interval).replace("%", " %")


def _Text(value: float, form: str) -> str:
    text = form.format(value)
    words = {"inf": "never", "-inf": "a port generates energy", "nan": "-"}
    return words.get(text, text)


def Section(name: str) -> str:
    """Returns the text of a part of the page: `table` or `sentences`."""
    if name == "table":
        lines = [HEADER, ["---"] * len(HEADER), *TableRows()]
        return "\n".join("| " + " | ".join(line) + " |" for line in lines)
    return "\n".join(f"* {claim.Sentence()}" for claim in CLAIMS)


_PART = re.compile(r"<!-- league: (\w+) -->\n(.*?)\n<!-- end -->", re.DOTALL)


def Parts(text: str) -> dict[str, str]:
    """Returns the parts of the page that are written here, as they stand in it."""
    return dict(_PART.findall(text))


def WritePage() -> None:
    """Writes the table and the sentences into the page."""

    def Write(part: re.Match[str]) -> str:
        name = part[1]
        return f"<!-- league: {name} -->\n{Section(name)}\n<!-- end -->"

    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(_PART.sub(Write, text), encoding="utf-8")

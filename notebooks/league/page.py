"""The league's parts of docs/architectures.md, and table.md with all rows."""

import re

from league.claims import CLAIMS
from league.statistics import FOLDER, ReadTable, Row

PAGE = FOLDER.parents[1] / "teleop_drake/docs/architectures.md"
TABLE = FOLDER / "table.md"

SHORT = (
    "architecture",
    "runs at rest",
    "time to rest [s]",
    "time to the bone",
    "largest force",
    "stiffness lost",
    "effort",
)
"""The heads of the table on the page."""

LEFT_OUT = ("robust", "waves to ground")
"""Entries that are in table.md only."""

HEADER = (
    "architecture",
    "gains",
    "runs that come to rest (share)",
    "time from contact to rest (s)",
    "largest force (times a free mass's impact)",
    "time to the bone (times the commanded time)",
    "effort (total variation of the force, times a free mass's impact)",
    "stiffness lost at 1 rad/s (share of 150, 300, 600 N/m)",
    "stiffness lost from 0.3 to 10 rad/s (share of 150, 300, 600 N/m)",
    "error of the felt impedance (0 to 1)",
    "Z-width (decades)",
    "least Llewellyn parameter",
    "passive by design",
)
"""The heads of table.md."""


def AtEdge() -> dict[str, str]:
    """Returns the gains that lie at an edge in some search, by architecture."""
    found: dict[str, dict[str, int]] = {}
    for row in ReadTable("league_search"):
        for gain in filter(None, str(row["at_edge"]).split(", ")):
            counts = found.setdefault(str(row["architecture"]), {})
            counts[gain] = counts.get(gain, 0) + 1
    return {
        name: ", ".join(f"{gain} in {n}" for gain, n in counts.items())
        for name, counts in found.items()
    }


def _Wider(name: str) -> str:
    """Returns what ranges twice as wide change in an architecture's time to rest."""
    rest = {
        row["member"]: _Text(row["rest"], "{:.2f}")
        for row in ReadTable()
        if row["architecture"] == name and row["runs"] == "all"
    }
    wider = rest["twice the range"]
    return f"; in ranges twice as wide {wider} s to rest, not {rest['compromise']}"


def ShortRows() -> list[list[str]]:
    """Returns the cells of the page's table: compromises, medians of all runs."""
    felt = _Felt()
    edges = AtEdge()
    rows = []
    for row in ReadTable():
        key = (str(row["architecture"]), row["member"])
        if row["runs"] != "all" or key[1] != "compromise" or key[0] in LEFT_OUT:
            continue
        cells = [key[0] + ("*" if key[0] in edges else "")]
        cells.append(f"{row['at_rest']:.1%}".replace("%", " %"))
        for name in ("rest", "arrival", "impact"):
            cells.append(_Text(row[name], "{:.2f}"))
        rows.append([*cells, f"{felt[key]['loss_at_1']:.2f}", f"{row['effort']:.1f}"])
    return rows


def TableRows() -> list[list[str]]:
    """Returns the cells of each row of table.md, in the order of HEADER."""
    felt = _Felt()
    rows = []
    for row in ReadTable():
        if row["runs"] == "all":
            key = (str(row["architecture"]), str(row["member"]))
            rows.append([*key, *_Cells(row, felt[key])])
    return rows


def _Felt() -> dict[tuple[str, str], Row]:
    """Returns the rows of league_felt.csv by architecture and member."""
    return {
        (row["architecture"], row["member"]): row for row in ReadTable("league_felt")
    }


def _Cells(row: Row, felt: Row) -> list[str]:
    """Returns the cells of a member but for its names."""
    lost = (
        ", ".join(f"{felt[name + bone]:.2f}" for bone in ("", "_300", "_600"))
        for name in ("loss_at_1", "loss_in_band")
    )
    return [
        _WithInterval(row, "at_rest", "{:.1%}"),
        *(_WithInterval(row, x, "{:.2f}") for x in ("rest", "impact", "arrival")),
        _WithInterval(row, "effort", "{:.1f}"),
        *lost,
        f"{felt['impedance_error']:.2f}",
        f"{round(felt['z_width'], 1) + 0.0:.1f}",
        _Text(felt["llewellyn"], "{:.2f}"),
        str(felt["passive_by_design"]),
    ]


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


def MarkdownTable(header: tuple[str, ...], rows: list[list[str]]) -> str:
    """Returns a table in Markdown."""
    lines = [list(header), ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def Section(name: str) -> str:
    """Returns the text of a part of the page: `sentences`, `table` or `edges`."""
    if name == "table":
        return MarkdownTable(SHORT, ShortRows())
    if name == "edges":
        edges = (f"{name} ({gains}{_Wider(name)})" for name, gains in AtEdge().items())
        return "\\* Gains at an edge of a range, in how many searches: " + (
            "; ".join(edges) + "." if AtEdge() else "none."
        )
    return "\n".join(f"* {claim.Sentence()}" for claim in CLAIMS)


def AllRows() -> str:
    """Returns the text of table.md."""
    return (
        "# All rows of the league, edition 3\n\n"
        "[README.md](README.md) explains the columns, with intervals of 95 %.\n\n"
        + MarkdownTable(HEADER, TableRows())
        + "\n"
    )


_PART = re.compile(r"<!-- league: (\w+) -->\n(.*?)\n<!-- end -->", re.DOTALL)


def Parts(text: str) -> dict[str, str]:
    """Returns the parts of the page that are written here, as they stand in it."""
    return dict(_PART.findall(text))


def WritePage() -> None:
    """Writes the parts of the page, and table.md."""

    def Write(part: re.Match[str]) -> str:
        name = part[1]
        return f"<!-- league: {name} -->\n{Section(name)}\n<!-- end -->"

    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(_PART.sub(Write, text), encoding="utf-8")
    TABLE.write_text(AllRows(), encoding="utf-8")

"""Text as rows of cells: the separator, the decimal comma, comments and the header.

pandas.read_csv() is not used: it fills rows that are too short in silence, and needs to
be told the separator and the decimal mark.
"""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from teleop_drake.loops.framework.validation import ScenarioError, Show
from teleop_drake.model.tables.headers import UNITS, CleanUnit

# The separators, the most certain first. A decimal comma is less certain than a comma
# that separates; blanks also stand within dates.
_SEPARATORS = ("\t", ";", "|", ",")

# The number of lines from which the separator is inferred.
_INSPECTED = 100

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)
_POINT_NUMBER = re.compile(r"[+-]?\d*\.\d+(e[+-]?\d+)?", re.IGNORECASE)
# A date or a time of day.
# `1,234` in a table that commas divide may be one or a thousand.
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
# Excel's first line that tells the separator.
_TELLS_SEPARATOR = re.compile(r"sep=.", re.IGNORECASE)
_STAMP = re.compile(r"\d{1,4}[-/.:]\d{1,2}[-/.:]\d")


@dataclass(kw_only=True)
class Cells:
    """The cells of a text.

    Attributes:
        header: The names of the columns; empty if there is no header.
        rows: The cells, all rows of the same length.
        lines: The number of each row's line in the file, from 1.
        comments: The comments without their mark.
        units: The units from a second line of the header, by the column's place.
    """

    header: list[str]
    rows: list[list[str]]
    lines: list[int]
    comments: list[str]
    units: dict[int, str] = field(default_factory=dict)


def SplitText(text: str, origin: str) -> Cells:
    """Returns the cells of a text.

    Empty lines, and lines that begin with `#` or `%`, are no rows. If the first row is
    no header, the last comment before it is one if it has a word for each column.

    Raises:
        ScenarioError: If there is no row, or if rows have different numbers of cells.
    """
    lines: list[int] = []
    texts: list[str] = []
    comments: list[str] = []
    last_comment = ""
    for number, line in enumerate(text.splitlines(), 1):
        stripped = line.strip()
        if stripped[:1] in ("#", "%"):
            comments.append(stripped[1:].strip())
            last_comment = last_comment if texts else comments[-1]
        elif stripped and not (number == 1 and _TELLS_SEPARATOR.fullmatch(stripped)):
            lines.append(number)
            texts.append(line)
    if not texts:
        raise ScenarioError(f"{origin}: must have rows, and has none")
    separator = _FindSeparator(texts[:_INSPECTED])
    rows = _SplitLines(texts, separator)
    header: list[str] = []
    if IsHeader(rows[0]):
        header = rows.pop(0)
        del lines[0]
        del texts[0]
    elif last_comment:
        (words,) = _SplitLines([last_comment], separator)
        header = words if len(words) == len(rows[0]) and IsHeader(words) else []
    _CheckWidths(rows, lines, texts, header, origin)
    units = _UnitsRow(rows, header)
    if units:
        del rows[0]
        del lines[0]
    if not rows:
        raise ScenarioError(f"{origin}: must have rows, and has only a header")
    _ReplaceDecimalComma(rows, separator, origin)
    return Cells(header=header, rows=rows, lines=lines, comments=comments, units=units)


def IsHeader(cells: Sequence[str]) -> bool:
    """Returns whether cells are names: none is a number or a date, one has a letter."""
    filled = [cell.strip() for cell in cells if cell.strip()]
    has_values = any(
        _NUMBER.fullmatch(x)
        or _COMMA_NUMBER.fullmatch(x)
        or _STAMP.match(x)
        or x.lower().lstrip("+-") in ("nan", "inf", "infinity")
        for x in filled
    )
    return not has_values and any(re.search(r"[^\W\d_]", x) for x in filled)


def _FindSeparator(lines: Sequence[str]) -> str:
    """Returns the separator of the columns; a blank stands for any white space."""
    consistent = {}
    for separator in _SEPARATORS:
        widths = {len(row) for row in _SplitLines(lines, separator)}
        if len(widths) == 1 and widths != {1}:
            consistent[separator] = widths
    blank = _SplitLines(lines, " ")
    widths = {len(row) for row in blank}
    has_blanks = len(widths) == 1 and widths != {1}
    if "," in consistent and has_blanks and len(consistent) == 1:
        # `0,5 1,2` has two numbers with decimal commas. The first row may be a header.
        cells = [cell for row in blank[1:] or blank for cell in row]
        if all(_COMMA_NUMBER.fullmatch(x) or _NUMBER.fullmatch(x) for x in cells):
            return " "
    if consistent:
        return next(iter(consistent))
    if has_blanks:
        return " "
    wide = {len(row) for row in _SplitLines(lines, "  ")}
    if len(wide) == 1 and wide != {1}:
        return "  "
    # No separator fits every line: the one of most lines, so that a message names the
    # line that it does not fit.
    counts = {x: sum(x in line for line in lines) for x in _SEPARATORS}
    best = max(counts, key=counts.__getitem__)
    return best if counts[best] else " "


def _SplitLines(lines: Sequence[str], separator: str) -> list[list[str]]:
    if separator == " ":
        return [
            [x.strip('"') for x in re.findall(r'"[^"]*"|\S+', line)] for line in lines
        ]
    if separator == "  ":  # `Time [s]   RTT [ms]`
        return [re.split(r"\s{2,}", line.strip()) for line in lines]
    return [[cell.strip() for cell in _SplitLine(x, separator)] for x in lines]


def _SplitLine(line: str, separator: str) -> list[str]:
    """Returns the cells of a line; a quote that is never closed spoils only this."""
    if '"' not in line:
        return line.split(separator)
    try:
        (row,) = csv.reader(
            [line], delimiter=separator, skipinitialspace=True, strict=True
        )
    except (csv.Error, ValueError):
        return line.split(separator)
    return row


def _CheckWidths(
    rows: Sequence[Sequence[str]],
    lines: Sequence[int],
    texts: Sequence[str],
    header: Sequence[str],
    origin: str,
) -> None:
    """Refuses rows with another number of cells than the header or the first row."""
    width = len(header or rows[0]) if rows else 0
    for row, number, text in zip(rows, lines, texts, strict=True):
        if len(row) != width:
            named = f", {', '.join(header)}" if header else ""
            raise ScenarioError(
                f"{origin}: line {number}, {Show(text.strip())}: must have {width} "
                f"cells{named}, and has {len(row)}"
            )


def _UnitsRow(rows: Sequence[Sequence[str]], header: Sequence[str]) -> dict[int, str]:
    """Returns the units of a row below the header that consists of units."""
    if not header or not rows:
        return {}
    cells = [CleanUnit(cell.strip("[]() ")) for cell in rows[0]]
    units = {i: cell for i, cell in enumerate(cells) if cell}
    return units if units and all(x in UNITS for x in units.values()) else {}


def _ReplaceDecimalComma(
    rows: Sequence[list[str]], separator: str, origin: str
) -> None:
    """Replaces the decimal comma, in place, if the text has one and no point.

    Raises:
        ScenarioError: If it may be a comma between thousands, as where no semicolons
            divide the columns and each number has three digits behind its comma.
    """
    with_comma = []
    for row in rows:
        for cell in row:
            if "," in cell and _COMMA_NUMBER.fullmatch(cell):
                with_comma.append(cell)
            elif "." in cell and _POINT_NUMBER.fullmatch(cell):
                return
    if not with_comma:
        return
    if separator != ";" and all(map(_THOUSANDS.fullmatch, with_comma)):
        whole = with_comma[0].replace(",", "")
        raise ScenarioError(
            f"{origin}: {Show(with_comma[0])}: must be clear, and may be {whole} or "
            f"{with_comma[0].replace(',', '.')}; write it without a comma"
        )
    for row in rows:
        for i, cell in enumerate(row):
            if _COMMA_NUMBER.fullmatch(cell):
                row[i] = cell.replace(",", ".")

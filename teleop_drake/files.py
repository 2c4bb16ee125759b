"""Files that are read with one clear line if they cannot, or written completely."""

import math
import os
import re
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.validation import ScenarioError, Show

FIGURE_FORMATS = ("png", "svg", "pdf")
"""Formats in which figures are written: known without Matplotlib's import."""

# Enough for a trace of ten million packets. A device such as /dev/zero has no end.
_MAX_CHARACTERS = 300_000_000


@contextmanager
def Replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yields a temporary file name whose file becomes `path` when all went well.

    It has the suffix of `path` and stands in the same folder. A link stays a link, and
    a device such as /dev/null is written to directly.

    Raises:
        OSError: If it cannot be written.
    """
    path = Path(os.path.realpath(path))
    if IsDevice(path):
        yield path
        return
    temporary = TemporaryPath(path)
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        if error.filename != str(temporary):
            raise
        # Name the file that was asked for.
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        temporary.unlink(missing_ok=True)


def WriteText(path: Path, text: str) -> None:
    """Writes a text file, complete or not at all."""
    with Replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def FileStem(text: str) -> str:
    """Returns a text as part of a file's name: `my_module:MyLaw` has a colon."""
    return re.sub(r"[^\w.=-]+", "_", text)


def IsDevice(path: Path) -> bool:
    """Returns whether a path exists and is no file, like /dev/null."""
    return path.exists() and not path.is_file()


def TemporaryPath(path: Path) -> Path:
    """Returns a name beside `path` for what is not complete yet."""
    return path.with_name(f".{path.name}.{os.getpid()}{path.suffix}")


def ReadRows(path: str | os.PathLike[str], origin: str) -> list[tuple[int, str]]:
    """Returns the lines of a text file by their numbers, no empty ones, no comments."""
    lines = enumerate(ReadText(path, origin).splitlines(), 1)
    return [(i, line) for i, line in lines if line.strip() and line[0] != "#"]


def ReadNumbers(
    rows: Sequence[tuple[int, str]],
    origin: str,
    columns: Sequence[str],
    *,
    missing: Collection[str] = (),
    least_step: float = -math.inf,
) -> Array:
    """Returns lines of numbers with commas between them as a table (N, k).

    Args:
        rows: The lines by their numbers, as ReadRows() returns them.
        columns: What the k columns are, for messages.
        missing: Cells behind the first one that stand for NaN.
        least_step: How much larger than in the line before the first number is at
            least.

    Raises:
        ScenarioError: If a line has another number of cells, one that is no finite
            number, or too small a step; `origin` says whose file it is.
    """
    table: list[list[float]] = []
    for number, line in rows:
        row = _NumbersOf(line, missing)
        allowed = ""
        if len(row) != len(columns):
            allowed = f"{','.join(columns)}, finite numbers"
        elif table and row[0] < table[-1][0] + least_step:
            allowed = f"later than the line before, {table[-1][0]:g}"
        if allowed:
            raise ScenarioError(
                f"{origin}: line {number}, {Show(line)}: must be {allowed}"
            )
        table.append(row)
    return np.array(table).reshape(-1, len(columns))


def _NumbersOf(line: str, missing: Collection[str]) -> list[float]:
    """Returns the numbers of a line; none if one of them is not finite."""
    numbers = []
    for k, cell in enumerate(line.split(",")):
        text = cell.strip().lower()
        if k > 0 and text in missing:
            numbers.append(math.nan)
            continue
        try:
            number = float(text)
        except ValueError:
            return []
        if not math.isfinite(number):
            return []
        numbers.append(number)
    return numbers


def ReadText(path: str | os.PathLike[str], origin: str) -> str:
    """Returns the text of a file in UTF-8, with a byte-order mark or without.

    Raises:
        ScenarioError: If it cannot be read; `origin` says whose file it is.
    """
    try:
        with open(path, encoding="utf-8-sig") as stream:
            text = stream.read(_MAX_CHARACTERS + 1)
    except (OSError, ValueError) as e:
        reason = getattr(e, "strerror", None) or "not UTF-8 text"
        raise ScenarioError(f"{origin}: must be readable ({reason})") from None
    if len(text) > _MAX_CHARACTERS:
        raise ScenarioError(f"{origin}: must have at most {_MAX_CHARACTERS} characters")
    return text

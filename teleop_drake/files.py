"""Reads text files with one-line error messages, and writes files atomically."""

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
"""File formats of figures, listed here to avoid the import of Matplotlib."""

MAX_CHARACTERS = 300_000_000
"""The longest text that is read: a trace of ten million packets is shorter. Without a
limit, a device such as /dev/zero would be read for ever."""


@contextmanager
def Replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yields a temporary path, whose file replaces `path` if no error is raised.

    The temporary file is in the same folder and has the same suffix. If `path` is a
    symbolic link, the file to which it points is replaced. A device such as /dev/null
    is written to directly.

    Raises:
        OSError: If the file cannot be written.
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
        # The message names `path` instead of the temporary file.
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        temporary.unlink(missing_ok=True)


def WriteText(path: Path, text: str) -> None:
    """Writes a text file completely or, after an error, not at all."""
    with Replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def FileStem(text: str) -> str:
    """Returns a text for use in a file name, with `_` for characters such as `:`."""
    return re.sub(r"[^\w.=-]+", "_", text)


def IsDevice(path: Path) -> bool:
    """Returns whether a path exists and is no regular file, such as /dev/null."""
    return path.exists() and not path.is_file()


def TemporaryPath(path: Path) -> Path:
    """Returns a path in the folder of `path` for its incomplete contents."""
    return path.with_name(f".{path.name}.{os.getpid()}{path.suffix}")


def ReadRows(path: str | os.PathLike[str], origin: str) -> list[tuple[int, str]]:
    """Returns the numbered lines of a text file without empty lines and comments."""
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
    """Returns lines of comma-separated numbers as a table (N, k).

    Args:
        rows: The numbered lines, as ReadRows() returns them.
        origin: The beginning of messages, which says whose file it is.
        columns: The names of the k columns, for messages.
        missing: Texts in lower case that stand for NaN, except in the first column.
        least_step: The least increase of the first column from line to line.

    Raises:
        ScenarioError: If a line has another number of cells, has a cell that is not a
            finite number, or increases the first column too little.
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
    """Returns the numbers of a line; an empty list if a cell is no finite number."""
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
    """Returns the text of a UTF-8 file, with or without a byte-order mark.

    Raises:
        ScenarioError: If the file cannot be read or is too long; the message begins
            with `origin`.
    """
    try:
        with open(path, encoding="utf-8-sig") as stream:
            text = stream.read(MAX_CHARACTERS + 1)
    except (OSError, ValueError) as e:
        reason = getattr(e, "strerror", None) or "not UTF-8 text"
        raise ScenarioError(f"{origin}: must be readable ({reason})") from None
    if len(text) > MAX_CHARACTERS:
        raise ScenarioError(f"{origin}: must have at most {MAX_CHARACTERS} characters")
    return text

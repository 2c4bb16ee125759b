"""Reads text files with one-line error messages, and writes files atomically."""

import gzip
import io
import os
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from teleop_drake.loops.framework.validation import ScenarioError

FIGURE_FORMATS = ("png", "svg", "pdf")
"""File formats of figures, listed here to avoid the import of Matplotlib."""

# The longest file that is read: a trace of ten million packets is shorter. Without a
# limit, a device such as /dev/zero would be read for ever.
_MAX_BYTES = 300_000_000


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


def ReadText(path: str | os.PathLike[str], origin: str) -> str:
    """Returns the text of a UTF-8 file, with or without a byte-order mark.

    Raises:
        ScenarioError: If the file cannot be read or is too long; the message begins
            with `origin`.
    """
    try:
        text = ReadBytes(path, origin).decode("utf-8-sig")
    except UnicodeError:
        raise ScenarioError(f"{origin}: must be readable (not UTF-8 text)") from None
    # As Python's text files: each kind of line end becomes a newline.
    return text.replace("\r\n", "\n").replace("\r", "\n")


def ReadBytes(path: str | os.PathLike[str], origin: str) -> bytes:
    """Returns the contents of a file.

    Raises:
        ScenarioError: If the file cannot be read or is too long; the message begins
            with `origin`.
    """
    data = ReadStart(path, origin, _MAX_BYTES + 1)
    if len(data) > _MAX_BYTES:
        raise ScenarioError(f"{origin}: must have at most {_MAX_BYTES} bytes")
    return data


def Unzipped(data: bytes, origin: str) -> bytes:
    """Returns the contents of a file that gzip has compressed.

    Raises:
        ScenarioError: If it is damaged or too long.
    """
    try:
        with gzip.open(io.BytesIO(data)) as stream:
            contents = stream.read(_MAX_BYTES + 1)
    except (EOFError, OSError, zlib.error) as error:
        raise ScenarioError(f"{origin}: must be a .gz file ({error})") from None
    if len(contents) > _MAX_BYTES:
        raise ScenarioError(f"{origin}: must have at most {_MAX_BYTES} bytes")
    return contents


def ReadStart(path: str | os.PathLike[str], origin: str, size: int) -> bytes:
    """Returns the first bytes of a file; an error begins with `origin`."""
    try:
        with open(path, "rb") as stream:
            return stream.read(size)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "no name of a file"
        raise ScenarioError(f"{origin}: must be readable ({reason})") from None

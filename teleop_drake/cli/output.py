"""Writes the results of commands. Every file appears complete or not at all."""

import argparse
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from teleop_drake.cli.exit_codes import BadInput
from teleop_drake.loops.framework.files import IsDevice, TemporaryPath
from teleop_drake.loops.framework.files import WriteText as WriteText
from teleop_drake.loops.framework.validation import Refuse

HTML = (".html", ".htm")
"""The suffixes of pages."""


def PrepareFolder(folder: str | None, *names: str) -> list[Path]:
    """Makes a folder, checks that files can be written there, and returns their paths.

    Without a folder nothing is made or checked, because the command writes no files.

    Raises:
        ScenarioError: If the folder cannot be made.
        BadInput: If a file cannot be written.
    """
    paths = [Path(folder or "") / name for name in names]
    if folder is None:
        return paths
    try:
        os.makedirs(folder, exist_ok=True)
    except (OSError, ValueError) as e:
        reason = getattr(e, "strerror", None) or e
        Refuse("--out", folder, f"a folder that can be written ({reason})")
    for path in paths:
        _CheckWritable(path, f"--out = {folder!r}")
    return paths


def CheckFile(file: str | None, option: str, *suffixes: str) -> None:
    """Raises BadInput if a file cannot be written; None is allowed.

    Args:
        file: The file, or a device.
        option: The option that names it, for messages.
        suffixes: What the name of a file has to end in; empty: anything.
    """
    if file is None:
        return
    path = Path(file)
    if suffixes and path.suffix not in suffixes and not IsDevice(path):
        raise BadInput(f"{option} = {file!r}: must end in {' or '.join(suffixes)}")
    _CheckWritable(path, f"{option} = {file!r}")


def CheckJson(file: str | None) -> None:
    """Raises BadInput if --json cannot be written; "-" and None are allowed."""
    if file != "-":
        CheckFile(file, "--json")


def _CheckWritable(path: Path, option: str) -> None:
    """Raises BadInput if a trial to create a file at a path fails."""
    try:
        if path.is_dir():
            raise IsADirectoryError(None, "Is a directory")
        if IsDevice(path):
            with open(path, "a"):
                return
        temporary = TemporaryPath(path)
        temporary.touch()
        temporary.unlink()
    except (OSError, ValueError) as e:
        reason = getattr(e, "strerror", None) or e
        raise BadInput(
            f"{option}: must be where {path.name!r} can be written ({reason})"
        ) from None


def OpenInBrowser(page: str, name: str) -> None:
    """Writes a page into a temporary folder, and opens it in the browser."""
    import tempfile
    import webbrowser

    path = Path(tempfile.mkdtemp(prefix="teleop-drake-")) / name
    WriteText(path, page)
    has_browser = webbrowser.open(path.as_uri())
    print("Opened:" if has_browser else "Open in a browser:", path)


def ToJson(value: Any) -> str:
    """Returns a value as JSON text that ends with a line break."""
    # JSON has no NaN, and RunSummary() contains none.
    return json.dumps(value, indent=2, allow_nan=False) + "\n"


def WriteJson(file: str, value: Any) -> None:
    """Writes a value as JSON to a file, or to stdout if the file is "-"."""
    if file == "-":
        print(ToJson(value), end="")
    else:
        WriteText(Path(file), ToJson(value))


def Tell(
    args: argparse.Namespace, record: Any, *texts: str, written: Iterable[object] = ()
) -> None:
    """Writes a record to --json, and prints texts and the names of written files.

    With `--json -` only the record is printed.
    """
    if args.json is not None:
        WriteJson(args.json, record)
    if args.json != "-":
        print(*texts, sep="\n")
        files = ", ".join(map(str, written))
        if files:
            print("Written:", files)

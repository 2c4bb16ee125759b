"""The folder of a sweep, from which it can be resumed.

The folder contains

* `sweep.json`: the scenario, the grid, the engine and the versions of the packages, so
  that --resume can check whether it is the same sweep;
* `runs.jsonl`: one record per line, added as each run ends, and sorted into the order
  of the grid when all runs have ended;
* `runs.csv`: the scalar metrics, one row per run, written when all runs have ended;
* with seeds, `statistics.csv` and `differences.csv`: medians, shares and differences
  over the seeds; see Statistics and Differences.

The contents do not depend on when or in which order runs were simulated: a sweep that
was killed and resumed leaves the same bytes as an uninterrupted one. Therefore the
records lack the wall times that RunSummary has.
"""

import contextlib
import csv
import fcntl
import functools
import importlib.metadata
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.framework.files import Replacing, WriteText
from teleop_drake.study.sweep.any_plan import AnyPlan
from teleop_drake.study.sweep.result import SweepError, SweepResult
from teleop_drake.study.sweep.statistics import Differences, HasSeeds, Statistics
from teleop_drake.study.sweep.values import Notice


class SweepFolder:
    """A folder with a sweep, which one process at a time may use.

    Attributes:
        records: The records in the folder when it was opened, by the number of the run.

    Args:
        path: The folder, which is made if it does not exist.
        plan: The sweep.
        resume: Whether the folder may hold the same sweep already.
        notice: Called with a line of text if a torn record is dropped.
        stack: The stack whose end closes and unlocks the folder.

    Raises:
        SweepError: If the folder cannot be used.
    """

    def __init__(
        self,
        path: Path,
        plan: AnyPlan[Any],
        resume: bool,
        notice: Notice,
        stack: contextlib.ExitStack,
    ):
        self._path = path
        self._title = f"out = {str(path)!r}"
        self._runs = path / "runs.jsonl"
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._Lock(stack)
            self._CheckParameters(plan, resume)
        except OSError as error:
            self._Refuse(f"must be a folder that can be written ({error.strerror})")
        self.records = self._ReadRecords(notice)

    def Append(self, record: Record) -> None:
        """Adds a record by one system call, which a kill can hardly interrupt."""
        line = _JsonLine(record).encode()
        with open(self._runs, "ab", buffering=0) as journal:
            if journal.write(line) != len(line):
                raise OSError(None, "disk full", str(self._runs))

    def Finish(self, result: SweepResult) -> None:
        """Puts the records into the order of the grid, and writes the tables."""
        WriteText(self._runs, "".join(map(_JsonLine, result.records)))
        WriteTables(result, self._path)

    def _Refuse(self, reason: str) -> NoReturn:
        raise SweepError(f"{self._title}: {reason}") from None

    def _Lock(self, stack: contextlib.ExitStack) -> None:
        descriptor = os.open(self._path, os.O_RDONLY)
        stack.callback(os.close, descriptor)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._Refuse("in use by another sweep")

    def _CheckParameters(self, plan: AnyPlan[Any], resume: bool) -> None:
        """Writes the parameters of a new sweep, or compares those of an old one."""
        parameters = {
            "axes": plan.axes,
            **plan.Parameters(),
            "engine": plan.engine,
            "versions": Versions(),
        }
        text = json.dumps(parameters, indent=2)
        file = self._path / "sweep.json"
        if not file.exists():
            if self._runs.exists():
                self._Refuse(
                    "must be a folder without the runs.jsonl of something else"
                )
            WriteText(file, f"{text}\n")
            return
        if not resume:
            self._Refuse("holds a sweep already; resume it, or choose another folder")
        mine = json.loads(text)
        theirs = json.loads(file.read_bytes())
        different = [key for key in mine | theirs if theirs.get(key) != mine.get(key)]
        if different:
            self._Refuse(
                f"holds a sweep with other parameters ({', '.join(different)}), which "
                "cannot be resumed by this one"
            )

    def _ReadRecords(self, notice: Notice) -> dict[int, Record]:
        """Reads the records, and discards an incomplete last line after a kill."""
        self._runs.touch()
        text = self._runs.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            notice(f"{self._title}: the run that was killed is done again")
            WriteText(self._runs, whole)
        records = map(json.loads, whole.splitlines())
        return {record["run"]: record for record in records}


@functools.cache
def Versions() -> dict[str, str]:
    """Returns the versions of the packages on which the results of runs depend."""
    versions = {}
    for package in ("teleop-drake", "drake", "numpy", "llvmlite"):
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:  # Run without installation.
            versions[package] = "none"
    return versions


def _JsonLine(record: Mapping[str, Any]) -> str:
    return json.dumps(record, allow_nan=False) + "\n"


def WriteTables(result: SweepResult, folder: Path, prefix: str = "") -> list[Path]:
    """Writes the tables of a sweep as CSV files; returns their paths.

    Args:
        result: The sweep.
        folder: The folder of the files.
        prefix: The beginning of the files' names.
    """
    tables = {"runs": result.Table()}
    if HasSeeds(result):
        tables |= {"statistics": Statistics(result), "differences": Differences(result)}
    return [
        WriteCsv(folder / f"{prefix}{name}.csv", table)
        for name, table in tables.items()
        if table
    ]


def WriteCsv(path: Path, table: list[Record]) -> Path:
    """Writes rows with equal keys as a CSV file; returns its path."""
    with (
        Replacing(path) as temporary,
        open(temporary, "w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.DictWriter(file, table[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: _Cell(x) for key, x in row.items()} for row in table)
    return path


def _Cell(value: Any) -> Any:
    """Returns a cell of a CSV file: booleans, lists and dicts are written as JSON."""
    return json.dumps(value) if isinstance(value, bool | list | dict) else value

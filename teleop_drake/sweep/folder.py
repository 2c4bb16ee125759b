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
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from teleop_drake.arrays import Record
from teleop_drake.files import Replacing
from teleop_drake.scenario import ScenarioToYaml
from teleop_drake.sweep.plan import SweepPlan
from teleop_drake.sweep.result import SweepError, SweepResult
from teleop_drake.sweep.statistics import CONTROLLERS, Differences, HasSeeds, Statistics
from teleop_drake.sweep.values import Notice


class SweepFolder:
    """A folder with a sweep, which one process at a time may use.

    Attributes:
        records: The records in the folder when it was opened, by the number of the run.

    Args:
        path: The folder, which is made if it does not exist.
        plan: The sweep.
        resume: Whether the folder may hold the same sweep already.
        notice: Called with a line of text if a torn record is dropped.

    Raises:
        SweepError: When the context is entered, if the folder cannot be used.
    """

    def __init__(
        self,
        path: Path,
        plan: SweepPlan,
        resume: bool,
        notice: Notice,
    ):
        self._path = path
        self._notice = notice
        self._plan = plan
        self._resume = resume
        self.records: dict[int, Record] = {}

    def __enter__(self) -> "SweepFolder":
        """Locks the folder, checks its sweep, reads its records, opens its journal."""
        self._stack = contextlib.ExitStack()
        with contextlib.ExitStack() as stack:  # An error on the way closes everything.
            try:
                self._path.mkdir(parents=True, exist_ok=True)
                self._Lock(stack)
                self._CheckParameters()
            except OSError as error:
                raise SweepError(
                    f"{self._Title()}: must be a folder that can be written "
                    f"({error.strerror})"
                ) from None
            self._ReadRecords()
            journal = open(self._path / "runs.jsonl", "ab", buffering=0)
            self._journal = stack.enter_context(journal)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *args: object) -> None:
        self._stack.close()

    def Append(self, record: Record) -> None:
        """Adds a record by one system call, which a kill can hardly interrupt."""
        line = _JsonLine(record).encode()
        if self._journal.write(line) != len(line):
            raise OSError(None, "disk full", str(self._path / "runs.jsonl"))

    def Finish(self, result: SweepResult) -> None:
        """Puts the records into the order of the grid, and writes the tables."""
        self._Write("runs.jsonl", "".join(map(_JsonLine, result.records)))
        WriteTables(result, self._path)

    def _Title(self) -> str:
        return f"out = {str(self._path)!r}"

    def _Lock(self, stack: contextlib.ExitStack) -> None:
        descriptor = os.open(self._path, os.O_RDONLY)
        stack.callback(os.close, descriptor)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise SweepError(f"{self._Title()}: in use by another sweep") from None

    def _CheckParameters(self) -> None:
        """Writes the parameters of a new sweep, or compares those of an old one."""
        mine = _Parameters(self._plan)
        file = self._path / "sweep.json"
        if not file.exists():
            if (self._path / "runs.jsonl").exists():
                raise SweepError(
                    f"{self._Title()}: must be a folder without the runs.jsonl of "
                    "something else"
                )
            self._Write("sweep.json", json.dumps(mine, indent=2) + "\n")
            return
        if not self._resume:
            raise SweepError(
                f"{self._Title()}: holds a sweep already; resume it, or choose another "
                "folder"
            )
        theirs = json.loads(file.read_bytes())
        different = [key for key in mine | theirs if theirs.get(key) != mine.get(key)]
        if different:
            raise SweepError(
                f"{self._Title()}: holds a sweep with other parameters "
                f"({', '.join(different)}), which cannot be resumed by this one"
            )

    def _ReadRecords(self) -> None:
        """Reads the records, and discards an incomplete last line after a kill."""
        file = self._path / "runs.jsonl"
        text = file.read_text(encoding="utf-8") if file.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        for line in whole.splitlines():
            record = json.loads(line)
            self.records[record["run"]] = record
        if whole != text:
            self._notice(f"{self._Title()}: the run that was killed is done again")
            self._Write("runs.jsonl", whole)

    def _Write(self, name: str, text: str) -> None:
        with Replacing(self._path / name) as temporary:
            temporary.write_text(text, encoding="utf-8")


@functools.cache
def Versions() -> dict[str, str]:
    """Returns the versions of the packages on which the results of runs depend."""
    versions = {}
    for package in ("teleop-drake", "drake", "numpy", "llvmlite"):
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:  # It may run uninstalled.
            versions[package] = "none"
    return versions


def _Parameters(plan: SweepPlan) -> Record:
    """Returns the parameters that identify a sweep, as JSON returns them."""
    parameters = {
        "scenario": plan.scenario.name,
        "overrides": plan.overrides,
        "axes": plan.axes,
        "first_scenario": ScenarioToYaml(plan.scenario),
        "engine": plan.engine,
        "versions": Versions(),
    }
    if plan.traces:
        parameters["traces"] = plan.traces
    return dict(json.loads(json.dumps(parameters)))


def _JsonLine(record: Mapping[str, Any]) -> str:
    return json.dumps(record, allow_nan=False) + "\n"


def TableNames(result: SweepResult) -> list[str]:
    """Returns the names of the CSV files in the folder of a finished sweep."""
    if not HasSeeds(result):
        return ["runs.csv"]
    has_pairs = any(len(result.axes.get(key, [])) > 1 for key in CONTROLLERS)
    return ["runs.csv", "statistics.csv", *["differences.csv"] * has_pairs]


def WriteTables(result: SweepResult, folder: Path, prefix: str = "") -> list[Path]:
    """Writes the tables of a sweep as CSV files; returns their paths.

    Args:
        result: The sweep.
        folder: The folder of the files.
        prefix: The beginning of the files' names.
    """
    makers: dict[str, Callable[[SweepResult], list[Record]]] = {
        "runs.csv": SweepResult.Table,
        "statistics.csv": Statistics,
        "differences.csv": Differences,
    }
    paths = []
    for name in TableNames(result):
        table = makers[name](result)
        paths.append(WriteCsv(folder / (prefix + name), table))
    return paths


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

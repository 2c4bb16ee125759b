"""The published reference runs, and the likely faults of a run that differs."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from teleop_drake.cli.exit_codes import BadInput
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import ScenarioError, Show
from teleop_drake.model import tables
from teleop_drake.model.scenario.yaml_text import ParseFile
from teleop_drake.model.tables.headers import Header, IsTime, ParseHeader

FOLDER = Path(__file__).parents[1] / "references"
TIME = "time"
_DELAYS = FOLDER / "delays"

# The largest difference, in s, between an instant of a reference and the same instant
# of a run. A single-precision clock that adds up steps of 0.01 s has half this error
# after 0.8 s.
_SAME_INSTANT = 1e-6

# The faults whose effects are proportional to their size, an error of the delay or a
# step, with their handicaps: a fault whose size is fitted explains more errors than one
# of a fixed size. In some loops the methods of Euler act as a delay that is too long.
_FITTED = {"delay_error": 0.02, "explicit_euler": 0.03, "semi_implicit_euler": 0.03}

# Their size in the file of the faults, s.
_SIZE = 1e-3

# A fault is named if the share of the errors that it leaves unexplained, root mean
# square, is less than this.
_UNEXPLAINED = 0.1


class Table(NamedTuple):
    """The contents of a file: comments `# KEY: TEXT` and named columns."""

    notes: dict[str, str]
    columns: dict[str, Array]


class Difference(NamedTuple):
    """The difference of a signal of a run from its reference.

    Attributes:
        largest: The largest difference.
        tube: The largest allowed difference.
        time: The time of the largest difference, s.
        fault: The likely fault in words; empty if it is unknown, or if the signal is
            inside its tube.
    """

    largest: float
    tube: float
    time: float
    fault: str

    @property
    def is_inside(self) -> bool:
        """Returns whether the signal is inside of its tube."""
        return self.largest <= self.tube


def Names() -> list[str]:
    """Returns the names of the references."""
    return sorted(_Files())


def _Files() -> dict[str, Path]:
    """Returns the files with the numbers of the references, keyed by name."""
    paths = [*FOLDER.glob("*.csv"), *_DELAYS.glob("*.csv")]
    return {path.stem: path for path in paths}


def Describe(name: str) -> dict[str, str]:
    """Returns the one-line `title` of a reference, and the `task` that it solves."""
    return ParseFile(_Files()[name].with_suffix(".yaml"))


def Template(name: str) -> str:
    """Returns a file to fill in: the columns and the instants of a reference."""
    columns = _ReadReference(name).columns
    lines = [f"# reference: {name}", ",".join(columns)]
    empty = "," * (len(columns) - 1)
    lines += [f"{instant:.12g}{empty}" for instant in columns[TIME]]
    return "\n".join(lines)


def Compare(name: str, run: Table, origin: str) -> dict[str, Difference]:
    """Compares a run with a reference, signal by signal.

    Args:
        name: The reference's name.
        run: The run, with at least the columns of the reference.
        origin: The name of the run's file, for messages.

    Raises:
        BadInput: If a signal or an instant of the reference is not in the run.
    """
    reference = _ReadReference(name)
    for column in reference.columns:
        if column not in run.columns:
            allowed = ",".join(reference.columns)
            found = ", ".join(map(Show, run.columns))
            raise BadInput(
                f"{origin}: columns {found}: must have {column!r}; the header that "
                f"--template prints: {allowed}"
            )
    at_times = _AtInstants if "instants" in reference.notes else _Between
    signals = dict(reference.columns)
    times = signals.pop(TIME)
    values = at_times(run, times, origin)
    step = _StepOf(run, origin)
    tubes = map(float, reference.notes["tubes"].split(","))
    result = {}
    for (signal, expected), tube in zip(signals.items(), tubes, strict=True):
        errors = values[signal] - expected
        worst = int(np.abs(errors).argmax())
        largest = float(abs(errors[worst]))
        fault = _LikelyFault(name, signal, errors, step) if largest > tube else ""
        result[signal] = Difference(largest, tube, float(times[worst]), fault)
    return result


def _AtInstants(run: Table, times: Array, origin: str) -> dict[str, Array]:
    """Returns the columns of a run at instants, each of which the run must contain.

    If several rows have the same instant, the last is used: it has the values after a
    jump.
    """
    own = run.columns[TIME]
    if (np.diff(own) < 0).any():
        raise BadInput(f"{origin}: time: must ascend")
    rows = np.searchsorted(own, times + _SAME_INSTANT, side="right") - 1
    gaps = np.abs(own[rows] - times)
    if gaps.max() > _SAME_INSTANT:
        missing = times[int(gaps.argmax())]
        raise BadInput(
            f"{origin}: time = {missing:.12g} s: must be there; the instants of the "
            "reference are those of --template"
        )
    return {name: values[rows] for name, values in run.columns.items()}


def _Between(run: Table, times: Array, origin: str) -> dict[str, Array]:
    """Returns the columns of a run at times, interpolated linearly."""
    own = run.columns[TIME]
    if (np.diff(own) < 0).any() or own[0] > times[0] or own[-1] < times[-1]:
        raise BadInput(
            f"{origin}: time = {own[0]:g} to {own[-1]:g} s: must ascend and cover "
            f"{times[0]:g} to {times[-1]:g} s"
        )
    return {name: np.interp(times, own, x) for name, x in run.columns.items()}


def _StepOf(run: Table, origin: str) -> float | None:
    """Returns the fixed step of a run in s, which a comment `# step: SECONDS` gives."""
    text = run.notes.get("step")
    if text is None:
        return None
    try:
        step = float(text)
    except ValueError:
        step = math.nan
    if not 0 < step < math.inf:
        raise BadInput(f"{origin}: # step: {text}: must be > 0 (s)")
    return step


def _LikelyFault(name: str, signal: str, errors: Array, step: float | None) -> str:
    """Returns the fault that explains a signal's errors best, in words, or "".

    Args:
        name: The reference's name.
        signal: The signal's name.
        errors: Its errors at the instants of the reference.
        step: The fixed step of the run in s, if it is known.
    """
    path = _DELAYS / "faults" / f"{name}.csv"
    if not path.exists():
        return ""
    reference = _ReadReference(name).columns[signal]
    texts = ParseFile(_DELAYS / "faults.yaml")
    best = ""
    smallest = _UNEXPLAINED
    # `rest` is the share of the errors that remains without the effect of a fault.
    for column, wrong in ReadTable(path).columns.items():
        owner, _, fault = column.partition(":")
        if owner != signal:
            continue
        fault, _, order = fault.partition(":")
        effect = wrong - reference
        size = 1.0
        handicap = _FITTED.get(fault, 0.0)
        if fault in _FITTED:
            size = float(errors @ effect / (effect @ effect))
        if fault.endswith("euler") and step is not None:
            size = step / _SIZE
            handicap = 0.0
        rest = np.linalg.norm(errors - size * effect) / np.linalg.norm(errors)
        is_backwards = fault.endswith("euler") and size < 0
        if rest + handicap < smallest and not is_backwards:
            smallest = float(rest + handicap)
            amount = size * _SIZE
            best = texts[fault].format(
                seconds=f"{abs(amount):.2g}",
                steps=f"{abs(amount) / 0.01:.2g}",
                direction="longer" if amount > 0 else "shorter",
                order=order,
            )
    return best


def _ReadReference(name: str) -> Table:
    return ReadTable(_Files()[name])


def ReadTable(path: Path) -> Table:
    """Returns the contents of a file of a run, in SI.

    A unit in the brackets of a header is converted. Times of a clock that shows dates
    or the time of day count from the first row, which the note `clock` tells.

    Raises:
        ScenarioError: If there is no column of times or no row, or if a row does not
            consist of finite numbers.
    """
    table = tables.ReadTable("FILE", str(path))
    comments = [comment.partition(":") for comment in table.comments]
    notes = {name.strip(): text.strip() for name, _, text in comments}
    time = _TimeOf(table)
    times = table.Times(time)
    if times.is_date:
        notes["clock"] = f"{times.clock}, counted from the first row"
    columns = {TIME: times.seconds}
    for name in table.names:
        if name != time:
            header = ParseHeader(name) if name.endswith(("]", ")")) else Header((), "")
            columns[header.key or name] = _Finite(table, name, header.unit)
    return Table(notes=notes, columns=columns)


def _TimeOf(table: tables.Table) -> str:
    """Returns the column of times: `time`, or the only one with such a name."""
    found = [x for x in table.names if IsTime(ParseHeader(x).key)]
    if TIME in table.names:
        found = [TIME]
    if len(found) == 1:
        return found[0]
    shown = ", ".join(map(Show, table.names))
    if not table.has_header:
        shown += " (no header)"
    raise ScenarioError(
        f"{table.origin}: columns {shown}: must have one named {TIME!r} and one for "
        "each signal, in the header that --template NAME prints"
    )


def _Finite(table: tables.Table, column: str, unit: str) -> Array:
    """Returns the numbers of a column; refuses a missing one."""
    values = table.Values(column, unit)
    for i in np.flatnonzero(np.isnan(values))[:1]:
        cell = table.Texts(column)[i]
        raise ScenarioError(
            f"{table.Place(column)}: line {table.lines[i]}, {Show(cell)}: must be a "
            "finite number"
        )
    return values

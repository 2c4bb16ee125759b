"""The published reference runs, and what is wrong with a run that differs from one."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.cli.exit_codes import BadInput
from teleop_drake.files import ReadNumbers, ReadRows, ReadText
from teleop_drake.scenario.yaml_text import ParseFile
from teleop_drake.validation import Refuse

FOLDER = Path(__file__).parents[1] / "references"
TIME = "time"
_DELAYS = FOLDER / "delays"

# An instant of a reference and that of a run are the same within so many s: a clock of
# single precision that adds up steps of 0.01 s is off by half of it after 0.8 s.
_SAME_INSTANT = 1e-6

# The fault whose effect is proportional to its size, and the size in the reference, s.
_DELAY_ERROR = "delay_error"
_DELAY_ERROR_SIZE = 1e-3

# A fault of any size explains more than one of a certain size, which is preferred.
_PREFERENCE = 0.02

# A fault is named where it leaves so much of the error unexplained, root mean square.
_UNEXPLAINED = 0.1


class Table(NamedTuple):
    """A file of comments `# KEY: TEXT` and columns with names."""

    notes: dict[str, str]
    columns: dict[str, Array]


class Difference(NamedTuple):
    """How far a signal of a run is from its reference.

    Attributes:
        largest: The largest difference.
        tube: The largest difference that is allowed.
        time: When the difference is largest, s.
        fault: The likely fault in words; empty if it is unknown, or there is none.
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
    """Returns the files with the numbers of the references, by name."""
    paths = [*FOLDER.glob("*.csv"), *_DELAYS.glob("*.csv")]
    return {path.stem: path for path in paths}


def Describe(name: str) -> dict[str, str]:
    """Returns what a reference is of: a `title` of one line, and the `task`."""
    return ParseFile(_Files()[name].with_suffix(".yaml"))


def Template(name: str) -> str:
    """Returns a file without numbers: the columns and instants of a reference."""
    columns = _ReadReference(name).columns
    lines = [f"# reference: {name}", ",".join(columns)]
    empty = "," * (len(columns) - 1)
    lines += [f"{instant:.12g}{empty}" for instant in columns[TIME]]
    return "\n".join(lines)


def Compare(name: str, run: Table, origin: str) -> dict[str, Difference]:
    """Compares a run with a reference, signal by signal.

    Args:
        name: The reference's name.
        run: With the columns of the reference.
        origin: The name of the run's file, for messages.

    Raises:
        BadInput: If a signal or an instant of the reference is not in the run.
    """
    reference = _ReadReference(name)
    for column in reference.columns:
        if column not in run.columns:
            allowed = ", ".join(reference.columns)
            raise BadInput(f"{origin}: column {column!r}: must be there: {allowed}")
    at_times = _AtInstants if "instants" in reference.notes else _Between
    signals = dict(reference.columns)
    times = signals.pop(TIME)
    values = at_times(run, times, origin)
    tubes = map(float, reference.notes["tubes"].split(","))
    result = {}
    for (signal, expected), tube in zip(signals.items(), tubes, strict=True):
        errors = values[signal] - expected
        worst = int(np.abs(errors).argmax())
        largest = float(abs(errors[worst]))
        fault = _LikelyFault(name, signal, errors) if largest > tube else ""
        result[signal] = Difference(largest, tube, float(times[worst]), fault)
    return result


def _AtInstants(run: Table, times: Array, origin: str) -> dict[str, Array]:
    """Returns the columns of a run at instants which must be in the run.

    The last of several rows with one instant counts: it has the values behind a jump.
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
    """Returns the columns of a run at times, by straight lines."""
    own = run.columns[TIME]
    if (np.diff(own) < 0).any() or own[0] > times[0] or own[-1] < times[-1]:
        raise BadInput(
            f"{origin}: time = {own[0]:g} to {own[-1]:g} s: must ascend and cover "
            f"{times[0]:g} to {times[-1]:g} s"
        )
    return {name: np.interp(times, own, x) for name, x in run.columns.items()}


def _LikelyFault(name: str, signal: str, errors: Array) -> str:
    """Returns the fault in words whose effect the errors of a signal resemble most."""
    path = _DELAYS / "faults" / f"{name}.csv"
    if not path.exists():
        return ""
    reference = _ReadReference(name).columns[signal]
    texts = ParseFile(_DELAYS / "faults.yaml")
    best = ""
    smallest = _UNEXPLAINED
    # The share of the errors that is left once the effect of a fault is taken away.
    for column, wrong in ReadTable(path).columns.items():
        owner, _, fault = column.partition(":")
        if owner != signal:
            continue
        effect = wrong - reference
        # A delay that is wrong by a little has an effect in proportion to it.
        is_delay = fault == _DELAY_ERROR
        size = float(errors @ effect / (effect @ effect)) if is_delay else 1.0
        rest = np.linalg.norm(errors - size * effect) / np.linalg.norm(errors)
        rest += _PREFERENCE * is_delay
        if rest < smallest:
            smallest = float(rest)
            amount = size * _DELAY_ERROR_SIZE
            best = texts[fault].format(
                seconds=f"{abs(amount):.2g}",
                steps=f"{abs(amount) / 0.01:.2g}",
                direction="longer" if amount > 0 else "shorter",
            )
    return best


def _ReadReference(name: str) -> Table:
    return ReadTable(_Files()[name])


def ReadTable(path: Path) -> Table:
    """Returns what is in a file.

    Raises:
        BadInput: If it has no column `time`.
        ScenarioError: If a line is not of finite numbers.
    """
    lines = ReadText(path, str(path)).splitlines()
    comments = [line[1:].partition(":") for line in lines if line.startswith("#")]
    rows = ReadRows(path, str(path))
    header = [name.strip() for name in rows[0][1].split(",")] if rows else []
    if TIME not in header or len(rows) < 2:
        Refuse(f"{path}: columns", header, "names, `time` among them")
    table = ReadNumbers(rows[1:], str(path), header)
    return Table(
        notes={name.strip(): text.strip() for name, _, text in comments},
        columns=dict(zip(header, table.T, strict=True)),
    )

"""The command `teleop-drake check`."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from teleop_drake.cli.exit_codes import DONE, FAILED, BadInput

if TYPE_CHECKING:
    from teleop_drake.arrays import Array

_FOLDER = Path(__file__).parents[2] / "references"
_TITLE = "reference"
_TUBES = "tubes"
_TIME = "time"


class _Run(NamedTuple):
    """A file: what its comments say by their first word, and its columns by name."""

    notes: dict[str, str]
    columns: dict[str, "Array"]


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.add_argument(
        "file",
        metavar="FILE.csv",
        help="a run: a comment `# reference: NAME`, names of columns, numbers. The "
        f"references and their names are in {_FOLDER}",
    )


def Execute(args: argparse.Namespace) -> int:
    """Compares a run with the reference of its name, signal by signal."""
    import numpy as np

    run = _Read(Path(args.file))
    names = sorted(path.stem for path in _FOLDER.glob("*.csv"))
    name = run.notes.get(_TITLE, "")
    if name not in names:
        raise BadInput(
            f"{args.file}: # {_TITLE} = {name!r}: must be one of {', '.join(names)}"
        )
    # The run has to have the reference's signals at its times.
    reference = _Read(_FOLDER / f"{name}.csv")
    missing = [column for column in reference.columns if column not in run.columns]
    if missing:
        allowed = ", ".join(reference.columns)
        raise BadInput(f"{args.file}: column {missing[0]!r}: must be there: {allowed}")
    own = run.columns[_TIME]
    times = reference.columns[_TIME]
    if (np.diff(own) < 0).any() or own[0] > times[0] or own[-1] < times[-1]:
        raise BadInput(
            f"{args.file}: time = {own[0]:g} to {own[-1]:g} s: must ascend and cover "
            f"{times[0]:g} to {times[-1]:g} s"
        )
    # The largest difference of each signal is compared with the tube.
    tubes = [float(tube) for tube in reference.notes[_TUBES].split(",")]
    signals = [column for column in reference.columns if column != _TIME]
    is_inside = True
    print(f"{name}\n{'signal':<24} {'difference':>10} {'tube':>10}  share     at")
    for signal, tube in zip(signals, tubes, strict=True):
        values = np.interp(times, own, run.columns[signal])
        errors = np.abs(values - reference.columns[signal])
        worst = int(errors.argmax())
        is_inside &= bool(errors[worst] <= tube)
        numbers = f"{errors[worst]:10.2e} {tube:10.2e} {errors[worst] / tube:6.2f}"
        print(f"{signal:<24} {numbers}  {times[worst]:.4g} s")
    print("inside" if is_inside else "outside", "of the tubes")
    return DONE if is_inside else FAILED


def _Read(path: Path) -> _Run:
    """Returns what is in a file.

    Raises:
        BadInput: If it is no table of finite numbers with a column `time`.
    """
    import numpy as np

    from teleop_drake.files import ReadText

    lines = ReadText(path, str(path)).splitlines()
    comments = [line[1:].partition(":") for line in lines if line.startswith("#")]
    rows = [line.split(",") for line in lines if line.strip() and line[0] != "#"]
    header = [name.strip() for name in rows[0]] if rows else []
    if _TIME not in header or len(rows) < 2:
        raise BadInput(f"{path}: columns = {header}: must be names, `time` among them")
    for row in rows[1:]:
        try:
            are_finite = np.isfinite(np.array(row, float)).all()
        except ValueError:
            are_finite = False
        if len(row) != len(header) or not are_finite:
            text = ",".join(row)[:60]
            raise BadInput(f"{path}: {text!r}: must be {len(header)} finite numbers")
    table = np.array(rows[1:], float)
    return _Run(
        {name.strip(): text.strip() for name, _, text in comments},
        dict(zip(header, table.T, strict=True)),
    )

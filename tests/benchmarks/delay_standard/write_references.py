"""Writes the references of the delay standard, and what is likely to go wrong.

python tests/benchmarks/delay_standard/write_references.py
"""

import sys
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parents[3] / "teleop_drake" / "references" / "delays"


def columns(instants: Sequence[Fraction], signals: Mapping) -> dict[str, list[float]]:
    """Returns the values of signals at instants, with a column `time`."""
    table = {"time": [float(t) for t in instants]}
    for name, signal in signals.items():
        table[name] = [signal(t) for t in instants]
    return table


def text(notes: Mapping[str, str], table: Mapping[str, Sequence[float]]) -> str:
    """Returns a file: comments, names of columns, twelve digits."""
    lines = [f"# {key}: {value}" for key, value in notes.items()]
    lines.append(",".join(table))
    for row in zip(*table.values(), strict=True):
        lines.append(",".join(f"{value:.12g}" for value in row))
    return "\n".join([*lines, ""])


def reference_text(name: str, task) -> str:
    tubes = ", ".join(f"{task.tubes[signal]:.3g}" for signal in task.signals)
    notes = {"reference": name, "tubes": tubes, "instants": "exact"}
    return text(notes, columns(task.instants, task.signals))


def faults_text(name: str, task) -> str:
    """Returns the wrong answers; a column is called SIGNAL:FAULT.

    Those that do not leave the tubes are left out.
    """
    right = columns(task.instants, task.signals)
    table = columns(task.instants, {})
    for fault, answers in task.faults.items():
        wrong = columns(task.instants, answers)
        for signal in answers:
            if not np.allclose(wrong[signal], right[signal], 0, task.tubes[signal]):
                table[f"{signal}:{fault}"] = wrong[signal]
    return text({"faults of": name}, table)


def main() -> None:
    from benchmarks.delay_standard.tasks import TASKS

    for name, make in TASKS.items():
        task = make()
        path = FOLDER / f"{name}.csv"
        path.write_text(reference_text(name, task), encoding="utf-8")
        path = FOLDER / "faults" / f"{name}.csv"
        path.write_text(faults_text(name, task), encoding="utf-8")


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))
    main()

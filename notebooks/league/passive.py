"""Passive and quick: a review of waves with a damper against the command.

`python -m league.passive` does the runs of the study `passive_and_quick`, writes a row
for each into passive_and_quick.csv, and the table into docs/passive_and_quick.md. It
takes some two minutes on one core.
"""

from collections.abc import Sequence

import numpy as np

from league.entries import Entry
from league.runs import Runs
from league.statistics import FOLDER, ReadTable, Row
from teleop_drake.study.sweep.folder import WriteCsv

STUDY = "passive_and_quick"
LAWS = ("waves to the command", "waves to the ground", "damper to the command")
"""The laws of the study, in the order of its grid."""

GROUPS = ("bone", "delay", "speed", "hand", "network")
COLUMNS = ("rest", "arrival", "impact", "effort")


def ReviewRows() -> list[Row]:
    """Does the runs of the study; returns a row for each."""
    runs = Runs(STUDY, Entry(STUDY, {}, {}, "no"))
    rows = []
    for title, plan in runs.plans.items():
        num_situations = len(plan.points) // len(LAWS)
        for number in range(len(plan.points)):
            outcome = runs.SimulateOne(title, number, {})
            law, situation = divmod(number, num_situations)
            row: Row = {"law": LAWS[law], "group": title.rpartition("-")[2]}
            row["run"] = f"{title}-{situation}"
            cells = {name: getattr(outcome, name) for name in COLUMNS}
            rows.append(row | {x: float(f"{y:.4g}") for x, y in cells.items()})
    return rows


def TableRows(rows: Sequence[Row]) -> list[list[str]]:
    """Returns the cells of the page's table, a row for each group and law."""
    table = []
    for group in (*GROUPS, "all"):
        for law in LAWS:
            own = [x for x in rows if x["law"] == law and group in (x["group"], "all")]
            table.append([group, law, *_Cells(own)])
    return table


def _Cells(rows: Sequence[Row]) -> list[str]:
    """Returns runs at rest, and medians with the largest value in brackets."""
    rests = sum(bool(np.isfinite(row["rest"])) for row in rows)
    cells = [f"{rests} of {len(rows)}"]
    for name in COLUMNS:
        values = sorted(row[name] for row in rows)
        middle = values[(len(values) - 1) // 2]
        cells.append(f"{middle:.2f} ({values[-1]:.2f})".replace("inf", "never"))
    return cells


def Table() -> str:
    """Returns the table of the page, from passive_and_quick.csv."""
    heads = ["varied", "law", "at rest", "time to rest [s]", "time to the bone"]
    heads += ["largest force", "effort"]
    lines = [heads, ["---"] * len(heads), *TableRows(ReadTable(STUDY))]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


if __name__ == "__main__":
    WriteCsv(FOLDER / f"{STUDY}.csv", ReviewRows())
    print(Table())

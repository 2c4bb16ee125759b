"""The table of the league of architectures: `python notebooks/league_table.py DIR`.

Its runs are the study `league`, which says what they are. They are kept in DIR as they
end, and only what is missing there is simulated; `teleop-drake sweep league --out DIR`
does the same, also in parts. Then league_table.csv, beside this file, is written: a row
for each case and architecture.

Of several runs a row has the numbers of all, of those that stay bounded and of those
that come to rest on the bone, and medians; of the settling time only if all come to
rest. Its status is `diverged` if any run's is. Of the control variation it has both
ends, too.
"""

import csv
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from teleop_drake.analysis.transparency import FeltStiffness
from teleop_drake.linear_model.operating_point import OperatingPoints
from teleop_drake.scenario import ARCHITECTURES as EVERY_ARCHITECTURE
from teleop_drake.scenario import LoadScenario
from teleop_drake.sweep import SweepPlan, SweepResult
from teleop_drake.sweep.plan import PointOverrides
from teleop_drake.sweep.study import LoadStudy, RunStudy

TABLE = Path(__file__).with_suffix(".csv")
ARCHITECTURES = tuple(x for x in EVERY_ARCHITECTURE if x != "robust_backstepping")
TASKS = ("one_dof", "two_dof_puncture", "two_dof_collision", "two_dof_combined")
CHANNELS = ("exact", "jitter", "loss", "both")
ROUND_TRIPS = (0.0, 0.1, 0.2, 0.5, 1.0)
METRICS = {
    "diverged_at": "diverged_at",
    "start_overshoot": "start_velocity_overshoot",
    "puncture_overshoot": "puncture.velocity_overshoot",
    "contact_time": "collision.time",
    "first_impact": "collision.initial_impact_force",
    "peak_force": "collision.peak_force",
    "rebound": "collision.rebound_velocity",
    "settling_time": "collision.settling_time",
    "velocity_rms_error": "velocity_rms_error.x",
    "force_rms_error": "force_rms_error.x",
    "control_peak": "control_force_peak.x",
    "control_variation": "control_force_variation.x",
    "age": "forward_channel.age_mean",
}
"""Columns and their metrics, along x. `felt_stiffness` at 1 rad/s is the bone's."""
INTERVAL = ("control_variation_low", "control_variation_high")
KEYS = ("task", "surgeon", "channel", "round_trip", "controller")
Row = dict[str, Any]


def HasBone(task: str) -> bool:
    """Returns whether there is a bone. Without one the surgeons do not differ."""
    return task != "two_dof_puncture"


def MakeRows(name: str, plan: SweepPlan, result: SweepResult) -> list[Row]:
    """Returns the rows of a sweep of the study, in the order of the table."""
    task, surgeon, _ = name.split("-")
    groups: dict[tuple[int, float, int], list[int]] = {}
    for i, point in enumerate(plan.points):
        given = point.get("channel") or {"delay": point["delay"]}
        kind = 1 * ("jitter" in given) + 2 * ("loss" in given)
        controller = ARCHITECTURES.index(point["controller"])
        groups.setdefault((kind, 2.0 * given["delay"], controller), []).append(i)
    table, rows = result.Table(), []
    for (kind, trip, controller), numbers in sorted(groups.items()):
        case = (task, surgeon, CHANNELS[kind], trip, ARCHITECTURES[controller])
        row = dict(zip(KEYS, case, strict=True)) | _Numbers([table[i] for i in numbers])
        if kind == 0 and HasBone(task):
            point = plan.points[numbers[0]]
            scenario = plan.source.Load([*plan.overrides, *PointOverrides(point)])
            bone = OperatingPoints(scenario)[-1]
            row["felt_stiffness"] = float(FeltStiffness(scenario, bone, [1.0])[0])
        rows.append(row)
    return rows


def _Numbers(runs: Sequence[Row]) -> Row:
    """Returns what a row says of its runs."""
    values = {
        column: [run[metric] for run in runs if run.get(metric) is not None]
        for column, metric in METRICS.items()
    }
    bounded = sum(run["status"] == "completed" for run in runs)
    at_rest = len(values["settling_time"])
    if at_rest < len(runs):
        values["settling_time"] = []
    row: Row = {"status": "completed" if bounded == len(runs) else "diverged"}
    row |= {"runs": len(runs), "bounded": bounded, "at_rest": at_rest}
    row |= {column: median(x) if x else None for column, x in values.items()}
    efforts = values["control_variation"]
    row |= dict(zip(INTERVAL, (min(efforts), max(efforts)), strict=True))
    return row | {"felt_stiffness": None}


def ReadTable() -> list[Row]:
    """Returns the rows of league_table.csv."""
    words = {*KEYS, "status"} - {"round_trip"}
    with TABLE.open(encoding="utf-8", newline="") as file:
        return [
            {k: x if k in words else float(x) if x else None for k, x in row.items()}
            for row in csv.DictReader(file)
        ]


def Select(rows: Iterable[Row], **values: Any) -> list[Row]:
    """Returns the rows with these values, for example round_trip=0.2."""
    return [row for row in rows if values.items() <= row.items()]


def IsBounded(row: Row) -> bool:
    """Returns whether all runs went on to their end, below five times the command."""
    return bool(row["status"] == "completed")


def Settles(row: Row) -> bool:
    """Returns whether the tool came to rest on the bone before the end, in all runs."""
    return row["settling_time"] is not None


MEDIANS = {
    "start overshoot": ("start_overshoot", "%"),
    "puncture overshoot": ("puncture_overshoot", "%"),
    "contact at": ("contact_time", "ratio"),
    "first impact": ("first_impact", "ratio"),
    "largest force": ("peak_force", "ratio"),
    "settles after": ("settling_time", "s"),
    "velocity error": ("velocity_rms_error", "ratio"),
    "control effort": ("control_variation", "ratio"),
    "felt stiffness": ("felt_stiffness", "N/m"),
}
"""What Medians() returns: columns of the table, and units."""


def Medians(rows: Sequence[Row], round_trip: float) -> dict[str, dict[str, Any]]:
    """Returns medians over the tasks, exact channels, the surgeon switches on bone.

    Overshoots are in % of the commanded speed; a ratio is to direct force without
    delay. None where the tool runs away in any task, but for the stiffness, and for
    settling also where it does not settle on every bone.
    """
    rows = [
        row
        for row in Select(rows, channel="exact")
        if row["surgeon"] == ("switches" if HasBone(row["task"]) else "never")
    ]
    ideal = Select(rows, controller="direct_force", round_trip=0.0)
    ideals = {row["task"]: row for row in ideal}
    speeds = {task: LoadScenario(task).surgeon.velocity[0] for task in TASKS}
    medians: dict[str, dict[str, Any]] = {}
    for kind in ARCHITECTURES:
        mine = Select(rows, controller=kind, round_trip=round_trip)
        settles = all(Settles(row) for row in mine if HasBone(row["task"]))
        medians[kind] = {}
        for name, (column, unit) in MEDIANS.items():
            values = [
                row[column]
                * (100 / speeds[row["task"]] if unit == "%" else 1)
                / (ideals[row["task"]][column] if unit == "ratio" else 1)
                for row in mine
                if row[column] is not None
            ]
            known = all(map(IsBounded, mine)) or unit == "N/m"
            known &= unit != "s" or settles
            medians[kind][name] = float(median(values)) if known and values else None
    return medians


def main() -> None:
    """Does what is missing of the study, and writes the table."""
    study = LoadStudy("league")
    results = RunStudy(study, sys.argv[1], resume=True)
    sweeps = zip(results, study.plans.values(), results.values(), strict=True)
    rows = [row for sweep in sweeps for row in MakeRows(*sweep)]
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(rows[0])
        for row in rows:
            cells = row.values()
            writer.writerow(f"{x:.4g}" if isinstance(x, float) else x for x in cells)


if __name__ == "__main__":
    main()

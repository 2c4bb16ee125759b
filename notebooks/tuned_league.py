"""The league with gains by search: `python notebooks/tuned_league.py DIR`.

For each architecture it searches for gains with the same budget, see ENTRIES, in the
runs of the study `tuned_league`: a Pareto front over rest, impact, arrival and felt
stiffness. Then it runs the study `tuned_league_held_out` with the gains by rule, and
with up to three members of the front. All runs are kept in DIR as they end, and only
what is missing there is simulated. tuned_league.csv, beside this file, gets a row for
each member and group of held-out runs, and docs/tuned_league.png is drawn.
"""

import csv
import json
import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from teleop_drake.figures.runs import SaveFigure
from teleop_drake.figures.style import COLORS
from teleop_drake.scenario import Scenario
from teleop_drake.sweep.plan import PointOverrides
from teleop_drake.sweep.study import LoadStudy, RunStudy, Study
from teleop_drake.sweep.tuning import (
    STIFFNESS_LOSS,
    FeltStiffnessLoss,
    PlanTuning,
    RunTuning,
    TuningResult,
)

TABLE = Path(__file__).with_suffix(".csv")
PICTURE = Path(__file__).parents[1] / "teleop_drake/docs/tuned_league.png"
EVALUATIONS = 32
MEMBERS = 3
# Kind, a setting, and the gains that are searched; direct force has none.
ENTRIES = {
    "direct force": ("direct_force", "", ""),
    "adaptive": ("adaptive_backstepping", "", "G1=0.3:10 G2=3:100 Lambda=0.05:3"),
    "damped force": ("damped_force", "", "damping=0.1:20"),
    "waves": ("wave_variables", "", "impedance=0.1:20"),
    "P+d": (
        *("proportional_damping", ""),
        "stiffness=0.5:100 master_damping=0.1:20 slave_damping=0.1:20",
    ),
    "four channels": (
        *("four_channel", ""),
        "bandwidth=0.5:25 master_damping=0.01:5 C2=0.1:1.5",
    ),
    "position-position": (
        *("four_channel", "variant: position_position"),
        "bandwidth=0.5:25 master_damping=0.01:10",
    ),
    "position-force": (
        *("four_channel", "variant: position_force"),
        "bandwidth=0.5:25 master_damping=0.01:10 C2=0.1:1.5",
    ),
    "passivity + damper": (
        *("time_domain_passivity", "local_damping: 2"),
        "local_damping=0.1:20",
    ),
    "Smith + damper": (
        *("smith_predictor", "local_damping: 2"),
        "local_damping=0.1:20 stiffness=0.01:150",
    ),
}
GOALS = ["collision.rest_time", "collision.peak_force", "collision.time"]
GOALS += [STIFFNESS_LOSS]
NUMBERS = ("rest", "impact", "arrival", "softness", "coordination", "effort")
"""Means over the runs of: time from contact to rest (s; a run that does not come to
rest counts its duration); largest force on the bone, in multiples of v_d sqrt(k m),
that of a free mass; time to the bone, in multiples of the commanded;
felt_stiffness_loss; rms distance of master and tool, in s at the commanded speed; total
variation of the control force, in multiples of the force that the operator holds. Where
a run never comes to the bone, impact and arrival are infinite."""


def _With(name: str, kind: str, settings: dict[str, Any]) -> Study:
    """Returns a study in which all runs have a controller with these settings."""
    given = PointOverrides({"controller": kind, **settings})
    plans = LoadStudy(name).plans.items()
    return Study(
        plans={k: replace(p, overrides=[*p.overrides, *given]) for k, p in plans},
        metrics=None,
    )


def Spread(result: TuningResult) -> list[dict[str, float]]:
    """Returns the best gains of a front, and members that lie far apart."""
    logs = np.log([result.Scores(trial) for trial in result.front])
    chosen = [result.front.index(result.best)]
    while len(chosen) < min(MEMBERS, len(logs)):
        apart = np.linalg.norm(logs[:, None] - logs[chosen], axis=2).min(axis=1)
        chosen.append(int(apart.argmax()))
    return [result.front[i].gains for i in chosen if result.front[i].gains]


def MakeRows(name: str, folder: Path) -> list[dict[str, Any]]:
    """Searches for the gains of an architecture, and does its held-out runs."""
    kind, setting, gains = ENTRIES[name]
    key, _, value = setting.partition(": ")
    settings = {f"controller.{kind}.{key}": value} if key else {}
    members: list[dict[str, Any]] = [{}]
    if gains:
        plan = PlanTuning(
            _With("tuned_league", kind, settings),
            controller=kind,
            gains=gains.split(),
            minimize=GOALS,
            evaluations=EVALUATIONS,
        )
        members += Spread(RunTuning(plan, out=folder / "search", resume=True))
    rows = []
    for i, member in enumerate(members):
        study = _With("tuned_league_held_out", kind, settings | member)
        results = RunStudy(study, folder / f"member-{i}", resume=True)
        groups: dict[str, list[list[float]]] = {}
        for title, sweep in study.plans.items():
            group = groups.setdefault(title.rpartition("-")[2], [])
            for point, run in zip(sweep.points, results[title].Table(), strict=True):
                overrides = [*sweep.overrides, *PointOverrides(point)]
                group.append(_Numbers(sweep.source.Load(overrides), run))
        for group, values in groups.items():
            bounded, at_rest, *numbers = np.array(values).T
            row = {"architecture": name, "member": i, "gains": json.dumps(member)}
            row |= {"runs": group, "count": len(values)}
            row |= {"bounded": int(bounded.sum()), "at_rest": int(at_rest.sum())}
            rows.append(
                row | {k: np.mean(x) for k, x in zip(NUMBERS, numbers, strict=True)}
            )
    return rows


def _Numbers(scenario: Scenario, run: dict[str, Any]) -> list[float]:
    """Returns whether a run is bounded and comes to rest, and its NUMBERS."""
    speed = float(np.linalg.norm(scenario.surgeon.velocity))
    bone = scenario.environment.layers[-1]
    mass = 1 / np.linalg.inv(scenario.Facts().inertia)[0, 0]
    direct = (bone.start - scenario.robot.start[0]) / speed
    rest = run["collision.rest_time"]
    is_bounded = run["status"] == "completed"
    values = (
        scenario.duration if rest is None else rest,
        (run["collision.peak_force"] or np.inf)
        / (speed * np.sqrt(bone.stiffness * mass)),
        (run["collision.time"] or np.inf) / direct,
        FeltStiffnessLoss(scenario),
        run["coordination_rms_error.x"] / speed,
        run["control_force_variation.x"] / scenario.surgeon.contact_force[0],
    )
    return [float(x) for x in (is_bounded, rest is not None, *values)]


def ReadTable() -> list[dict[str, Any]]:
    """Returns the rows of tuned_league.csv."""
    words = ("architecture", "gains", "runs")
    with TABLE.open(encoding="utf-8", newline="") as file:
        return [
            {k: x if k in words else float(x) for k, x in row.items()}
            for row in csv.DictReader(file)
        ]


def Members(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Returns a row for each member: the sums and means over all held-out runs."""
    groups: dict[tuple[str, float], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["architecture"], row["member"]), []).append(row)
    members = []
    for (name, member), mine in groups.items():
        counts = np.array([row["count"] for row in mine])
        total = {"architecture": name, "member": member, "gains": mine[0]["gains"]}
        total |= {
            k: sum(row[k] for row in mine) for k in ("count", "bounded", "at_rest")
        }
        means = {k: counts @ [row[k] for row in mine] / counts.sum() for k in NUMBERS}
        members.append(total | means)
    return members


def PageRows(rows: list[dict[str, Any]]) -> list[str]:
    """Returns the rows of the table in docs/architectures.md.

    Of each architecture it has the gains by rule, and of the gains by search those with
    which most runs come to rest, and soonest.
    """
    lines = []
    for name in ENTRIES:
        rule, *found = (m for m in Members(rows) if m["architecture"] == name)
        best = sorted(found, key=lambda m: (-m["at_rest"], m["rest"]))[:1]
        for title, m in zip((name, f"{name}, by search"), [rule, *best], strict=False):
            numbers = [f"{m[k]:.3g}".replace("inf", "-") for k in NUMBERS]
            cells = [title, f"{m['bounded']:g}", f"{m['at_rest']:g}", *numbers]
            lines.append("| " + " | ".join(cells) + " |")
    return lines


def Draw(rows: list[dict[str, Any]]) -> Figure:
    """Draws the members that stay bounded in every run."""
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, name in enumerate(ENTRIES):
        style = {"color": COLORS[k % len(COLORS)], "marker": "os*^vDPX<>"[k], "ls": ""}
        for member in Members(rows):
            if member["architecture"] == name and member["bounded"] == member["count"]:
                fill = {"mfc": "none"} if member["member"] == 0 else {}
                left.plot(member["rest"], 1 - member["softness"], **style, **fill)
                right.plot(member["arrival"], member["impact"], **style, **fill)
        right.plot([], [], **style, label=name)
    left.set_xscale("log")
    left.set_xlabel("at rest on the bone after [s]")
    left.set_ylabel("share of the bone's stiffness that is felt")
    right.set_xlabel("time to the bone, in multiples of the commanded")
    right.set_ylabel("largest force, in multiples of a free mass's")
    figure.legend(loc="outside lower center", ncols=5, fontsize=8)
    return figure


def main() -> None:
    """Does what is missing of all runs, and writes the table."""
    folder = Path(sys.argv[1])
    context = multiprocessing.get_context("forkserver")
    with ProcessPoolExecutor(2, context, max_tasks_per_child=1) as pool:
        folders = [folder / name.replace(" ", "_") for name in ENTRIES]
        rows = [x for rows in pool.map(MakeRows, ENTRIES, folders) for x in rows]
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(rows[0])
        for row in rows:
            cells = row.values()
            writer.writerow(f"{x:.4g}" if isinstance(x, float) else x for x in cells)
    SaveFigure(Draw(ReadTable()), PICTURE)


if __name__ == "__main__":
    main()

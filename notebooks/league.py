"""The league of architectures: `python notebooks/league.py DIR`.

For each architecture it searches for gains with the same budget, see ENTRIES, in the
runs of the study `league`: a Pareto front over rest, impact, arrival and felt
stiffness. Then it runs the study `league_held_out` with up to four members: 0 has the
gains by rule, 1 those of the front that are best in training, and 2 and 3 are others of
the front that lie far apart. There is no member 1 where the gains by rule are the best
in training. All runs are kept in DIR as they end, and only what is missing there is
simulated. league.csv, beside this file, gets a row for each member and group of runs,
the last of which are all, and docs/league.png is drawn. docs/felt_stiffness.png shows
how stiff a bone feels by rule, at which frequency of the hand.
"""

import csv
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from teleop_drake.analysis.operating_point import OperatingPoints
from teleop_drake.analysis.transparency import FeltStiffness, FeltStiffnessLoss
from teleop_drake.figures.analysis import PlotFeltStiffness
from teleop_drake.figures.runs import SaveFigure
from teleop_drake.figures.style import COLORS
from teleop_drake.scenario import LoadScenario, Scenario
from teleop_drake.scenario.tree import ToTree
from teleop_drake.stations import ResolveController
from teleop_drake.sweep import RunSweep, tuning
from teleop_drake.sweep.folder import WriteCsv
from teleop_drake.sweep.plan import PointOverrides
from teleop_drake.sweep.study import LoadStudy, Study

TABLE = Path(__file__).with_suffix(".csv")
DOCS = Path(__file__).parents[1] / "teleop_drake/docs"
PICTURE = DOCS / "league.png"
FELT_PICTURE = DOCS / "felt_stiffness.png"
EVALUATIONS = 32
MEMBERS = 3
GOALS = ["collision.rest_time", "collision.peak_force", "collision.time"]
GOALS += [tuning.STIFFNESS_LOSS]
# Kind, settings, and the gains that are searched with their ranges.
ENTRIES = {
    "direct force": "direct_force",
    "adaptive": "adaptive_backstepping G1=0.3:10 G2=3:100 Lambda=0.05:3",
    "robust": "robust_backstepping G1=0.3:10 G2=3:100 Lambda=0.05:3",
    "damped force": "damped_force damping=0.1:20",
    "damped to command": "damped_force against=command damping=0.1:20",
    "waves": "wave_variables impedance=0.1:20",
    "P+d": "proportional_damping stiffness=0.5:100"
    " master_damping=0.1:20 slave_damping=0.1:20",
    "four channels": "four_channel bandwidth=0.5:25 master_damping=0.01:5 C2=0.1:1.5",
    "position-position": "four_channel variant=position_position"
    " bandwidth=0.5:25 master_damping=0.01:10",
    "position-force": "four_channel variant=position_force"
    " bandwidth=0.5:25 master_damping=0.01:10 C2=0.1:1.5",
    "passivity + damper": "time_domain_passivity local_damping=2 local_damping=0.1:20",
    "Smith + damper": "smith_predictor local_damping=2"
    " local_damping=0.1:20 stiffness=0.01:150",
}
# Of each architecture by rule: how stiff a bone feels, and at which frequencies, rad/s.
# With both dampers it feels the same; the robust law and passivity control feel next
# to the law on which they stand.
FELT = ("direct force", "adaptive", "damped force", "waves", "P+d", "four channels")
FELT += ("position-position", "Smith + damper")
FELT_FREQUENCIES = (1.0, 5.0, 7.0)
FELT_DELAY = 0.2
GROUPS = ("delay", "stiffness", "mass", "network", "wrong_delay", "wrong_mass", "all")
COUNTS = ("count", "bounded", "at_rest")
NUMBERS = ("rest", "impact", "arrival", "softness", "coordination", "effort")
"""Means over the runs of: time from contact to rest (s; a run that does not come to
rest counts its duration); largest force on the bone, in multiples of v_d sqrt(k m),
that of a free mass; time to the bone, in multiples of the commanded;
felt_stiffness_loss, at 1 rad/s; rms distance of master and tool, in s at the commanded
speed; total variation of the control force, in multiples of the force that the operator
holds. Where a run never comes to the bone, impact and arrival are infinite."""
Row = dict[str, Any]
Gains = dict[str, float]


def _Settings(name: str) -> list[str]:
    """Returns overrides: an architecture with the gains by rule."""
    kind, *words = ENTRIES[name].split()
    fixed = [f"controller.{kind}.{word}" for word in words if ":" not in word]
    return [f"controller.kind={kind}", *fixed]


def _Study(study: str, name: str, gains: Gains, group: str = "all") -> Study:
    """Returns a group of a study's runs, with an architecture."""
    own = _Settings(name)
    plans = {}
    for title, plan in LoadStudy(study).plans.items():
        if group == "all" or title.endswith(f"-{group}"):
            overrides = [*plan.overrides, *own, *PointOverrides(gains)]
            if "-wrong_" in title:
                overrides += _Believed(plan.source.Load(overrides))
            plans[title] = replace(plan, overrides=overrides)
    return Study(plans=plans, metrics=None)


def _Believed(scenario: Scenario) -> list[str]:
    """Returns overrides: what the rules derive from a scenario."""
    given, derived = scenario.controller.Chosen(), ResolveController(scenario)
    fields = {key: key for key, x in ToTree(given).items() if x is None}
    if hasattr(derived, "Psi0"):
        fields = {"initial_psi": "Psi0"}
    path = scenario.controller.path
    return PointOverrides(
        {f"{path}.{key}": ToTree(getattr(derived, x)) for key, x in fields.items()}
    )


def Spread(result: tuning.TuningResult) -> dict[int, Gains]:
    """Returns members of a front by number, but for the gains by rule."""
    logs = np.log([result.Scores(trial) for trial in result.front])
    chosen = [result.front.index(result.best)]
    while len(chosen) < min(MEMBERS, len(logs)):
        apart = np.linalg.norm(logs[:, None] - logs[chosen], axis=2).min(axis=1)
        chosen.append(int(apart.argmax()))
    members = enumerate((result.front[i].gains for i in chosen), 1)
    return {number: gains for number, gains in members if gains}


def MakeRows(name: str, folder: Path) -> list[Row]:
    """Searches for the gains of an architecture, and does its held-out runs."""
    kind, *words = ENTRIES[name].split()
    gains = [word for word in words if ":" in word]
    members: dict[int, Gains] = {0: {}}
    if gains:
        search = {"minimize": GOALS, "evaluations": EVALUATIONS}
        training = _Study("league", name, {})
        plan = tuning.PlanTuning(training, controller=kind, gains=gains, **search)
        members |= Spread(tuning.RunTuning(plan, out=folder / "search", resume=True))
    return [
        {"architecture": name, "member": number, "gains": member, "runs": group}
        | HeldOut(name, member, group, folder / f"member-{number}")
        for number, member in members.items()
        for group in GROUPS
    ]


def HeldOut(name: str, gains: Gains, group: str, folder: Path | None = None) -> Row:
    """Returns the COUNTS and NUMBERS of a group of held-out runs."""
    values = []
    for title, plan in _Study("league_held_out", name, gains, group).plans.items():
        result = RunSweep(plan, out=folder and folder / title, resume=bool(folder))
        for point, run in zip(plan.points, result.Table(), strict=True):
            scenario = plan.source.Load([*plan.overrides, *PointOverrides(point)])
            values.append(_Numbers(scenario, run))
    bounded, at_rest, *numbers = np.transpose(values)
    counts = (len(values), int(bounded.sum()), int(at_rest.sum()))
    means = [float(f"{x.mean():.4g}") for x in numbers]
    return dict(zip(COUNTS + NUMBERS, [*counts, *means], strict=True))


def _Numbers(scenario: Scenario, run: Row) -> tuple[float, ...]:
    """Returns whether a run is bounded and comes to rest, and its NUMBERS."""
    speed = float(np.linalg.norm(scenario.surgeon.velocity))
    bone = scenario.environment.layers[-1]
    mass = 1 / np.linalg.inv(scenario.Facts().inertia)[0, 0]
    free = speed * np.sqrt(bone.stiffness * mass)
    direct = (bone.start - scenario.robot.start[0]) / speed
    rest = run["collision.rest_time"]
    return (
        run["status"] == "completed",
        rest is not None,
        scenario.duration if rest is None else rest,
        (run["collision.peak_force"] or np.inf) / free,
        (run["collision.time"] or np.inf) / direct,
        FeltStiffnessLoss(scenario),
        run["coordination_rms_error.x"] / speed,
        run["control_force_variation.x"] / scenario.surgeon.contact_force[0],
    )


def ReadTable() -> list[Row]:
    """Returns the rows of league.csv."""
    types = {"architecture": str, "runs": str, "gains": json.loads}
    rows = csv.DictReader(TABLE.read_text(encoding="utf-8").splitlines())
    return [{k: types.get(k, float)(x) for k, x in row.items()} for row in rows]


def PageRows(rows: list[Row]) -> list[list[str]]:
    """Returns the cells of the table in docs/architectures.md: members 0 and 1."""
    return [
        [
            row["architecture"] + (", by search" if row["member"] else ""),
            *(f"{row[k]:g}" for k in ("bounded", "at_rest")),
            *(f"{row[k]:.3g}".replace("inf", "-") for k in NUMBERS),
        ]
        for row in rows
        if row["runs"] == "all" and row["member"] < 2
    ]


def OneAxis(name: str, round_trip: float) -> Scenario:
    """Returns one_dof with an architecture by rule."""
    return LoadScenario("one_dof", [*_Settings(name), f"delay={round_trip / 2}"])


def FeltRows() -> list[list[str]]:
    """Returns the cells of the table of felt stiffness, N/m, in architectures.md."""
    rows = []
    for name in FELT:
        scenario = OneAxis(name, FELT_DELAY)
        point = OperatingPoints(scenario)[-1]
        felt = FeltStiffness(scenario, point, FELT_FREQUENCIES)
        rows.append([name, *(f"{k:.3g}" for k in felt)])
    return rows


def DrawFelt() -> Figure:
    """Draws the felt stiffness against the frequency for three round trips."""
    return PlotFeltStiffness(
        {
            f"round trip {trip:g} s": {name: OneAxis(name, trip) for name in FELT}
            for trip in (0.04, FELT_DELAY, 0.5)
        }
    )


def Draw(rows: list[Row]) -> Figure:
    """Draws the members that stay bounded in every held-out run."""
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    colors = (2 * COLORS)[: len(ENTRIES)]
    styles = dict(zip(ENTRIES, zip(colors, "osh*p^vDPX<>", strict=True), strict=True))
    for name, (color, marker) in styles.items():
        right.plot([], [], marker, color=color, label=name)
    for row in rows:
        if row["runs"] == "all" and row["bounded"] == row["count"]:
            color, marker = styles[row["architecture"]]
            style = {"color": color, "mfc": color if row["member"] else "none"}
            style["ms"] = 8 if row["member"] < 2 else 4
            left.plot(row["rest"], 1 - row["softness"], marker, **style)
            right.plot(row["arrival"], row["impact"], marker, **style)
    left.set(xlabel="at rest on the bone after [s]", xscale="log")
    left.set_ylabel("share of the bone's stiffness felt at 1 rad/s")
    right.set_xlabel("time to the bone, in multiples of the commanded")
    right.set_ylabel("largest force, in multiples of a free mass's")
    figure.legend(loc="outside lower center", ncols=5, fontsize=8)
    return figure


def main() -> None:
    """Does what is missing of all runs, and writes the table and the figure."""
    folders = [Path(sys.argv[1], name.replace(" ", "_")) for name in ENTRIES]
    # A process each: Drake before 1.56 frees no diagram with a block in Python.
    with ProcessPoolExecutor(2, get_context("spawn"), max_tasks_per_child=1) as pool:
        parts = list(pool.map(MakeRows, ENTRIES, folders))
    WriteCsv(TABLE, [row for part in parts for row in part])
    SaveFigure(Draw(ReadTable()), PICTURE)
    SaveFigure(DrawFelt(), FELT_PICTURE)


if __name__ == "__main__":
    main()

"""The sensitivity study: what the parameters that the thesis leaves open do."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure

from teleop_drake.figures.style import COLORS, FONT_SIZE, WIDTH, FormatAxes
from teleop_drake.tasks.metrics import RunMetrics
from teleop_drake.thesis.claims.requests import ADAPTIVE, DIRECT, SHORT
from teleop_drake.thesis.runs import ThesisRuns
from teleop_drake.thesis.studies.study import Study

_TASKS = ("one_dof", "two_dof_collision", "two_dof_combined")


_NUMBERS = (
    ("start overshoot", "start_velocity_overshoot"),
    ("puncture overshoot", "puncture.velocity_overshoot"),
    ("puncture force", "puncture.force"),
    ("first impact", "collision.initial_impact_force"),
    ("largest force", "collision.peak_force"),
    ("rebound", "collision.rebound_velocity"),
    ("settling time", "collision.settling_time"),
)


@dataclass(frozen=True, kw_only=True)
class _Change:
    """One parameter at one other value."""

    parameter: str
    chosen: str
    value: str
    task: str
    overrides: dict[str, Any]


def _Changes() -> list[_Change]:
    psi = (
        "fitted to the printed overshoot of 0.26 mm/s; 3 in tissue, 2 outside are exact"
    )
    psi_arm = "(I + Lambda D_e) M_r^-1 at the start pose, the meaning of (5.52)"
    count = "assumed: five, a spacing that resolves the layers"
    width = "assumed: one spacing, so that neighbours overlap"
    span = "assumed: the range of the task"
    upsilon = "1, the most that (4.52) allows; without effect here"
    psi_min = "assumed: well below every Psi that occurs"
    elbow = "assumed: both solutions exist"
    rate = "given: 0.1; tried to see what adaptation does"
    lattice = "controller.network"
    one, two, three = "one_dof", "two_dof_collision", "two_dof_combined"
    listed: list[tuple[str, str, str, str, dict[str, Any]]] = [
        ("Psi0", psi, "2", one, {"controller.initial_psi": 2.0}),
        ("Psi0", psi, "3", one, {"controller.initial_psi": 3.0}),
        ("Psi0", psi, "6", one, {"controller.initial_psi": 6.0}),
        ("Psi0", psi_arm, "4 I", two, {"controller.initial_psi": 4.0}),
        ("Psi0", psi_arm, "4 I", three, {"controller.initial_psi": 4.0}),
        ("lattice count", count, "3", one, {f"{lattice}.count": [3]}),
        ("lattice count", count, "15", one, {f"{lattice}.count": [15]}),
        ("lattice width", width, "0.5", one, {f"{lattice}.width": 0.5}),
        ("lattice width", width, "2", one, {f"{lattice}.width": 2.0}),
        (
            "lattice range",
            span,
            "-0.015 to 0.03 m",
            one,
            {f"{lattice}.lower": [-0.015], f"{lattice}.upper": [0.03]},
        ),
        ("Upsilon", upsilon, "0", one, {"controller.supervision": 0.0}),
        ("Psi_min", psi_min, "1 1/kg", one, {"controller.minimum_psi": 1.0}),
        ("elbow", elbow, "up", three, {"robot.elbow": "up"}),
        ("adaptation rate", rate, "0", one, {"controller.adaptation_rate": 0.0}),
        ("adaptation rate", rate, "1", one, {"controller.adaptation_rate": 1.0}),
        ("adaptation rate", rate, "0", three, {"controller.adaptation_rate": 0.0}),
    ]
    return [
        _Change(
            parameter=parameter,
            chosen=chosen,
            value=value,
            task=task,
            overrides={**ADAPTIVE, **SHORT[task], **overrides},
        )
        for parameter, chosen, value, task, overrides in listed
    ]


def _Metric(metrics: dict[str, Any], path: str) -> float:
    """Returns a metric by its dotted name, NaN if the run lacks it."""
    value: Any = metrics
    for part in path.split("."):
        value = None if value is None else value[part]
    return math.nan if value is None else float(value)


_Metrics = dict[str, Any]
_Tried = list[tuple[_Change, _Metrics]]


def SensitivityStudy(runs: ThesisRuns) -> Study:
    """Moves every open parameter of the adaptive controller over a plausible range."""
    changes = _Changes()
    base_requests = {task: {**ADAPTIVE, **SHORT[task]} for task in _TASKS}
    runs.Prefetch(base_requests.items())
    runs.Prefetch((c.task, c.overrides) for c in changes)
    base = {
        task: RunMetrics(runs(task, **overrides))
        for task, overrides in base_requests.items()
    }
    direct = {task: RunMetrics(runs(task, **DIRECT)) for task in _TASKS}
    tried = [
        (change, RunMetrics(runs(change.task, **change.overrides)))
        for change in changes
    ]
    relative = [
        [
            _Metric(metrics, path) / _Metric(base[change.task], path) - 1
            for _, path in _NUMBERS
        ]
        for change, metrics in tried
    ]
    settled = _Metric(base["one_dof"], "collision.time") + _Metric(
        base["one_dof"], "collision.settling_time"
    )
    headers = ["parameter", "how chosen", "value tried", "task"]
    return Study(
        title="Sensitivity to what the thesis leaves open",
        text=_Text(tried, direct, relative, settled),
        figures={"sensitivity": _Plot(changes, relative)},
        table=(
            [*headers, *(name for name, _ in _NUMBERS)],
            _Rows(tried, relative, settled),
        ),
    )


def _Rows(
    tried: _Tried, relative: list[list[float]], settled: float
) -> list[list[str]]:
    """Returns the table, a row for each value that was tried."""
    rows = [
        [
            change.parameter,
            change.chosen,
            change.value,
            change.task,
            *(
                _Percent(value, metrics, path)
                for value, (_, path) in zip(values, _NUMBERS, strict=True)
            ),
        ]
        for (change, metrics), values in zip(tried, relative, strict=True)
    ]
    rows.append(
        [
            "stop time",
            "assumed: beyond the shown time",
            f"after {settled:.3g} s",
            "one_dof",
            *("none" for _ in _NUMBERS),
        ]
    )
    return rows


def _Conclusions(
    tried: _Tried, direct: dict[str, _Metrics]
) -> tuple[list[str], list[str]]:
    """Returns what holds with every value tried, and what depends on the choice."""

    def Ratio(change: _Change, metrics: _Metrics, path: str) -> float:
        return _Metric(metrics, path) / _Metric(direct[change.task], path)

    conclusions: list[tuple[str, Callable[[_Change, _Metrics], bool]]] = [
        (
            "it overshoots at the start, by 5 % of v_d or more",
            lambda c, m: (
                m["start_velocity_overshoot"]
                > 0.05 * (1e-3 if c.task == "one_dof" else 0.1)
            ),
        ),
        (
            "it overshoots less than direct force at the puncture",
            lambda c, m: m["puncture"] is None or Ratio(c, m, _NUMBERS[1][1]) < 1,
        ),
        (
            "with one axis and in case III its first impact is harder than that of "
            "direct force",
            lambda c, m: (
                c.task == "two_dof_collision" or Ratio(c, m, _NUMBERS[3][1]) > 1
            ),
        ),
        (
            "its first impact is much weaker in case II",
            lambda c, m: (
                c.task != "two_dof_collision" or Ratio(c, m, _NUMBERS[3][1]) < 0.75
            ),
        ),
        (
            "its largest force is lower than that of direct force",
            lambda c, m: Ratio(c, m, _NUMBERS[4][1]) < 1,
        ),
        (
            "it comes to rest on the bone",
            lambda c, m: m["collision"]["settling_time"] is not None,
        ),
    ]
    firm, soft = [], []
    for statement, holds in conclusions:
        failures = [
            f"{change.parameter} {change.value} ({change.task})"
            for change, metrics in tried
            if not holds(change, metrics)
        ]
        if failures:
            soft.append(f"{statement} (not with {', '.join(failures)})")
        else:
            firm.append(statement)
    return firm, soft


def _LargestChanges(tried: _Tried, relative: list[list[float]]) -> dict[str, float]:
    """Returns the largest change of any number with one axis, by the parameter."""
    most: dict[str, float] = {}
    for (change, _), values in zip(tried, relative, strict=True):
        if change.task == "one_dof":
            finite = [abs(value) for value in values if math.isfinite(value)]
            most[change.parameter] = max(most.get(change.parameter, 0.0), *finite)
    return most


def _Text(
    tried: _Tried,
    direct: dict[str, _Metrics],
    relative: list[list[float]],
    settled: float,
) -> str:
    firm, soft = _Conclusions(tried, direct)
    most = _LargestChanges(tried, relative)
    adapted = most.pop("adaptation rate")
    ranking = ", ".join(
        f"{parameter} {100 * value:.2g} %"
        for parameter, value in sorted(most.items(), key=lambda item: -item[1])
    )
    return (
        "Every parameter that the thesis leaves open, how it was chosen, and how far "
        "each number of the adaptive controller moves if it is chosen otherwise. The "
        "table shows changes relative to the scenario as it is. Direct force has none "
        "of these parameters but elbow and stop time."
        "\n\n"
        f"The largest change of any number with one axis: {ranking}. Psi0 decides: it "
        "sets the gain Psi0^-1 G1 of the law. What the networks look like hardly "
        "matters, because at the given adaptation rate they contribute next to "
        "nothing; the rate itself, which the thesis does state, is listed to show this "
        f"(up to {100 * adapted:.2g} % between 0 and ten times the given one). The "
        "reflected elbow reflects the motion along y and changes nothing along x. "
        "Every number is "
        f"taken before {settled:.3g} s, when the tool has settled: a final stop after "
        "that changes none."
        "\n\n"
        "What holds for the adaptive controller with every value tried: "
        + "; ".join(firm)
        + "."
        + ("\n\nWhat depends on the choice: " + "; ".join(soft) + "." if soft else "")
    )


def _Plot(changes: list[_Change], relative: list[list[float]]) -> Figure:
    figure = Figure(figsize=(WIDTH, 0.24 * len(relative) + 1.2), layout="constrained")
    ax = figure.subplots()
    FormatAxes(ax)
    for i, (name, _) in enumerate(_NUMBERS):
        ax.plot(
            [100 * values[i] for values in relative],
            range(len(relative)),
            linestyle="none",
            marker="os^vDPX"[i],
            markersize=4,
            alpha=0.8,
            color=COLORS[i],
            label=name,
        )
    ax.axvline(0.0, color="#808080", linewidth=0.8, zorder=0)
    ax.set_xscale("symlog", linthresh=1.0)
    ax.set_yticks(
        range(len(relative)),
        [f"{c.parameter} {c.value}, {c.task}" for c in changes],
        fontsize=FONT_SIZE,
    )
    ax.invert_yaxis()
    ax.set_xlabel("change [%], linear within 1 %", fontsize=FONT_SIZE)
    ax.set_ylabel("parameter, value, task", fontsize=FONT_SIZE)
    figure.legend(
        loc="outside upper center", ncols=4, fontsize=FONT_SIZE, frameon=False
    )
    return figure


def _Percent(change: float, metrics: dict[str, Any], path: str) -> str:
    if math.isfinite(change):
        return f"{100 * change:+.2f} %"
    if path.startswith("puncture") and metrics["puncture"] is None:
        return "no puncture"
    return "never" if path.endswith("settling_time") else "none"


REQUESTS: list[tuple[str, dict[str, Any]]] = [
    *((task, {**ADAPTIVE, **SHORT[task]}) for task in _TASKS),
    *((change.task, change.overrides) for change in _Changes()),
    *((task, dict(DIRECT)) for task in _TASKS),
]
"""The runs that the study looks at, as ThesisRuns.Prefetch takes them."""

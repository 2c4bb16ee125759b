"""How fast a drive has to be: `python notebooks/drive_bandwidth.py`.

Cases II and III of the thesis with both of its controllers, 0.1 s each way, and a drive
whose force lags by a first order. Prints the table of the documentation, and draws
teleop_drake/docs/drive_bandwidth.png or the file that is named.
"""

import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import CONTROLLERS, LoadScenario
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.study.figures.saving import SaveFigure
from teleop_drake.study.figures.style import FONT_SIZE, WIDTH, FormatAxes, RunStyle
from teleop_drake.study.sweep import FlattenMetrics

PICTURE = Path(__file__).parent.parent / "teleop_drake/docs/drive_bandwidth.png"

CASES = {"two_dof_collision": "case II", "two_dof_combined": "case III"}

BANDWIDTHS = (None, 300.0, 100.0, 50.0, 30.0, 20.0, 15.0, 10.0, 7.0, 5.0)
"""In rad/s; None: an ideal drive."""

METRICS = {
    "start_velocity_overshoot": "overshoot at the start [m/s]",
    "collision.initial_impact_force": "first impact [N]",
    "collision.settling_time": "settles after [s]",
}

Row = dict[str, float | None]


def Measure(case: str, controller: str, bandwidth: float | None) -> Row:
    """Returns METRICS of a run, and when it runs away (`diverged_at`), if it does.

    Args:
        case: One of CASES.
        controller: Its kind.
        bandwidth: Of the drive in rad/s; None: ideal.
    """
    overrides = {"controller.kind": controller, "actuator.bandwidth": bandwidth}
    metrics = FlattenMetrics(
        RunMetrics(simulate(LoadScenario(case, overrides), engine="auto"))
    )
    return {name: metrics.get(name) for name in (*METRICS, "diverged_at")}


def Cells(row: Row) -> list[str]:
    """Returns what the table says of a run: three digits, a dash for none."""
    if row["diverged_at"] is not None:
        return ["runs away"] * len(METRICS)
    values = (row[name] for name in METRICS)
    return ["-" if x is None else f"{x:.3g}" for x in values]


def TableLine(bandwidth: float | None, rows: Iterable[Row]) -> str:
    """Returns a line of the table.

    Args:
        bandwidth: In rad/s; None: ideal.
        rows: Of case II and of case III, direct force before adaptive.
    """
    name = "ideal" if bandwidth is None else f"{bandwidth:g}"
    # Of direct force the impact is enough: it never comes to rest.
    cells = [name]
    for i, row in enumerate(rows):
        cells += Cells(row)[1:2] if i % 2 == 0 else Cells(row)
    return f"| {' | '.join(cells)} |"


def Plot(rows: dict[tuple[str, str, float | None], Row]) -> Figure:
    """Draws METRICS against the bandwidth; what runs away is a cross above."""
    figure = Figure(figsize=(WIDTH, 0.6 * WIDTH), layout="constrained")
    engine = figure.get_layout_engine()
    assert isinstance(engine, ConstrainedLayoutEngine)
    engine.set(h_pad=0.1)
    axes = figure.subplots(len(CASES), len(METRICS), sharex=True, squeeze=False)
    widths = [w for w in BANDWIDTHS if w is not None]
    for (i, j), ax in np.ndenumerate(axes):
        case, metric = list(CASES)[i], list(METRICS)[j]
        FormatAxes(ax)
        ax.set_xscale("log")
        ax.set_xticks([5, 10, 30, 100, 300], ["5", "10", "30", "100", "300"])
        ax.minorticks_off()
        for k, controller in enumerate(CONTROLLERS):
            style = RunStyle(k)
            runs = [rows[case, controller, w] for w in widths]
            is_lost = np.array([run["diverged_at"] is not None for run in runs])
            values = np.array([run[metric] for run in runs], dtype=float)
            label = controller.replace("_", " ")
            shown = np.where(is_lost, np.nan, values)
            ax.plot(widths, shown, marker=".", markersize=4, label=label, **style)
            lost = np.array(widths)[is_lost]
            ax.plot(
                lost,
                np.full(len(lost), 1.04),
                transform=ax.get_xaxis_transform(),
                clip_on=False,
                in_layout=False,
                linestyle="none",
                marker="x",
                markersize=4,
                color=style["color"],
            )
        if i == 0:
            ax.set_title(METRICS[metric], fontsize=FONT_SIZE, pad=12)
        if i == len(CASES) - 1:
            ax.set_xlabel("bandwidth of the drive [rad/s]", fontsize=FONT_SIZE)
        if j == 0:
            ax.set_ylabel(CASES[case], fontsize=FONT_SIZE)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    cross = Line2D([], [], linestyle="none", marker="x", markersize=4, color="black")
    figure.legend(
        [*handles, cross],
        [*labels, "runs away"],
        loc="outside upper center",
        ncols=3,
        frameon=False,
        fontsize=FONT_SIZE,
    )
    return figure


def Main(path: Path) -> None:
    """Prints the table and writes the picture."""
    rows = {
        (case, controller, w): Measure(case, controller, w)
        for w in BANDWIDTHS
        for case in CASES
        for controller in CONTROLLERS
    }
    for w in BANDWIDTHS:
        print(TableLine(w, [rows[c, k, w] for c in CASES for k in CONTROLLERS]))
    SaveFigure(Plot(rows), path)


if __name__ == "__main__":
    Main(Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURE)

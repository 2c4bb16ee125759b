"""Figures of sweeps: pure functions of results, like those of figures.runs."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from teleop_drake.figures.style import (
    FONT_SIZE,
    GREY,
    SMALL_FONT_SIZE,
    WIDTH,
    Figure,
    FormatAxes,
    RunStyle,
)
from teleop_drake.figures.sweep_grid import (
    MAX_NAMED_LINES,
    MetricScale,
    SweepGrid,
    ValueLabel,
)
from teleop_drake.figures.sweep_maps import PlotMap, PlotStability
from teleop_drake.sweep import SweepResult, VariesSeedsOnly
from teleop_drake.sweep.statistics import CONTROLLERS, SEED, Bands, MedianInterval
from teleop_drake.validation import Refuse

__all__ = ["PlotMap", "PlotSeeds", "PlotStability", "PlotSweep"]


def PlotSweep(result: SweepResult, *metrics: str) -> Figure:
    """Plots metrics of a sweep against the delay.

    A metric has a panel with a line for each controller; or, where more is varied, a
    panel for each and a line for each of the other values. A line is the median over
    the seeds; the band around it holds 90 % of the runs, and bars are the bootstrap
    interval of the median. Runs that diverged or have no such number (a tool that never
    settles, for instance) are marked above the panel instead.

    If no delay is varied, the first numbers that are take its place.

    Args:
        *metrics: Of MetricUnits(result.scenario), one or more, for example
            "collision.peak_force".

    Raises:
        ValueError: If there is no such metric, no number is varied, or it would take
            too many panels.
    """
    grid = SweepGrid(result)
    figure, panels = grid.MakePanels(len(metrics))
    marks: dict[str, Line2D] = {}
    for metric, axes in zip(metrics, panels, strict=True):
        marks |= _DrawMetric(grid, result, metric, axes)
    for axes in panels:
        grid.AddTitles(axes, num_marks=grid.shape[2] if marks else 0)
    handles = [marks[label] for label in _MARKS if label in marks]
    grid.AddLegend(figure, handles + (_BandHandles() if grid.shape[-1] > 1 else []))
    return figure


# The marks of runs that a line lacks.
_MARKS = {"diverges": "x", "fails": "^", "has none": "o"}


def _DrawMetric(
    grid: SweepGrid, result: SweepResult, metric: str, axes: np.ndarray
) -> dict[str, Line2D]:
    """Draws a metric into its panels; returns the legend's entries of the marks."""
    values, status = grid.Arrange(result.Values(metric)), grid.Arrange(result.Status())
    is_diverged = status == "diverged"
    # What a run did until it was stopped says little.
    is_shown = ~is_diverged | metric.startswith("diverged")
    values = np.where(is_shown, values, np.nan)
    is_missing = (status == "completed") & np.isnan(values)
    if metric.startswith("diverged"):
        is_missing[:] = False
    scale, label, _ = MetricScale(result, metric, values)
    # Where there are more lines, the stability map tells of them.
    marked = {}
    if values.shape[2] <= MAX_NAMED_LINES:
        found = (is_diverged, status == "failed", is_missing)
        marked = dict(zip(_MARKS.items(), found, strict=True))
    for index, ax in np.ndenumerate(axes):
        FormatAxes(ax)
        for i in range(values.shape[2]):
            style = grid.LineStyle(i)
            y = values[(*index, i)] * scale
            middle = Bands(y, np.median)
            ax.plot(grid.x, middle, marker=".", markersize=3, **style)
            if y.shape[1] > 1:
                _DrawBand(ax, grid.x, y, middle, style["color"])
            for (_, marker), where in marked.items():
                x = grid.x[where[(*index, i)].any(axis=1)]
                ax.plot(
                    x,
                    np.full(len(x), 1.03 + 0.035 * i),
                    transform=ax.get_xaxis_transform(),
                    clip_on=False,
                    in_layout=False,
                    **_SweepMark(marker, style["color"]),
                )
    for ax in axes[:, 0]:
        ax.set_ylabel(label, fontsize=FONT_SIZE)
    return {
        name: Line2D([], [], label=name, **_SweepMark(marker, GREY))
        for (name, marker), where in marked.items()
        if where.any()
    }


def _DrawBand(
    ax: Axes, x: np.ndarray, values: np.ndarray, median: np.ndarray, color: Any
) -> None:
    """Draws how values (x, seeds) scatter, and how well their median is known."""
    low = Bands(values, lambda y: np.quantile(y, 0.05))
    high = Bands(values, lambda y: np.quantile(y, 0.95))
    ax.fill_between(x, low, high, color=color, alpha=0.2, linewidth=0)
    ends = [
        Bands(values, lambda y: MedianInterval(y)[0]),
        Bands(values, lambda y: MedianInterval(y)[1]),
    ]
    known = np.isfinite(ends[0])
    errors = np.abs(np.array(ends) - median)[:, known]
    ax.errorbar(
        x[known],
        median[known],
        errors,
        color=color,
        fmt="none",
        linewidth=0.8,
        capsize=2,
    )


def _BandHandles() -> list[Any]:
    """Returns what the legend says of a band and of its bars."""
    return [
        Patch(color=GREY, alpha=0.4, linewidth=0, label="5 to 95 % of the seeds"),
        Line2D([], [], color=GREY, marker="|", linewidth=0.8, label=_INTERVAL),
    ]


def PlotSeeds(result: SweepResult, *metrics: str) -> Figure:
    """Plots metrics of a sweep that varies the seed, and at most the controller.

    Each metric has a panel. A dot is a run; a line is the median, and a bar its
    bootstrap interval. A note tells how many runs of a controller have no such
    number.

    Args:
        *metrics: Of MetricUnits(result.scenario), one or more.

    Raises:
        ValueError: If there is no such metric, or something else is varied.
    """
    if not VariesSeedsOnly(result):
        keys = ", ".join(result.axes)
        Refuse("result", f"over {keys}", "over seeds, and controllers at most")
    num_columns = min(len(metrics), 2)
    num_rows = math.ceil(len(metrics) / num_columns)
    figure = Figure(figsize=(WIDTH, 0.6 + 2.4 * num_rows), layout="constrained")
    panels = figure.subplots(num_rows, num_columns, squeeze=False).ravel()
    for ax, metric in zip(panels, metrics, strict=False):
        _DrawSeeds(ax, result, metric)
    for ax in panels[len(metrics) :]:
        ax.remove()
    handles = [
        Line2D([], [], color=GREY, marker=".", linestyle="none", label="a run"),
        Line2D([], [], color=GREY, label="median"),
        Line2D([], [], color=GREY, linewidth=2.4, label=_INTERVAL),
    ]
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=3,
        fontsize=SMALL_FONT_SIZE,
        frameon=False,
    )
    return figure


def _DrawSeeds(ax: Axes, result: SweepResult, metric: str) -> None:
    """Draws one panel of PlotSeeds."""
    is_complete = result.Status() == "completed"
    values = np.where(is_complete, result.Values(metric), np.nan)
    # One row for each controller.
    seeds = list(result.axes).index(SEED)
    values = np.moveaxis(values, seeds, -1).reshape(-1, len(result.axes[SEED]))
    names = next(
        (result.axes[key] for key in CONTROLLERS if key in result.axes),
        [result.scenario.controller.kind],
    )
    scale, y_label, _ = MetricScale(result, metric, values)
    FormatAxes(ax)
    labels = []
    for i, (name, row) in enumerate(zip(names, values, strict=True)):
        color = RunStyle(i)["color"]
        y = row[np.isfinite(row)] * scale
        # Side by side, in the order of the seeds, so that dots do not hide each other.
        x = i + np.linspace(-0.3, 0.3, len(row))[np.isfinite(row)]
        ax.plot(x, y, ".", markersize=3, color=color, alpha=0.7)
        if y.size:
            ends = [i - 0.35, i + 0.35]
            ax.plot(ends, [np.median(y)] * 2, color=color, linewidth=1.2)
            ax.vlines(i, *MedianInterval(y), color=color, linewidth=2.4)
        missing = len(row) - y.size
        if missing:
            ax.text(
                i,
                0.02,
                f"none in\n{missing} of {len(row)}",
                transform=ax.get_xaxis_transform(),
                fontsize=SMALL_FONT_SIZE,
                color=GREY,
                horizontalalignment="center",
                verticalalignment="bottom",
            )
        labels.append(ValueLabel(name).replace(" ", "\n", 1))
    ax.set_xticks(range(len(names)), labels, fontsize=SMALL_FONT_SIZE)
    ax.set_xlim(-0.6, len(names) - 0.4)
    ax.set_ylabel(y_label, fontsize=FONT_SIZE)


_INTERVAL = "95 % interval of the median (bootstrap)"


def _SweepMark(marker: str, color: Any) -> dict[str, Any]:
    return {
        "marker": marker,
        "markersize": 3.5,
        "color": color,
        "markerfacecolor": "none",
        "markeredgewidth": 0.8,
        "linestyle": "none",
    }

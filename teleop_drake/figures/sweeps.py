"""Figures of sweeps, with lines and dots: pure functions of results."""

import math
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from teleop_drake.arrays import Array
from teleop_drake.figures import style
from teleop_drake.figures.layout import MakePanels, Panels
from teleop_drake.figures.style import GREY, SMALL_FONT_SIZE, Figure, Key, Look
from teleop_drake.figures.sweep_grid import MAX_NAMED_LINES, MetricScale, SweepGrid
from teleop_drake.sweep import SweepResult, VariesSeedsOnly
from teleop_drake.sweep.statistics import CONTROLLERS, SEED, Bands, MedianInterval
from teleop_drake.validation import Refuse

# The marks of runs that a line lacks.
_MARKS = {"diverges": "x", "fails": "^", "has none": "o"}
_MARK_STYLE: Look = {
    "markersize": 3.5,
    "markerfacecolor": "none",
    "markeredgewidth": 0.8,
    "linestyle": "none",
}

_INTERVAL = "95 % interval of the median (bootstrap)"


def PlotSweep(result: SweepResult, *metrics: str) -> Figure:
    """Plots metrics of a sweep against the delay.

    A metric has a panel with a line for each controller; or, where more is varied, a
    panel for each and a line for each of the other values. A line is the median over
    the seeds; the band around it holds 90 % of the runs, and bars are the bootstrap
    interval of the median. Runs that diverged or have no such number (a tool that never
    settles, for instance) are marked above the panel instead.

    If no delay is varied, the first numbers that are take its place.

    Args:
        *metrics: Of MetricUnits(result.scenario), for example "collision.peak_force".
            Without any, the most used metrics that the runs have.

    Raises:
        ValueError: If there is no such metric, no number is varied, or it would take
            too many panels.
    """
    metrics = metrics or tuple(result.Metrics())
    grid = SweepGrid(result)
    figure, panels = grid.MakePanels(len(metrics))
    marked: set[str] = set()
    for metric, axes in zip(metrics, panels, strict=True):
        marked |= _DrawMetric(grid, result, metric, axes)
    grid.AddTitles(panels, num_marks=grid.shape[2] if marked else 0)
    lines = grid.LineHandles()
    handles: list[Any] = [
        Key(name, marker=marker, color=GREY, **_MARK_STYLE)
        for name, marker in _MARKS.items()
        if name in marked
    ]
    if grid.shape[-1] > 1:
        handles += [
            Patch(color=GREY, alpha=0.4, linewidth=0, label="5 to 95 % of the seeds"),
            Key(_INTERVAL, color=GREY, marker="|", linewidth=0.8),
        ]
    ncols = min(len(lines) + len(handles), 4)
    style.AddLegend(figure, [*lines, *handles], ncols=ncols, fontsize=SMALL_FONT_SIZE)
    return figure


def _DrawMetric(
    grid: SweepGrid, result: SweepResult, metric: str, axes: Panels
) -> set[str]:
    """Draws a metric into its panels; returns the names of the marks there."""
    values = grid.Arrange(result.Values(metric))
    status = grid.Arrange(result.Status())
    is_diverged = status == "diverged"
    is_missing = (status == "completed") & np.isnan(values)
    if metric.startswith("diverged"):
        is_missing[:] = False
    else:  # What a run did until it was stopped says little.
        values = np.where(is_diverged, np.nan, values)
    scale, label, _ = MetricScale(result, metric, values)
    # Where there are more lines, the stability map tells of them.
    found = (is_diverged, status == "failed", is_missing)
    marked = dict(zip(_MARKS, found, strict=True))
    if values.shape[2] > MAX_NAMED_LINES:
        marked = {}
    for *index, i in np.ndindex(values.shape[:3]):
        ax = axes[tuple(index)]
        line = grid.LineStyle(i)
        if i == 0:
            style.FormatAxes(ax)
        y = values[(*index, i)] * scale
        middle = Bands(y, np.median)
        ax.plot(grid.x, middle, marker=".", markersize=3, **line)
        if y.shape[1] > 1:
            _DrawBand(ax, grid.x, y, middle, line["color"])
        for name, where in marked.items():
            x = grid.x[where[(*index, i)].any(axis=1)]
            height = 1.03 + 0.035 * i
            look = {"marker": _MARKS[name], "color": line["color"]}
            style.MarkAbove(ax, x, height, **_MARK_STYLE, **look)
    for ax in axes[:, 0]:
        ax.set_ylabel(label)
    return {name for name, where in marked.items() if where.any()}


def _DrawBand(ax: Axes, x: Array, values: Array, median: Array, color: Any) -> None:
    """Draws how values (x, seeds) scatter, and how well their median is known."""
    low, high = (Bands(values, partial(np.quantile, q=q)) for q in (0.05, 0.95))
    ax.fill_between(x, low, high, color=color, alpha=0.2, linewidth=0)
    known = np.isfinite(values).sum(axis=1) > 1
    ends = np.array([MedianInterval(y[np.isfinite(y)]) for y in values[known]]).T
    bars: Look = {"fmt": "none", "linewidth": 0.8, "capsize": 2}
    if known.any():
        error = np.abs(ends - median[known])
        ax.errorbar(x[known], median[known], error, color=color, **bars)


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
    figure, axes = MakePanels(num_rows, num_columns, height=0.6 + 2.4 * num_rows)
    panels = axes.ravel()
    for ax, metric in zip(panels, metrics, strict=False):
        _DrawSeeds(ax, result, metric)
    for ax in panels[len(metrics) :]:
        ax.remove()
    handles = [
        Key("a run", color=GREY, marker=".", linestyle="none"),
        Key("median", color=GREY),
        Key(_INTERVAL, color=GREY, linewidth=2.4),
    ]
    style.AddLegend(figure, handles, ncols=3, fontsize=SMALL_FONT_SIZE)
    return figure


def _DrawSeeds(ax: Axes, result: SweepResult, metric: str) -> None:
    """Draws one panel of PlotSeeds."""
    values = np.where(result.Status() == "completed", result.Values(metric), np.nan)
    # One row for each controller.
    seeds = list(result.axes).index(SEED)
    values = np.moveaxis(values, seeds, -1).reshape(-1, len(result.axes[SEED]))
    own = [result.scenario.controller.kind]
    names = next((result.axes[key] for key in CONTROLLERS if key in result.axes), own)
    scale, y_label, limits = MetricScale(result, metric, values)
    style.FormatAxes(ax)
    ax.set_ylim(style.Widen(limits, scale))
    for i, row in enumerate(values):
        color = style.RunColor(i)
        y = row[np.isfinite(row)] * scale
        # Side by side, in the order of the seeds, so that dots do not hide each other.
        x = i + np.linspace(-0.3, 0.3, len(row))[np.isfinite(row)]
        ax.plot(x, y, ".", markersize=3, color=color, alpha=0.7)
        if y.size:
            ends = [i - 0.35, i + 0.35]
            ax.plot(ends, [np.median(y)] * 2, color=color, linewidth=1.2)
            ax.vlines(i, *MedianInterval(y), color=color, linewidth=2.4)
        missing = len(row) - y.size
        if missing > 0:
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
    labels = [style.ValueLabel(name).replace(" ", "\n", 1) for name in names]
    ax.set_xticks(range(len(names)), labels, fontsize=SMALL_FONT_SIZE)
    ax.set_xlim(-0.6, len(names) - 0.4)
    ax.set_ylabel(y_label)

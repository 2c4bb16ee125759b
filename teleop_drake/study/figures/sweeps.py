"""Figures of sweeps as lines and dots: pure functions of results."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import CheckKind
from teleop_drake.study.figures import style
from teleop_drake.study.figures.style import GREY, SMALL_FONT_SIZE, Figure, Key, Look
from teleop_drake.study.figures.sweep_grid import (
    MAX_NAMED_LINES,
    MetricScale,
    SweepGrid,
)
from teleop_drake.study.sweep import SweepResult
from teleop_drake.study.sweep.statistics import Bands, MedianInterval

# Markers of the runs without a value on a line.
_MARKS = {"diverges": "x", "fails": "^", "no value": "o"}
_RUN_STYLE: Look = {"marker": ".", "markersize": 3, "linestyle": "none"}


def PlotSweep(result: SweepResult, *metrics: str) -> Figure:
    """Plots metrics of a sweep against the delay.

    A metric has a panel with a line for each controller. If further keys are varied,
    each controller has a panel with a line for each value of the last of these keys,
    and the others have panels of their own. A line is the median over the seeds, the
    band around it holds 90 % of the runs, and bars are the bootstrap interval of the
    median. Runs that diverge or have no value (a tool that never settles, for instance)
    are marked above the panel instead.

    If no delay is varied, the first varied key with numbers takes its place. If only
    seeds, or seeds and controllers, are varied, each controller has a dot for each run,
    with the median and its interval in their middle.

    Args:
        *metrics: Names in result.units, for example
            "collision.peak_force"; by default the most used metrics of the runs.

    Raises:
        ValueError: If there is no such metric, neither numbers nor seeds are varied, or
            there would be too many panels.
    """
    CheckKind("result", result, SweepResult, "a SweepResult, which Sweep() returns")
    metrics = metrics or tuple(result.Metrics())
    grid = SweepGrid(result)
    figure, panels = grid.MakePanels(len(metrics))
    marked: set[str] = set()
    for metric, axes in zip(metrics, panels, strict=True):
        marked |= _DrawMetric(grid, result, metric, axes)
    grid.AddTitles(panels, num_marks=grid.shape[1] if marked else 0)
    # The legend: lines, marks in use, then how the seeds are shown.
    handles: list[Any] = [
        Key(name, marker=marker, color=GREY, **style.MARK_STYLE)
        for name, marker in _MARKS.items()
        if name in marked
    ]
    if grid.x_names:
        handles.append(Key("a run", color=GREY, alpha=0.6, **_RUN_STYLE))
    elif grid.shape[-1] > 1:
        label = "5 to 95 % of the seeds"
        handles.append(Patch(color=GREY, alpha=0.4, linewidth=0, label=label))
    if grid.shape[-1] > 1:
        label = "95 % interval of the median (bootstrap)"
        handles.append(Key(label, color=GREY, marker="|", linewidth=0.8))
    style.AddLegend(figure, [*grid.LineHandles(), *handles], fontsize=SMALL_FONT_SIZE)
    return figure


def _DrawMetric(
    grid: SweepGrid, result: SweepResult, metric: str, axes: Sequence[Axes]
) -> set[str]:
    """Draws a metric into its panels; returns the names of the markers in use."""
    values = grid.Arrange(result.Values(metric))
    status = grid.Arrange(result.Status())
    is_diverged = status == "diverged"
    is_missing = (status == "completed") & np.isnan(values)
    if metric.startswith("diverged"):
        is_missing[:] = False
    else:  # A diverged run's value describes only its time until the stop.
        values = np.where(is_diverged, np.nan, values)
    scale, label, limits = MetricScale(result, metric, values)
    # With more lines, the markers are left to the stability map.
    is_failed = status == "failed"
    marked = {"diverges": is_diverged, "fails": is_failed, "no value": is_missing}
    if values.shape[1] > MAX_NAMED_LINES:
        marked = {}
    for panel, ax in enumerate(axes):
        style.FormatAxes(ax)
        for i, y in enumerate(values[panel] * scale):
            line = grid.LineStyle(i)
            color = line["color"]
            middle = Bands(y, np.median)
            ax.plot(grid.x, middle, marker=".", markersize=3, **line)
            if grid.x_names:
                _DrawRuns(ax, grid.x, y, color)
                ax.set_ylim(style.Widen(limits, scale))
            elif y.shape[1] > 1:
                low, high = (Bands(y, partial(np.quantile, q=q)) for q in (0.05, 0.95))
                ax.fill_between(grid.x, low, high, color=color, alpha=0.2, lw=0)
            if y.shape[1] > 1:
                _DrawInterval(ax, grid.x, y, middle, color)
            for name, where in marked.items():
                x = grid.x[where[panel, i].any(axis=1)]
                style.MarkAbove(ax, x, i, marker=_MARKS[name], color=color)
    for ax in axes[:: grid.num_columns]:
        ax.set_ylabel(label)
    return {name for name, where in marked.items() if where.any()}


def _DrawRuns(ax: Axes, x: Array, values: Array, color: Any) -> None:
    """Draws a dot for each of the values (x, seeds), in the order of the seeds."""
    # Side by side, so that the dots do not cover each other.
    beside = x[:, np.newaxis] + np.linspace(-0.3, 0.3, values.shape[1])
    ax.plot(beside, values, color=color, alpha=0.6, **_RUN_STYLE)


def _DrawInterval(ax: Axes, x: Array, values: Array, median: Array, color: Any) -> None:
    """Draws the interval of the median of values (x, seeds)."""
    ends = np.array([MedianInterval(y[np.isfinite(y)]) for y in values]).T
    lengths = np.abs(ends - median)
    ax.errorbar(x, median, lengths, fmt="none", color=color, linewidth=0.8, capsize=2)

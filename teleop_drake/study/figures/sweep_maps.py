"""Maps of sweeps over two keys: pure functions of results."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from teleop_drake.loops.framework.arrays import Array, Interval
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.study.figures import style
from teleop_drake.study.figures.labels import AxisLabel
from teleop_drake.study.figures.layout import Panels
from teleop_drake.study.figures.style import (
    FONT_SIZE,
    GREY,
    SMALL_FONT_SIZE,
    Figure,
    Key,
)
from teleop_drake.study.figures.sweep_grid import SEQUENCE, MetricScale, SweepGrid
from teleop_drake.study.sweep import SweepResult
from teleop_drake.study.sweep.boundary import Boundary

Boundaries = Sequence[Sequence[Boundary]]
"""The boundaries of stability that are drawn over each panel."""

# The largest number of values of a map that have a tick each.
_MOST_TICKS = 8

# How a run ends, from best to worst, with its colour.
_OUTCOMES = {
    "completes": "#56B4E9",
    "settles": "#009E73",
    "not at rest within the run": "#E69F00",
    "diverges": "#D55E00",
    "fails": GREY,
}

# Colour of cells with a run that diverges or fails.
_ENDED = "#BBBBBB"


def PlotStability(result: SweepResult, boundaries: Boundaries = ()) -> Figure:
    """Maps how the runs of a sweep end, over the delay and another varied key.

    A cell shows the worst outcome of its seeds. Further varied keys have panels of
    their own.

    Args:
        boundaries: The largest stable delays for each panel; see FindBoundaries().

    Raises:
        ValueError: If fewer than two keys beside the controller and the seed are
            varied, or there would be too many panels.
    """
    grid = _TwoKeys(result)
    status = grid.Arrange(result.Status())
    completed = np.zeros(status.shape)
    if "collision.time" in result.units:
        has_contact = np.isfinite(grid.Arrange(result.Values("collision.time")))
        settles = np.isfinite(grid.Arrange(result.Values("collision.settling_time")))
        completed = np.select([has_contact & settles, has_contact], [1, 2])
    # The rank of an outcome is its index in _OUTCOMES.
    rank = np.select([status == "failed", status == "diverged"], [4, 3], completed)
    worst = rank.max(axis=-1)
    figure, panels = grid.MakePanels()
    colors = ListedColormap(list(_OUTCOMES.values()))
    limits = {"vmin": -0.5, "vmax": len(_OUTCOMES) - 0.5}
    for ax, cells in zip(panels[0], worst, strict=True):
        _DrawCells(
            ax, grid, cells, cmap=colors, **limits, edgecolor="white", linewidth=0.3
        )
    handles = [
        Patch(color=color, label=label)
        for i, (label, color) in enumerate(_OUTCOMES.items())
        if i in worst
    ]
    _Finish(figure, panels, grid, handles, boundaries)
    return figure


def PlotMap(result: SweepResult, *metrics: str, boundaries: Boundaries = ()) -> Figure:
    """Maps metrics of a sweep, over the delay and another varied key.

    A cell shows the median of its seeds. It is grey if a run diverges or fails, and
    white if a run has no value. Further varied keys have panels of their own.

    Args:
        *metrics: One name or more in result.units, for example
            "collision.peak_force".
        boundaries: The largest stable delays for each panel; see FindBoundaries().

    Raises:
        ValueError: If there is no such metric, fewer than two keys beside the
            controller and the seed are varied, or there would be too many panels.
    """
    grid = _TwoKeys(result)
    is_completed = grid.Arrange(result.Status()) == "completed"
    is_ended = ~is_completed.all(axis=-1)
    # Grey cells are drawn over those that have a colour.
    ended = np.where(is_ended, 1.0, np.nan)
    lacks_number = False
    figure, panels = grid.MakePanels(len(metrics))
    for metric, axes in zip(metrics, panels, strict=True):
        values = np.where(is_completed, grid.Arrange(result.Values(metric)), np.nan)
        medians = np.median(values, axis=-1)  # NaN if a seed has no value.
        lacks_number |= (np.isnan(medians) & ~is_ended).any()
        scale, label, (low, high) = MetricScale(result, metric, medians)
        limits = {"vmin": low * scale, "vmax": high * scale}
        for ax, shown, gone in zip(axes, medians * scale, ended, strict=True):
            cells = _DrawCells(ax, grid, shown, cmap=SEQUENCE, **limits)
            _DrawCells(ax, grid, gone, cmap=ListedColormap([_ENDED]))
        bar = figure.colorbar(cells, ax=axes.tolist(), pad=0.02)
        bar.set_label(label, fontsize=FONT_SIZE)
        bar.ax.tick_params(labelsize=SMALL_FONT_SIZE)
    handles = []
    if is_ended.any():
        handles.append(Patch(color=_ENDED, label="diverges or fails"))
    if lacks_number:
        label = "has no such number"
        handles.append(Patch(facecolor="white", edgecolor=GREY, label=label))
    _Finish(figure, panels, grid, handles, boundaries)
    return figure


def _TwoKeys(result: SweepResult) -> SweepGrid:
    """Returns the grid of a sweep that varies two keys or more."""
    grid = SweepGrid(result)
    if not grid.has_two_keys:
        Refuse("result", "with no second key that is varied", "of two keys or more")
    return grid


def _DrawCells(ax: Axes, grid: SweepGrid, cells: Array, **options: Any) -> Any:
    """Colours the cells (lines, x) of a panel."""
    y, _ = grid.LineCoordinates()
    return ax.pcolormesh(style.CellEdges(grid.x), style.CellEdges(y), cells, **options)


def _Finish(
    figure: Figure,
    panels: Panels,
    grid: SweepGrid,
    handles: list[Any],
    boundaries: Boundaries,
) -> None:
    """Draws the boundaries, and adds ticks, titles, labels and the legend."""
    y, y_labels = grid.LineCoordinates()
    limits = style.MapLimits(grid.x)
    fates = _Fates(boundaries, limits)
    lines = dict(zip(fates, itertools.cycle(style.LINES)))
    for (_, panel), ax in np.ndenumerate(panels):
        for drawn in boundaries[panel] if boundaries else ():
            # A black line with a white edge is visible on every colour.
            ax.plot(drawn.ends, y, color="white", linewidth=2.8)
            dashes = lines[drawn.point]
            ax.plot(drawn.ends, y, color="black", linestyle=dashes, linewidth=1.6)
        ax.set_xlim(limits)
        ax.set_ylim(style.MapLimits(y) if y_labels is None else (-0.5, len(y) - 0.5))
        ax.spines[:].set(visible=True, linewidth=0.8)
        if len(grid.x) <= _MOST_TICKS:
            ax.set_xticks(grid.x)
        if y_labels is not None or len(y) <= _MOST_TICKS:
            ax.set_yticks(y, y_labels)
    # Titles and labels, a note below the map on boundaries outside of it, the legend.
    grid.AddTitles(panels)
    for ax in panels[:, :: grid.num_columns].flat:
        ax.set_ylabel(AxisLabel(grid.line_key))
    notes = []
    for name, fate in fates.items():
        if fate:
            notes.append(f"{name}: {fate}")
        else:
            label = f"end of stability, {name}"
            handles.append(Key(label, color="black", linestyle=lines[name]))
    if notes:
        figure.supxlabel("; ".join(notes), fontsize=SMALL_FONT_SIZE)
    style.AddLegend(figure, handles)


def _Fates(boundaries: Boundaries, limits: Interval) -> dict[str, str]:
    """Returns a note on each boundary outside the map; "" for one that crosses it."""
    ends: dict[str, list[float]] = {}
    for boundary in itertools.chain(*boundaries):
        known = boundary.ends[~np.isnan(boundary.ends)]
        ends.setdefault(boundary.point, []).extend(known)
    fates = dict.fromkeys(ends, "")
    for name, delays in ends.items():
        if not delays:
            fates[name] = "stability not known"
        elif min(delays) > limits[1]:
            fates[name] = "stable throughout"
        elif max(delays) <= 0:
            fates[name] = "not stable without delay"
    return fates

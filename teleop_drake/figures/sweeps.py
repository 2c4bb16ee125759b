"""Figures of sweeps: pure functions of results, like those of figures.runs."""

import itertools
import math
import textwrap
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from teleop_drake.figures import style
from teleop_drake.figures.style import FONT_SIZE, GREY, SMALL_FONT_SIZE, Figure, Key
from teleop_drake.sweep import MetricUnits, SweepResult, VariesSeedsOnly
from teleop_drake.sweep.boundary import Boundary
from teleop_drake.sweep.statistics import CONTROLLERS, SEED, Bands, MedianInterval
from teleop_drake.validation import Refuse

MAX_PANELS = 24
"""More in a figure would be too small to read."""

Boundaries = Mapping[tuple[int, int], Sequence[Boundary]]
"""What is drawn over a panel, by its row and column."""

# More lines are not all named.
_MAX_NAMED_LINES = 8

# So many values of a map have a tick each.
_MOST_TICKS = 8

# Colours of values that have an order.
_SEQUENCE = colormaps["viridis"]

# The marks of runs that a line lacks.
_MARKS = {"diverges": "x", "fails": "^", "has none": "o"}
_MARK_STYLE: dict[str, Any] = {
    "markersize": 3.5,
    "markerfacecolor": "none",
    "markeredgewidth": 0.8,
    "linestyle": "none",
}

# How a run ends, from good to bad, and the colour of it.
_OUTCOMES = {
    "completes": "#56B4E9",
    "settles": "#009E73",
    "not at rest within the run": "#E69F00",
    "diverges": "#D55E00",
    "fails": GREY,
}

# Colour of cells with a run that was stopped.
_ENDED = "#BBBBBB"

# What a boundary is that crosses the map.
_END = "end of stability"

_INTERVAL = "95 % interval of the median (bootstrap)"


class SweepGrid:
    """Who is who among the axes of a sweep.

    `Arrange` brings an array of the grid's shape into (rows, columns, lines, x,
    seeds). Columns are controllers and lines the values of `line_key`, the last key
    that is neither of these; where there is none, lines are controllers. The
    `panel_points` (rows, columns) are the keys and values that a panel has.

    Raises:
        ValueError: If no number is varied, or it would take too many panels.
    """

    def __init__(self, result: SweepResult) -> None:
        axes = result.axes
        varied = [key for key, values in axes.items() if len(values) > 1]
        controller = [key for key in axes if key in CONTROLLERS][:1]
        seed = [key for key in axes if key == SEED]
        numeric = [
            key
            for key in (*style.DELAYS, *axes)
            if key in axes and key not in seed and all(map(style.IsNumber, axes[key]))
        ]
        if not numeric:
            Refuse("result", "with no key with numbers", "of one such key or more")
        x_key = next((key for key in numeric if key in varied), numeric[0])
        others = [k for k in varied if k not in (x_key, *controller, *seed)]
        self.x_key = x_key
        self.lines_are_controllers = not others
        *row_keys, self.line_key = others or controller or [""]
        columns = controller if others else []
        self.line_values = axes.get(self.line_key, [])
        self.column_values = [value for key in columns for value in axes[key]]
        rows = list(itertools.product(*(axes[key] for key in row_keys)))
        self.panel_points = [
            [
                dict(zip((*row_keys, *columns), (*row, *column), strict=True))
                for column in itertools.product(*(axes[key] for key in columns))
            ]
            for row in rows
        ]
        self.row_titles = [
            ", ".join(map(style.LabelOfValue, row_keys, row)) for row in rows
        ]
        num_columns = max(len(self.column_values), 1)
        if len(rows) * num_columns > MAX_PANELS:
            needs = f"needs {len(rows)} x {num_columns} panels"
            Refuse("result", needs, f"of {MAX_PANELS} panels at most")
        keys = [*row_keys, *columns, self.line_key, x_key, *seed]
        names = list(axes)
        rest = [key for key in names if key not in keys]  # One value each.
        self._order = [names.index(key) for key in [*rest, *keys] if key in names]
        self.shape = (
            len(rows),
            num_columns,
            max(len(self.line_values), 1),
            len(axes[x_key]),
            len(axes[SEED]) if seed else 1,
        )
        x = np.array(axes[x_key], dtype=float)
        self._x_order = np.argsort(x)
        self.x = x[self._x_order]

    @property
    def has_two_keys(self) -> bool:
        """Whether two keys beside the controller and the seed are varied."""
        return bool(self.line_values) and not self.lines_are_controllers

    def Arrange(self, values: np.ndarray) -> np.ndarray:
        """Returns an array of the grid's shape as (rows, columns, lines, x, seeds)."""
        return values.transpose(self._order).reshape(self.shape)[..., self._x_order, :]

    def MakePanels(self, num_metrics: int = 1) -> tuple[Figure, np.ndarray]:
        """Returns a figure and its panels (metrics, rows, columns).

        Metrics of one panel each stand side by side, others below each other.
        """
        num_rows, num_columns = self.shape[:2]
        across = min(num_metrics, 3) if num_rows == num_columns == 1 else 1
        down = math.ceil(num_metrics / across) * num_rows
        figure = Figure(
            figsize=(style.WIDTH, 0.8 + (2.6 if down == 1 else 1.7) * down),
            layout=ConstrainedLayoutEngine(w_pad=0.1),
        )
        axes = figure.subplots(down, across * num_columns, sharex=True, squeeze=False)
        panels = axes.reshape(-1, num_rows, num_columns)[:num_metrics]
        for ax in axes.ravel()[panels.size :]:
            ax.remove()
        for ax in panels.ravel()[-axes.shape[1] :]:
            ax.set_xlabel(style.AxisLabel(self.x_key), fontsize=FONT_SIZE)
            ax.tick_params(labelbottom=True)
        for metric in panels:
            for ax in metric.ravel()[1:]:
                ax.sharey(metric[0, 0])
            for ax in metric[:, 1:].ravel():
                ax.tick_params(labelleft=False)
        return figure, panels

    def AddTitles(self, panels: np.ndarray, num_marks: int = 0) -> None:
        """Names the controllers, and the rows, above marks on as many levels."""
        for (_, i, j), ax in np.ndenumerate(panels):
            names = [style.ValueLabel(x) for x in self.column_values[j : j + 1]]
            names += [self.row_titles[i]] if self.row_titles[i] else []
            ax.set_title(
                ", ".join(names) or " ",  # Also that makes room for the marks.
                fontsize=FONT_SIZE,
                y=1.03 + 0.035 * num_marks,
                pad=2,
            )

    def LineStyle(self, i: int) -> dict[str, Any]:
        """Returns how line i is drawn."""
        if self.lines_are_controllers:
            return style.RunStyle(i)
        share = i / max(len(self.line_values) - 1, 1)
        return {"color": _SEQUENCE(0.92 * share), "linewidth": 1.1}

    def LineCoordinates(self) -> tuple[np.ndarray, list[str] | None]:
        """Returns where the lines are on an axis, and their names if not numbers."""
        values = self.line_values
        if all(map(style.IsNumber, values)) and list(values) == sorted(values):
            return np.array(values, dtype=float), None
        return np.arange(len(values)), [style.ValueLabel(value) for value in values]

    def LineHandles(self) -> list[Line2D]:
        """Returns what the legend says of the lines."""
        values = self.line_values
        step = math.ceil(len(values) / _MAX_NAMED_LINES)
        return [
            Key(
                style.ValueLabel(value)
                if self.lines_are_controllers
                else style.LabelOfValue(self.line_key, value),
                **self.LineStyle(i),
            )
            for i, value in enumerate(values)
            # Some of many are enough to tell which way they go.
            if i % step == 0 or i == len(values) - 1
        ]


def _MetricScale(
    result: SweepResult, metric: str, values: np.ndarray
) -> tuple[float, str, tuple[float, float]]:
    """Returns the scale of values of a metric, its label, and the limits unscaled."""
    finite = values[np.isfinite(values)]
    limits = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    scale, unit = style.ScaleAndUnit(limits, MetricUnits(result.scenario)[metric])
    label = metric.replace("_", " ").replace(".", " ")
    # No longer than a panel of a sheet is high.
    label = textwrap.fill(f"{label} [{unit}]" if unit else label, 26)
    return scale, label, limits


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
    ncols = 4 if len(lines) > 3 else len(lines) + len(handles)
    style.AddLegend(figure, [*lines, *handles], ncols=ncols, fontsize=SMALL_FONT_SIZE)
    return figure


def _DrawMetric(
    grid: SweepGrid, result: SweepResult, metric: str, axes: np.ndarray
) -> set[str]:
    """Draws a metric into its panels; returns the names of the marks there."""
    values, status = grid.Arrange(result.Values(metric)), grid.Arrange(result.Status())
    is_diverged = status == "diverged"
    is_missing = (status == "completed") & np.isnan(values)
    if metric.startswith("diverged"):
        is_missing[:] = False
    else:  # What a run did until it was stopped says little.
        values = np.where(is_diverged, np.nan, values)
    scale, label, _ = _MetricScale(result, metric, values)
    # Where there are more lines, the stability map tells of them.
    found = (is_diverged, status == "failed", is_missing)
    marked = dict(zip(_MARKS, found, strict=True))
    if values.shape[2] > _MAX_NAMED_LINES:
        marked = {}
    for *index, i in np.ndindex(values.shape[:3]):
        ax, line = axes[tuple(index)], grid.LineStyle(i)
        if i == 0:
            style.FormatAxes(ax)
        y = values[(*index, i)] * scale
        middle = Bands(y, np.median)
        ax.plot(grid.x, middle, marker=".", markersize=3, **line)
        if y.shape[1] > 1:
            _DrawBand(ax, grid.x, y, middle, line["color"])
        for name, where in marked.items():
            x = grid.x[where[(*index, i)].any(axis=1)]
            ax.plot(
                x,
                np.full(len(x), 1.03 + 0.035 * i),
                marker=_MARKS[name],
                color=line["color"],
                **_MARK_STYLE,
                **style.Above(ax),
            )
    for ax in axes[:, 0]:
        ax.set_ylabel(label, fontsize=FONT_SIZE)
    return {name for name, where in marked.items() if where.any()}


def _DrawBand(
    ax: Axes, x: np.ndarray, values: np.ndarray, median: np.ndarray, color: Any
) -> None:
    """Draws how values (x, seeds) scatter, and how well their median is known."""
    low, high = (Bands(values, partial(np.quantile, q=q)) for q in (0.05, 0.95))
    ax.fill_between(x, low, high, color=color, alpha=0.2, linewidth=0)
    known = np.isfinite(values).sum(axis=1) > 1
    ends = np.array([MedianInterval(y[np.isfinite(y)]) for y in values[known]]).T
    bars: dict[str, Any] = {"fmt": "none", "linewidth": 0.8, "capsize": 2}
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
    figure = Figure(figsize=(style.WIDTH, 0.6 + 2.4 * num_rows), layout="constrained")
    panels = figure.subplots(num_rows, num_columns, squeeze=False).ravel()
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
    scale, y_label, _ = _MetricScale(result, metric, values)
    style.FormatAxes(ax)
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
        if missing := len(row) - y.size:
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
    ax.set_ylabel(y_label, fontsize=FONT_SIZE)


def PlotStability(result: SweepResult, boundaries: Boundaries | None = None) -> Figure:
    """Maps how the runs of a sweep end, over the delay and another varied key.

    A cell has the worst of its seeds. What else is varied gets panels of its own.

    Args:
        boundaries: Where the loop ceases to be stable; see FindBoundaries().

    Raises:
        ValueError: If fewer than two keys beside the controller and the seed are
            varied, or it would take too many panels.
    """
    grid = _TwoKeys(result)
    status = grid.Arrange(result.Status())
    rank = np.select([status == "failed", status == "diverged"], [4, 3], 0)
    if "collision.time" in MetricUnits(result.scenario):
        has_contact = np.isfinite(grid.Arrange(result.Values("collision.time")))
        settles = np.isfinite(grid.Arrange(result.Values("collision.settling_time")))
        is_seen = (status == "completed") & has_contact
        rank[is_seen] = np.where(settles, 1, 2)[is_seen]
    worst = rank.max(axis=-1)
    figure, panels = grid.MakePanels()
    colors = ListedColormap(list(_OUTCOMES.values()))
    limits = {"vmin": -0.5, "vmax": len(_OUTCOMES) - 0.5}
    for index, ax in np.ndenumerate(panels[0]):
        edges = {"edgecolor": "white", "linewidth": 0.3}
        _DrawCells(ax, grid, worst[index], cmap=colors, **limits, **edges)
    handles = [
        Patch(color=color, label=label)
        for i, (label, color) in enumerate(_OUTCOMES.items())
        if (worst == i).any()
    ]
    _Finish(figure, panels, grid, handles, boundaries or {})
    return figure


def PlotMap(
    result: SweepResult, *metrics: str, boundaries: Boundaries | None = None
) -> Figure:
    """Maps metrics of a sweep, over the delay and another varied key.

    A cell has the median of its seeds. It is grey where a run diverges or fails, and
    white where a run has no such number. What else is varied gets panels of its own.

    Args:
        *metrics: Of MetricUnits(result.scenario), one or more, for example
            "collision.peak_force".
        boundaries: Where the loop ceases to be stable; see FindBoundaries().

    Raises:
        ValueError: If there is no such metric, fewer than two keys beside the
            controller and the seed are varied, or it would take too many panels.
    """
    grid = _TwoKeys(result)
    is_completed = grid.Arrange(result.Status()) == "completed"
    is_ended = ~is_completed.all(axis=-1)
    ended = np.where(is_ended, 1.0, np.nan)
    lacks_number = False
    figure, panels = grid.MakePanels(len(metrics))
    for metric, axes in zip(metrics, panels, strict=True):
        values = np.where(is_completed, grid.Arrange(result.Values(metric)), np.nan)
        medians = np.median(values, axis=-1)  # NaN where a seed has no number.
        lacks_number |= bool((np.isnan(medians) & ~is_ended).any())
        scale, label, (low, high) = _MetricScale(result, metric, medians)
        limits = {"vmin": low * scale, "vmax": high * scale}
        for index, ax in np.ndenumerate(axes):
            shown = medians[index] * scale
            cells = _DrawCells(ax, grid, shown, cmap=_SEQUENCE, **limits)
            _DrawCells(ax, grid, ended[index], cmap=ListedColormap([_ENDED]))
        bar = figure.colorbar(cells, ax=axes.ravel().tolist(), pad=0.02)
        bar.set_label(label, fontsize=FONT_SIZE)
        bar.ax.tick_params(labelsize=SMALL_FONT_SIZE)
    handles = []
    if is_ended.any():
        handles.append(Patch(color=_ENDED, label="diverges or fails"))
    if lacks_number:
        label = "has no such number"
        handles.append(Patch(facecolor="white", edgecolor=GREY, label=label))
    _Finish(figure, panels, grid, handles, boundaries or {})
    return figure


def _TwoKeys(result: SweepResult) -> SweepGrid:
    """Returns the grid of a sweep, of two keys or more."""
    grid = SweepGrid(result)
    if not grid.has_two_keys:
        Refuse("result", "with no second key that is varied", "of two keys or more")
    return grid


def _DrawCells(ax: Axes, grid: SweepGrid, cells: np.ndarray, **options: Any) -> Any:
    """Colours the cells (lines, x) of a panel."""
    y, _ = grid.LineCoordinates()
    return ax.pcolormesh(style.CellEdges(grid.x), style.CellEdges(y), cells, **options)


def _Finish(
    figure: Figure,
    panels: np.ndarray,
    grid: SweepGrid,
    handles: list[Any],
    boundaries: Boundaries,
) -> None:
    """Draws the boundaries, and says what everything is."""
    y, y_labels = grid.LineCoordinates()
    limits = style.MapLimits(grid.x)
    labels = _BoundaryLabels(boundaries, limits)
    lines = {name: style.LINES[i % len(style.LINES)] for i, name in enumerate(labels)}
    for (_, i, j), ax in np.ndenumerate(panels):
        for drawn in boundaries.get((i, j), ()):
            # Black on white is seen on every colour.
            ax.plot(drawn.ends, y, color="white", linewidth=2.8)
            dashes = lines[drawn.point]
            ax.plot(drawn.ends, y, color="black", linestyle=dashes, linewidth=1.6)
        ax.set_xlim(limits)
        ax.set_ylim(style.MapLimits(y) if y_labels is None else (-0.5, len(y) - 0.5))
        ax.tick_params(labelsize=SMALL_FONT_SIZE, width=0.6, length=2.5)
        if len(grid.x) <= _MOST_TICKS:
            ax.set_xticks(grid.x)
        if y_labels is not None or len(y) <= _MOST_TICKS:
            ax.set_yticks(y, y_labels)
    grid.AddTitles(panels)
    for ax in panels[:, :, 0].ravel():
        ax.set_ylabel(style.AxisLabel(grid.line_key), fontsize=FONT_SIZE)
    handles += [
        Key(label, color="black", linestyle=lines[name])
        for name, label in labels.items()
        if label.startswith(_END)
    ]
    notes = [label for label in labels.values() if not label.startswith(_END)]
    if notes:
        figure.supxlabel("; ".join(notes), fontsize=SMALL_FONT_SIZE)
    style.AddLegend(figure, handles, ncols=min(len(handles), 3))


def _BoundaryLabels(
    boundaries: Boundaries, limits: tuple[float, float]
) -> dict[str, str]:
    """Returns what each boundary is called, also one that lies beyond the map."""
    ends: dict[str, list[np.ndarray]] = {}
    for boundary in itertools.chain(*boundaries.values()):
        ends.setdefault(boundary.point, []).append(boundary.ends)
    labels = {}
    for name, parts in ends.items():
        known = np.concatenate(parts)
        known = known[~np.isnan(known)]
        if not known.size:
            labels[name] = f"{name}: stability not known"
        elif (known > limits[1]).all():
            labels[name] = f"{name}: stable throughout"
        elif (known <= 0).all():
            labels[name] = f"{name}: not stable without delay"
        else:
            labels[name] = f"{_END}, {name}"
    return labels

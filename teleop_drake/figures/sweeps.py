"""Figures of sweeps: pure functions of results, like those of figures.runs."""

import itertools
import math
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from teleop_drake.figures.style import (
    DELAYS,
    FONT_SIZE,
    GREY,
    SMALL_FONT_SIZE,
    WIDTH,
    AxisLabel,
    CellEdges,
    FormatAxes,
    RunStyle,
    ScaleAndUnit,
)
from teleop_drake.sweep import (
    HasIntervals,
    MetricUnits,
    SweepResult,
    VariesSeedsOnly,
)
from teleop_drake.sweep.statistics import CONTROLLERS, SEED, Bands, MedianInterval
from teleop_drake.validation import Refuse


def PlotSweep(result: SweepResult, metric: str) -> Figure:
    """Plots a metric of a sweep against the delay.

    A line for each controller; or, where more is varied, a panel for each and a line
    for each of the other values. A line is the median over the seeds; the band around
    it holds 90 % of the runs, and bars are the bootstrap interval of the median. Runs
    that diverged or have no such number (a tool that never settles, for instance) are
    marked above the panel instead.

    If no delay is varied, the first numbers that are take its place.

    Args:
        result: The sweep.
        metric: One of MetricUnits(result.scenario), for example
            "collision.peak_force".

    Raises:
        ValueError: If there is no such metric, no number is varied, or it would take
            too many panels.
    """
    grid = _SweepGrid(result)
    values, status = grid.Arrange(result.Values(metric)), grid.Arrange(result.Status())
    is_diverged = status == "diverged"
    # What a run did until it was stopped says little.
    is_shown = ~is_diverged | metric.startswith("diverged")
    values = np.where(is_shown, values, np.nan)
    is_missing = (status == "completed") & np.isnan(values)
    finite = values[np.isfinite(values)]
    limits = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    scale, unit = ScaleAndUnit(limits, MetricUnits(result.scenario)[metric])

    has_marks = values.shape[2] <= _MAX_NAMED_LINES
    figure, axes = grid.MakePanels()
    for index, ax in np.ndenumerate(axes):
        FormatAxes(ax)
        marks = [
            (is_diverged, "x", "diverges"),
            (status == "failed", "^", "fails"),
        ]
        if not metric.startswith("diverged"):
            marks.append((is_missing, "o", "has none"))
        for i in range(values.shape[2]):
            style = grid.LineStyle(i)
            y = values[(*index, i)] * scale
            middle = Bands(y, np.median)
            ax.plot(grid.x, middle, marker=".", markersize=3, **style)
            if y.shape[1] > 1:
                _DrawBand(ax, grid.x, y, middle, style["color"])
            # For more, there is the stability map.
            for where, marker, _ in marks if has_marks else []:
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
        label = metric.replace("_", " ").replace(".", " ")
        ax.set_ylabel(f"{label} [{unit}]" if unit else label, fontsize=FONT_SIZE)
    handles = [
        Line2D([], [], label=label, **_SweepMark(marker, GREY))
        for where, marker, label in marks
        if has_marks and where.any()
    ]
    grid.AddTitles(axes, num_marks=values.shape[2] if handles else 0)
    if values.shape[-1] > 1:
        handles += _BandHandles()
    grid.AddLegend(figure, handles)
    return figure


def _DrawBand(
    ax: Axes, x: np.ndarray, values: np.ndarray, median: np.ndarray, color: Any
) -> None:
    """Draws how values (x, seeds) scatter, and how well their median is known."""
    low = Bands(values, lambda y: np.quantile(y, 0.05))
    high = Bands(values, lambda y: np.quantile(y, 0.95))
    ax.fill_between(x, low, high, color=color, alpha=0.2, linewidth=0)
    if not HasIntervals():
        return
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
    handles: list[Any] = [
        Patch(color=GREY, alpha=0.4, linewidth=0, label="5 to 95 % of the seeds")
    ]
    if HasIntervals():
        handles.append(
            Line2D([], [], color=GREY, marker="|", linewidth=0.8, label=_INTERVAL)
        )
    return handles


def PlotSeeds(result: SweepResult, *metrics: str) -> Figure:
    """Plots metrics of a sweep that varies the seed, and at most the controller.

    Each metric has a panel. A dot is a run; a line is the median, and a bar its
    bootstrap interval. Under each controller stands how many of its runs have no such
    number.

    Args:
        result: The sweep.
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
    ]
    if HasIntervals():
        handles.append(Line2D([], [], color=GREY, linewidth=2.4, label=_INTERVAL))
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
    finite = values[np.isfinite(values)]
    limits = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    scale, unit = ScaleAndUnit(limits, MetricUnits(result.scenario)[metric])
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
        note = f"\n{missing} of {len(row)} have none" if missing else ""
        labels.append(_ValueLabel(name).replace(" ", "\n", 1) + note)
    ax.set_xticks(range(len(names)), labels, fontsize=SMALL_FONT_SIZE)
    ax.set_xlim(-0.6, len(names) - 0.4)
    label = metric.replace("_", " ").replace(".", " ")
    ax.set_ylabel(f"{label} [{unit}]" if unit else label, fontsize=FONT_SIZE)


def PlotStability(result: SweepResult) -> Figure:
    """Maps how the runs of a sweep end, over the delay and another varied key.

    A cell has the worst of its seeds. What else is varied gets panels of its own.

    Args:
        result: The sweep.

    Raises:
        ValueError: If fewer than two keys beside the controller and the seed are
            varied, or it would take too many panels.
    """
    grid = _SweepGrid(result)
    if not grid.line_values or grid.lines_are_controllers:
        Refuse("result", "with no second key that is varied", "of two keys or more")
    status = grid.Arrange(result.Status())
    rank = np.select([status == "failed", status == "diverged"], [4, 3], 0)
    if "collision.time" in MetricUnits(result.scenario):
        has_contact = np.isfinite(grid.Arrange(result.Values("collision.time")))
        settles = np.isfinite(grid.Arrange(result.Values("collision.settling_time")))
        is_completed = status == "completed"
        rank[is_completed & has_contact & settles] = 1
        rank[is_completed & has_contact & ~settles] = 2
    worst = rank.max(axis=-1)

    figure, axes = grid.MakePanels()
    y, y_labels = grid.LineCoordinates()
    for index, ax in np.ndenumerate(axes):
        ax.pcolormesh(
            CellEdges(grid.x),
            CellEdges(y),
            worst[index],
            cmap=ListedColormap([color for _, color in _OUTCOMES]),
            vmin=-0.5,
            vmax=len(_OUTCOMES) - 0.5,
            edgecolor="white",
            linewidth=0.3,
        )
        ax.tick_params(labelsize=SMALL_FONT_SIZE, width=0.6, length=2.5)
        if y_labels is not None:
            ax.set_yticks(y, y_labels)
    for ax in axes[:, 0]:
        ax.set_ylabel(AxisLabel(grid.line_key), fontsize=FONT_SIZE)
    grid.AddTitles(axes)
    figure.legend(
        handles=[
            Patch(color=color, label=label)
            for i, (label, color) in enumerate(_OUTCOMES)
            if (worst == i).any()
        ],
        loc="outside upper center",
        ncols=len(_OUTCOMES),
        fontsize=FONT_SIZE,
        frameon=False,
    )
    return figure


# How a run ends, from good to bad, and the colour of it.
_OUTCOMES = (
    ("completes", "#56B4E9"),
    ("settles", "#009E73"),
    ("never settles", "#E69F00"),
    ("diverges", "#D55E00"),
    ("fails", GREY),
)
# More would be too small to read.
_MAX_PANELS = 24
_MAX_NAMED_LINES = 8
_INTERVAL = "95 % interval of the median (bootstrap)"
# Colours of values that have an order.
_SEQUENCE = colormaps["viridis"]


class _SweepGrid:
    """Who is who among the axes of a sweep.

    `Arrange` brings an array of the grid's shape into (rows, columns, lines, x,
    seeds). Columns are controllers and lines the values of `line_key`, the last key
    that is neither of these; where there is none, lines are controllers.
    """

    def __init__(self, result: SweepResult) -> None:
        axes = result.axes
        varied = [key for key, values in axes.items() if len(values) > 1]
        controller = [k for k in axes if k in CONTROLLERS][:1]
        seed = [k for k in axes if k == "seed"]
        numeric = [
            key
            for key, values in axes.items()
            if key not in seed and all(_IsNumber(value) for value in values)
        ]
        candidates = [
            *(k for k in DELAYS if k in varied),
            *(k for k in numeric if k in varied),
            *numeric,
        ]
        x_key = next((key for key in candidates if key in numeric), None)
        if x_key is None:
            Refuse("result", "with no key with numbers", "of one such key or more")
        others = [k for k in varied if k not in (x_key, *controller, *seed)]
        self.lines_are_controllers = not others
        self.x_key = x_key
        row_keys = others[:-1]
        if others:
            self.line_key, columns = others[-1], controller
        else:
            self.line_key, columns = (controller[0] if controller else ""), []
        self.line_values = axes.get(self.line_key, [])
        self.column_values = [value for key in columns for value in axes[key]]
        rows = list(itertools.product(*(axes[key] for key in row_keys)))
        self.row_titles = [
            ", ".join(
                f"{AxisLabel(key)} = {_ValueLabel(value)}"
                for key, value in zip(row_keys, row, strict=True)
            )
            for row in rows
        ]
        num_columns = max(len(self.column_values), 1)
        if len(rows) * num_columns > _MAX_PANELS:
            needs = f"needs {len(rows)} x {num_columns} panels"
            Refuse("result", needs, f"of {_MAX_PANELS} panels at most")
        keys = [*row_keys, *columns, self.line_key, x_key, *seed]
        names = list(axes)
        rest = [key for key in names if key not in keys]  # One value each.
        self._order = [names.index(key) for key in [*rest, *keys] if key in names]
        self.shape = (
            len(rows),
            num_columns,
            max(len(self.line_values), 1),
            len(axes[x_key]),
            len(axes[seed[0]]) if seed else 1,
        )
        x = np.array(axes[x_key], dtype=float)
        self._x_order = np.argsort(x)
        self.x = x[self._x_order]

    def Arrange(self, values: np.ndarray) -> np.ndarray:
        """Returns an array of the grid's shape as (rows, columns, lines, x, seeds)."""
        return values.transpose(self._order).reshape(self.shape)[..., self._x_order, :]

    def MakePanels(self) -> tuple[Figure, np.ndarray]:
        """Returns a figure and its panels (rows, columns)."""
        num_rows, num_columns = self.shape[:2]
        figure = Figure(
            figsize=(WIDTH, 0.8 + (2.6 if num_rows == 1 else 1.7) * num_rows),
            layout=ConstrainedLayoutEngine(w_pad=0.1),
        )
        panels = figure.subplots(
            num_rows, num_columns, sharex=True, sharey=True, squeeze=False
        )
        for ax in panels[-1]:
            ax.set_xlabel(AxisLabel(self.x_key), fontsize=FONT_SIZE)
        return figure, panels

    def AddTitles(self, panels: np.ndarray, num_marks: int = 0) -> None:
        """Names the controllers, and the rows, above marks on as many levels."""
        for i, row in enumerate(panels):
            for j, ax in enumerate(row):
                names = [self.row_titles[i]] if self.row_titles[i] else []
                if self.column_values:
                    names.insert(0, _ValueLabel(self.column_values[j]))
                ax.set_title(
                    ", ".join(names) or " ",  # Also that makes room for the marks.
                    fontsize=FONT_SIZE,
                    y=1.03 + 0.035 * num_marks,
                    pad=2,
                )

    def LineStyle(self, i: int) -> dict[str, Any]:
        """Returns how line i is drawn."""
        if self.lines_are_controllers:
            return RunStyle(i)
        share = i / max(len(self.line_values) - 1, 1)
        return {"color": _SEQUENCE(0.92 * share), "linewidth": 1.1}

    def LineCoordinates(self) -> tuple[np.ndarray, list[str] | None]:
        """Returns where the lines are on an axis, and their names if not numbers."""
        values = self.line_values
        if all(map(_IsNumber, values)) and list(values) == sorted(values):
            return np.array(values, dtype=float), None
        return np.arange(len(values)), [_ValueLabel(value) for value in values]

    def AddLegend(self, figure: Figure, handles: list[Line2D]) -> None:
        """Names the lines, and what the handles stand for."""
        values = self.line_values
        step = math.ceil(len(values) / _MAX_NAMED_LINES)
        lines = [
            Line2D(
                [],
                [],
                label=_ValueLabel(value)
                if self.lines_are_controllers
                else f"{AxisLabel(self.line_key)} = {_ValueLabel(value)}",
                **self.LineStyle(i),
            )
            for i, value in enumerate(values)
            # Some of many are enough to tell which way they go.
            if i % step == 0 or i == len(values) - 1
        ]
        if lines or handles:
            figure.legend(
                handles=[*lines, *handles],
                loc="outside upper center",
                ncols=4 if len(lines) > 3 else len(lines) + len(handles),
                fontsize=SMALL_FONT_SIZE,
                frameon=False,
            )


def _SweepMark(marker: str, color: Any) -> dict[str, Any]:
    return {
        "marker": marker,
        "markersize": 3.5,
        "color": color,
        "markerfacecolor": "none",
        "markeredgewidth": 0.8,
        "linestyle": "none",
    }


def _IsNumber(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _ValueLabel(value: Any) -> str:
    if _IsNumber(value):
        return f"{value:g}"
    text = value.replace("_", " ") if isinstance(value, str) else str(value)
    # Between two dollars matplotlib reads a formula.
    return text.replace("$", r"\$")

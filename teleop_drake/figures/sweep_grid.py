"""The axes of a sweep's figures, and how their panels are laid out."""

import itertools
import math
import textwrap
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from teleop_drake.figures.style import (
    DELAYS,
    FONT_SIZE,
    SMALL_FONT_SIZE,
    WIDTH,
    AxisLabel,
    Figure,
    LabelOfValue,
    RunStyle,
    ScaleAndUnit,
)
from teleop_drake.sweep import MetricUnits, SweepResult
from teleop_drake.sweep.statistics import CONTROLLERS
from teleop_drake.validation import Refuse

MAX_NAMED_LINES = 8
"""More lines are not all named."""

MAX_PANELS = 24
"""More in a figure would be too small to read."""

# Colours of values that have an order.
_SEQUENCE = colormaps["viridis"]


class SweepGrid:
    """Who is who among the axes of a sweep.

    `Arrange` brings an array of the grid's shape into (rows, columns, lines, x,
    seeds). Columns are controllers and lines the values of `line_key`, the last key
    that is neither of these; where there is none, lines are controllers. The
    `panel_points` (rows, columns) are the keys and values that a panel has.

    Args:
        result: The sweep.

    Raises:
        ValueError: If no number is varied, or it would take too many panels.
    """

    def __init__(self, result: SweepResult) -> None:
        axes = result.axes
        varied = [key for key, values in axes.items() if len(values) > 1]
        controller = [k for k in axes if k in CONTROLLERS][:1]
        seed = [k for k in axes if k == "seed"]
        numeric = [
            key
            for key, values in axes.items()
            if key not in seed and all(IsNumber(value) for value in values)
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
        self.panel_points = [
            [
                dict(zip((*row_keys, *columns), (*row, *column), strict=True))
                for column in itertools.product(*(axes[key] for key in columns))
            ]
            for row in rows
        ]
        self.row_titles = [
            ", ".join(
                LabelOfValue(key, value)
                for key, value in zip(row_keys, row, strict=True)
            )
            for row in rows
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
            len(axes[seed[0]]) if seed else 1,
        )
        x = np.array(axes[x_key], dtype=float)
        self._x_order = np.argsort(x)
        self.x = x[self._x_order]

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
            figsize=(WIDTH, 0.8 + (2.6 if down == 1 else 1.7) * down),
            layout=ConstrainedLayoutEngine(w_pad=0.1),
        )
        axes = figure.subplots(down, across * num_columns, sharex=True, squeeze=False)
        panels = axes.reshape(-1, num_rows, num_columns)[:num_metrics]
        for ax in axes.ravel()[panels.size :]:
            ax.remove()
        for ax in panels.ravel()[-axes.shape[1] :]:
            ax.set_xlabel(AxisLabel(self.x_key), fontsize=FONT_SIZE)
            ax.tick_params(labelbottom=True)
        for metric in panels:
            for ax in metric.ravel()[1:]:
                ax.sharey(metric[0, 0])
            for ax in metric[:, 1:].ravel():
                ax.tick_params(labelleft=False)
        return figure, panels

    def AddTitles(self, panels: np.ndarray, num_marks: int = 0) -> None:
        """Names the controllers, and the rows, above marks on as many levels."""
        for i, row in enumerate(panels):
            for j, ax in enumerate(row):
                names = [self.row_titles[i]] if self.row_titles[i] else []
                if self.column_values:
                    names.insert(0, ValueLabel(self.column_values[j]))
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
        if all(map(IsNumber, values)) and list(values) == sorted(values):
            return np.array(values, dtype=float), None
        return np.arange(len(values)), [ValueLabel(value) for value in values]

    def AddLegend(self, figure: Figure, handles: list[Line2D]) -> None:
        """Names the lines, and what the handles stand for."""
        values = self.line_values
        step = math.ceil(len(values) / MAX_NAMED_LINES)
        lines = [
            Line2D(
                [],
                [],
                label=ValueLabel(value)
                if self.lines_are_controllers
                else LabelOfValue(self.line_key, value),
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


def MetricScale(
    result: SweepResult, metric: str, values: np.ndarray
) -> tuple[float, str, tuple[float, float]]:
    """Returns the scale of values of a metric, its label, and the limits unscaled."""
    finite = values[np.isfinite(values)]
    limits = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    scale, unit = ScaleAndUnit(limits, MetricUnits(result.scenario)[metric])
    label = metric.replace("_", " ").replace(".", " ")
    # No longer than a panel of a sheet is high.
    label = textwrap.fill(f"{label} [{unit}]" if unit else label, 26)
    return scale, label, limits


def IsNumber(value: Any) -> bool:
    """Returns whether a value of the grid is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def ValueLabel(value: Any) -> str:
    """Returns how a value of the grid is written in a figure."""
    if IsNumber(value):
        return f"{value:g}"
    text = value.replace("_", " ") if isinstance(value, str) else str(value)
    # Between two dollars matplotlib reads a formula.
    return text.replace("$", r"\$")

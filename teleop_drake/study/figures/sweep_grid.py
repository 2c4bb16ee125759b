"""Panels of a sweep: the keys of its grid as panels, lines and horizontal axis."""

import itertools
import math
import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.lines import Line2D

from teleop_drake.loops.framework.arrays import Array, Interval, Record
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.model.signals import ScaleAndUnit
from teleop_drake.study.figures import style
from teleop_drake.study.figures.labels import (
    DELAYS,
    AxisLabel,
    IsNumber,
    LabelOfValue,
    ShortLabels,
    ValueLabel,
)
from teleop_drake.study.figures.layout import MakePanels, Panels
from teleop_drake.study.figures.style import FONT_SIZE, Figure, Key, Look
from teleop_drake.study.sweep import SweepResult, TaskSweepResult, VariesSeedsOnly
from teleop_drake.study.sweep.statistics import CONTROLLERS
from teleop_drake.study.sweep.values import SEED

MAX_PANELS = 24
"""The largest number of panels that are large enough to read."""

MAX_NAMED_LINES = 8
"""The largest number of lines that are all named in the legend."""

SEQUENCE = colormaps["viridis"]
"""Colours of ordered values."""


class SweepGrid:
    """The roles that the keys of a sweep have in its figures.

    If only seeds, or seeds and controllers, are varied, the controllers stand along the
    horizontal axis.

    Attributes:
        x_key: The key along the horizontal axis: a delay, or another key with numbers.
        x: The values of `x_key`, ascending, or the places of the controllers.
        x_names: The names of the controllers along the axis, else empty.
        line_key: The last varied key that is neither the controller nor `x_key`, else
            the controller; empty if the grid has neither.
        line_values: The values of `line_key`, each of which has a line.
        has_two_keys: Whether a key is varied beside controller, seed and `x_key`.
        panel_points: The keys and values of each panel.
        num_columns: The number of panels side by side: one for each controller, or one
            if the controllers are lines.
        shape: The numbers of panels, lines, values of x and seeds.

    Raises:
        ValueError: If no key has numbers although more than controllers and seeds is
            varied, or there would be too many panels.
    """

    def __init__(self, result: SweepResult) -> None:
        axes = result.axes
        varied = [key for key, values in axes.items() if len(values) > 1]
        controller = [key for key in axes if key in CONTROLLERS][:1]
        numeric = [
            key
            for key in (*DELAYS, *axes)
            if key in axes and key != SEED and all(map(IsNumber, axes[key]))
        ]
        # The horizontal axis: controllers, or the first varied key with numbers.
        self.x_names: list[str] = []
        if VariesSeedsOnly(result):
            self.x_key = controller.pop() if controller else ""
            kinds = axes.get(self.x_key, [""])
            if not self.x_key and isinstance(result, TaskSweepResult):
                kinds = [result.scenario.controller.kind]
            self.x_names = [ValueLabel(x).replace(" ", "\n", 1) for x in kinds]
            x = np.arange(float(len(kinds)))
        elif numeric:
            self.x_key = next((key for key in numeric if key in varied), numeric[0])
            x = np.array(axes[self.x_key], dtype=float)
        else:
            Refuse("result", "with no key with numbers", "of one such key or more")
        # The last of the other keys has lines, the rest of them have rows of panels.
        others = [k for k in varied if k not in (self.x_key, *controller, SEED)]
        self.has_two_keys = bool(others)
        *row_keys, self.line_key = others or controller or [""]
        column_keys = controller if others else []
        self.line_values = axes.get(self.line_key, [])
        columns = _Points(result, column_keys)
        self.num_columns = len(columns)
        self.panel_points = [
            column | row for row in _Points(result, row_keys) for column in columns
        ]
        num_panels = len(self.panel_points)
        if num_panels > MAX_PANELS:
            needs = f"needs {num_panels // len(columns)} x {len(columns)} panels"
            Refuse("result", needs, f"of {MAX_PANELS} panels at most")
        # The order of the grid's axes in Arrange().
        keys = [*row_keys, *column_keys, self.line_key, self.x_key, SEED]
        names = list(axes)
        rest = [key for key in names if key not in keys]  # They have one value each.
        self._order = [names.index(key) for key in [*rest, *keys] if key in names]
        self._x_order = np.argsort(x)
        self.x = x[self._x_order]
        num_lines = max(len(self.line_values), 1)
        num_seeds = len(axes.get(SEED, [0]))
        self.shape = (num_panels, num_lines, len(x), num_seeds)

    def Arrange(self, values: Array) -> Array:
        """Returns an array of the grid's shape as (panels, lines, x, seeds)."""
        return values.transpose(self._order).reshape(self.shape)[..., self._x_order, :]

    def MakePanels(self, num_metrics: int = 1) -> tuple[Figure, Panels]:
        """Returns a figure and its panels (metrics, panels).

        Metrics with one panel each stand side by side, others one below the other.
        """
        num_panels = self.shape[0]
        total = num_metrics * num_panels
        across = self.num_columns if num_panels > 1 else min(num_metrics, 3)
        down = math.ceil(total / across)
        height = 0.8 + (2.6 if down == 1 else 1.7) * down
        figure, axes = MakePanels(
            down, across, height=height, share_x="all", share_y="none", padding=0.1
        )
        for ax in axes.flat[total:]:
            ax.remove()
        panels = axes.flat[:total].reshape(num_metrics, num_panels)
        for ax in panels.flat[-across:]:
            ax.set_xlabel("" if self.x_names else AxisLabel(self.x_key))
            ax.tick_params(labelbottom=True)
            if self.x_names:
                ax.set_xticks(self.x, self.x_names)
                ax.set_xlim(-0.6, len(self.x) - 0.4)
        for metric in panels:
            for i, ax in enumerate(metric[1:], start=1):
                ax.sharey(metric[0])
                ax.tick_params(labelleft=i % self.num_columns == 0)
        return figure, panels

    def AddTitles(self, panels: Panels, num_marks: int = 0) -> None:
        """Writes the values of each panel above it and above the rows of marks."""
        for (_, i), ax in np.ndenumerate(panels):
            names = itertools.starmap(LabelOfValue, self.panel_points[i].items())
            ax.set_title(
                ", ".join(names) or " ",  # A blank title reserves room for the marks.
                fontsize=FONT_SIZE,
                y=1.03 + 0.035 * num_marks,
                pad=2,
            )

    def LineStyle(self, i: int) -> Look:
        """Returns the style of line i; values of several controllers are not joined."""
        if self.x_names:
            return {"color": style.COLORS[0], "linestyle": "none"}
        if not self.has_two_keys:
            return style.RunStyle(i)
        share = i / max(len(self.line_values) - 1, 1)
        return {"color": SEQUENCE(0.92 * share), "linewidth": 1.1}

    def LineCoordinates(self) -> tuple[Array, list[str] | None]:
        """Returns the places of the lines on an axis, with names if they are words."""
        values = self.line_values
        if all(map(IsNumber, values)) and list(values) == sorted(values):
            return np.array(values, dtype=float), None
        places = np.arange(float(len(values)))
        return places, [ValueLabel(value) for value in values]

    def LineHandles(self) -> list[Line2D]:
        """Returns the legend entries of the lines."""
        values = self.line_values
        step = math.ceil(len(values) / MAX_NAMED_LINES)
        # A few of many lines are enough to show their order.
        lines = [i for i in range(len(values)) if i % step == 0 or i == len(values) - 1]
        labels = [LabelOfValue(self.line_key, values[i]) for i in lines]
        return [
            Key(label, **self.LineStyle(i))
            for i, label in zip(lines, ShortLabels(labels), strict=True)
        ]


def _Points(result: SweepResult, keys: Sequence[str]) -> list[Record]:
    """Returns all combinations of the values of some keys."""
    values = (result.axes[key] for key in keys)
    return [dict(zip(keys, point, strict=True)) for point in itertools.product(*values)]


def MetricScale(
    result: SweepResult, metric: str, values: Array
) -> tuple[float, str, Interval]:
    """Returns the scale of a metric, its label, and the limits before scaling."""
    finite = values[np.isfinite(values)]
    limits = (finite.min(), finite.max()) if finite.size else (0.0, 1.0)
    scale, unit = ScaleAndUnit(limits, result.units[metric])
    label = metric.replace("_", " ").replace(".", " ")
    # The label is no longer than a panel is high.
    label = textwrap.fill(f"{label} [{unit}]" if unit else label, 26)
    return scale, label, limits

"""Layout that the figures share: panels in rows and columns, and their names."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.layout_engine import ConstrainedLayoutEngine

from teleop_drake.figures.style import FONT_SIZE, WIDTH, Figure, FormatTicks

Sharing = Literal["none", "all", "row", "col"]
"""Which panels have one axis in common."""


def MakePanels(
    num_rows: int,
    num_columns: int,
    *,
    height: float,
    width: float = WIDTH,
    share_x: Sharing = "none",
    share_y: Sharing = "none",
    padding: float | None = None,
) -> tuple[Figure, np.ndarray]:
    """Returns a figure and its panels (rows, columns).

    Args:
        height, width: Of the figure, inches.
        share_x, share_y: Which panels have a horizontal or a vertical axis in common.
        padding: Space beside the panels, inches; None: Matplotlib's own.
    """
    layout = ConstrainedLayoutEngine(w_pad=padding)
    figure = Figure(figsize=(width, height), layout=layout)
    axes = figure.subplots(
        num_rows, num_columns, sharex=share_x, sharey=share_y, squeeze=False
    )
    return figure, axes


def NameColumns(axes: np.ndarray, titles: Sequence[str]) -> None:
    """Writes a title above each column of panels."""
    for ax, title in zip(axes[0], titles, strict=True):
        ax.set_title(title, fontsize=FONT_SIZE)


def NameX(axes: Sequence[Axes] | np.ndarray, label: str) -> None:
    """Names the horizontal axis of panels."""
    for ax in axes:
        ax.set_xlabel(label, fontsize=FONT_SIZE)


def NameY(axes: Sequence[Axes] | np.ndarray, labels: Sequence[str]) -> None:
    """Names the vertical axis of each panel."""
    for ax, label in zip(axes, labels, strict=True):
        ax.set_ylabel(label, fontsize=FONT_SIZE)


def NameAxes(axes: np.ndarray, x: str, *y: str) -> None:
    """Names the axes: below the columns, and at the left of the rows.

    Args:
        axes: Panels (rows, columns).
        x: The name below each column.
        y: The name of each row.
    """
    for ax in axes.flat:
        FormatTicks(ax)
    NameX(axes[-1], x)
    NameY(axes[:, 0], y)

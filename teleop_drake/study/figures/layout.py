"""Layout of the figures: panels in rows and columns, with titles and labels."""

from collections.abc import Sequence
from typing import Any, Literal

from matplotlib import rc_context
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray

from teleop_drake.study.figures.style import FONT_SIZE, SMALL_FONT_SIZE, WIDTH, Figure

Panels = NDArray[Any]
"""Axes of Matplotlib (rows, columns)."""

Sharing = Literal["none", "all", "row", "col"]
"""The panels that share an axis, as in Matplotlib's subplots()."""


def MakePanels(
    num_rows: int,
    num_columns: int,
    *,
    height: float,
    width: float = WIDTH,
    share_x: Sharing = "col",
    share_y: Sharing = "row",
    padding: float | None = None,
) -> tuple[Figure, Panels]:
    """Returns a figure and its panels (rows, columns), with few spines.

    Args:
        height, width: Size of the figure in inches.
        share_x, share_y: Which panels share their horizontal or vertical axis.
        padding: Horizontal space around a panel in inches; by default Matplotlib's.
    """
    layout = ConstrainedLayoutEngine(w_pad=padding)
    figure = Figure(figsize=(width, height), layout=layout)
    with rc_context({"axes.labelsize": FONT_SIZE}):
        axes = figure.subplots(
            num_rows, num_columns, sharex=share_x, sharey=share_y, squeeze=False
        )
    for ax in axes.flat:
        ax.tick_params(labelsize=SMALL_FONT_SIZE, width=0.6, length=2.5)
        ax.spines[["left", "bottom"]].set_linewidth(0.6)
    return figure, axes


def MakeMultiples(
    titles: Sequence[str],
    x_label: str,
    y_labels: Sequence[str],
    *,
    height: float,
    width: float = WIDTH,
    padding: float | None = None,
) -> tuple[Figure, Panels]:
    """Returns a figure with a column of panels for each title, and its panels.

    Args:
        x_label: Label of the horizontal axis, below each column.
        y_labels: Labels of the vertical axes at the left, one for each row.
        height, width, padding: As in MakePanels().
    """
    figure, axes = MakePanels(
        len(y_labels), len(titles), height=height, width=width, padding=padding
    )
    for ax, title in zip(axes[0], titles, strict=True):
        ax.set_title(title, fontsize=FONT_SIZE)
    for ax in axes[-1]:
        ax.set_xlabel(x_label)
    for ax, label in zip(axes[:, 0], y_labels, strict=True):
        ax.set_ylabel(label)
    return figure, axes

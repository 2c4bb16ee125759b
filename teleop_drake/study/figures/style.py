"""Style of the figures: colours, lines, marks and sizes for print."""

import io
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import matplotlib.figure
import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.rcsetup import cycler
from matplotlib.ticker import ScalarFormatter

from teleop_drake.loops.framework.arrays import Array, Interval
from teleop_drake.loops.framework.validation import Refuse

Look = dict[str, Any]
"""Keyword arguments of Matplotlib that style an artist."""

# The palette of Okabe and Ito, "Color universal design" (2008), without its yellow,
# which is too pale for lines. Colour-blind people can tell the brown and the violet
# that follow from these colours and from grey.
COLORS = (
    *("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000"),
    *("#5A2D00", "#9600F0"),
)
LINES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))
GREY = "#808080"

# Sizes for print: two panels across the width of a text block.
WIDTH = 7.0  # inches
COLUMN_WIDTH = 3.45  # inches; one of two columns
FONT_SIZE = 8  # points
SMALL_FONT_SIZE = 7  # points

BOUNDARY_STYLE: Look = {
    "color": GREY,
    "linestyle": (0, (1, 2)),
    "linewidth": 0.8,
    "zorder": 0,
}

MARK_STYLE: Look = {
    "markersize": 3.5,
    "markerfacecolor": "none",
    "markeredgewidth": 0.8,
    "linestyle": "none",
    "clip_on": False,
    "in_layout": False,
}
"""Style of the marks above a panel."""


_STYLE: dict[Any, Any] = {
    "axes.prop_cycle": cycler(color=COLORS),
    "axes.spines.top": False,
    "axes.spines.right": False,
}

_DOTS_PER_INCH = 200  # of a notebook's picture, which is shown at half its size


class Figure(matplotlib.figure.Figure):
    """A figure in the package's style, which a notebook shows without pyplot.

    Unless `layout` sets another one, the layout is constrained, which prevents labels
    from overlapping. All arguments are those of Matplotlib's Figure.
    """

    def __init__(self, *args: Any, layout: Any = "constrained", **kwargs: Any) -> None:
        super().__init__(*args, layout=layout, **kwargs)

    def add_subplot(self, *args: Any, **kwargs: Any) -> Any:
        """Adds a panel with the package's colours and open axes."""
        with rc_context(_STYLE):
            return super().add_subplot(*args, **kwargs)

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Returns a PNG for high-resolution screens, and the size to show it in."""
        for legend in self.findobj(Legend):
            legend.set_frame_on(False)
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=_DOTS_PER_INCH)
        width, height = self.get_size_inches() * _DOTS_PER_INCH / 2
        return buffer.getvalue(), {"width": int(width), "height": int(height)}


def WidthOf(columns: int) -> float:
    """Returns the width in inches of a figure across one or two printed columns.

    Raises:
        ValueError: If `columns` is neither 1 nor 2.
    """
    if columns not in (1, 2):
        Refuse("columns", columns, "1 or 2")
    return COLUMN_WIDTH if columns == 1 else WIDTH


def Widen(limits: Interval, scale: float) -> Interval:
    """Returns a range in the unit shown, with a margin on both sides."""
    low, high = (limit * scale for limit in limits)
    # A constant with rounding errors is drawn as a flat line, and so is zero.
    margin = max(0.06 * (high - low), 0.01 * max(abs(low), abs(high))) or 0.5
    return low - margin, high + margin


def RunColor(i: int) -> str:
    """Returns the colour of the i-th run of a figure; the colours repeat."""
    return COLORS[i % len(COLORS)]


def RunStyle(i: int) -> Look:
    """Returns colour and line style of the i-th run of a figure."""
    return {
        "color": RunColor(i),
        "linestyle": LINES[i % len(LINES)],
        "linewidth": 1.1,
        "zorder": 2 + i,
    }


def EndStyle(i: int) -> Look:
    """Returns the style of the mark at the end of run i, which diverges."""
    return {
        "color": RunColor(i),
        "marker": "x",
        "markersize": 5,
        "linestyle": "none",
        "zorder": 10,
    }


def EventStyle(marker: str, color: str) -> Look:
    """Returns the style of the mark of an event on a curve of the given colour."""
    return {
        "marker": marker,
        "markersize": 3.5,
        "color": color,
        "markeredgecolor": "black",
        "markeredgewidth": 0.5,
        "linestyle": "none",
        "zorder": 9,
    }


def NameAbove(
    ax: Axes, x: float, name: str, align: Literal["center", "left"] = "center"
) -> None:
    """Writes a name above a panel, centred at x or beginning there."""
    ax.annotate(
        name,
        (x, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(0, 2),
        textcoords="offset points",
        ha=align,
        va="bottom",
        fontsize=SMALL_FONT_SIZE,
    )


def MarkAbove(ax: Axes, x: Array, level: int = 0, **look: Any) -> None:
    """Draws marks above a panel, at positions x (N) of its horizontal axis.

    Args:
        level: The row of the marks, from 0 for the lowest.
    """
    y = np.full(len(x), 1.03 + 0.035 * level)
    ax.plot(x, y, transform=ax.get_xaxis_transform(), **MARK_STYLE, **look)


def Key(label: str, **line: Any) -> Line2D:
    """Returns a legend entry in the style of a line."""
    return Line2D([], [], label=label, **line)


def RunKeys(labels: Iterable[str]) -> list[Line2D]:
    """Returns the legend entries of runs 0, 1, ... with the given labels."""
    return [Key(label, **RunStyle(i)) for i, label in enumerate(labels)]


def AddLegend(
    figure: Figure, handles: Sequence[Artist], *, fontsize: float = FONT_SIZE
) -> None:
    """Adds a legend above all panels, unless it would have no entry.

    The number of columns is the largest that fits, estimated from the width of an
    average letter.
    """
    if not handles:
        return
    width = figure.get_figwidth()
    margin = 0.5 if width >= WIDTH else 0.75
    letter = 0.00725 * fontsize
    widths = [margin + letter * len(str(handle.get_label())) for handle in handles]
    ncols = len(handles)
    while ncols > 1 and sum(map(max, np.array_split(widths, ncols))) > width:
        ncols -= 1
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=ncols,
        fontsize=fontsize,
        frameon=False,
    )


class _ShortNumbers(ScalarFormatter):
    """Formats ticks as plain text, drawn faster, and powers of ten as formulas."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Returns the label of a tick."""
        formula = super().__call__(x, pos)
        return formula.removeprefix(r"$\mathdefault{").removesuffix("}$")


def FormatAxes(ax: Axes) -> None:
    """Gives the vertical axis of a panel short numbers, and draws a line at zero."""
    ax.yaxis.set_major_formatter(_ShortNumbers(useOffset=False, useMathText=True))
    ax.ticklabel_format(axis="y", scilimits=(-3, 4))
    ax.yaxis.get_offset_text().set_fontsize(SMALL_FONT_SIZE)
    ax.axhline(0.0, color=GREY, linewidth=0.4, zorder=0)


def CellEdges(centres: Array) -> Array:
    """Returns the boundaries (N + 1) of cells around ascending centres (N)."""
    if len(centres) == 1:
        return centres + np.array([-0.5, 0.5])
    # The outermost cells are symmetric about their centres.
    padded = np.pad(centres, 1, mode="reflect", reflect_type="odd")
    return np.asarray((padded[1:] + padded[:-1]) / 2)


def MapLimits(centres: Array) -> Interval:
    """Returns the limits of an axis of a map: its outermost values.

    They cut the outermost cells in half, so that no cell extends beyond the values
    that were computed.

    Args:
        centres: The values, ascending. A single value has its whole cell shown.
    """
    ends = CellEdges(centres) if len(centres) == 1 else centres
    return ends[0], ends[-1]

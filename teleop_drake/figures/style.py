"""Style of the figures: colours, sizes for print, names and units."""

import io
import math
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
from matplotlib.ticker import EngFormatter, ScalarFormatter

from teleop_drake.arrays import Array, Interval
from teleop_drake.signals import AxesOf
from teleop_drake.sweep.statistics import CONTROLLERS
from teleop_drake.validation import Refuse

Look = dict[str, Any]
"""How something is drawn: keywords of Matplotlib."""

# Okabe and Ito, "Color universal design" (2008), without yellow, too pale for lines;
# then a brown and a violet, which the colour-blind can tell from these and from grey.
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
"""Marks above a panel."""

# Keys of a sweep that are delays.
DELAYS = ("delay", "forward_delay", "return_delay")


_STYLE: dict[Any, Any] = {
    "axes.prop_cycle": cycler(color=COLORS),
    "axes.spines.top": False,
    "axes.spines.right": False,
}

_DOTS_PER_INCH = 200  # of a picture in a notebook, twice as many as it shows


class Figure(matplotlib.figure.Figure):
    """A figure in the package's style, which a notebook shows without pyplot.

    Its panels are laid out so that no label overlaps another, unless `layout` says
    otherwise. All arguments are those of Matplotlib's Figure.
    """

    def __init__(self, *args: Any, layout: Any = "constrained", **kwargs: Any) -> None:
        super().__init__(*args, layout=layout, **kwargs)

    def add_subplot(self, *args: Any, **kwargs: Any) -> Any:
        """Adds a panel with the package's colours and open axes."""
        with rc_context(_STYLE):
            return super().add_subplot(*args, **kwargs)

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Returns a picture for screens with many dots, and the width to show it in."""
        for legend in self.findobj(Legend):
            legend.set_frame_on(False)
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=_DOTS_PER_INCH)
        width, height = self.get_size_inches() * _DOTS_PER_INCH / 2
        return buffer.getvalue(), {"width": int(width), "height": int(height)}


def WidthOf(columns: int) -> float:
    """Returns the width in inches of a figure across one or two printed columns.

    Raises:
        ValueError: If it is another number.
    """
    if columns not in (1, 2):
        Refuse("columns", columns, "1 or 2")
    return COLUMN_WIDTH if columns == 1 else WIDTH


def Widen(limits: Interval, scale: float) -> Interval:
    """Returns the range in the unit shown, with a margin."""
    low, high = (limit * scale for limit in limits)
    # A constant stays a line, however little it varies; so does zero.
    margin = max(0.06 * (high - low), 0.01 * max(abs(low), abs(high))) or 0.5
    return low - margin, high + margin


def ScaleAndUnit(limits: Interval, unit: str) -> tuple[float, str]:
    """Returns the scale and the unit with an SI prefix that suit a range."""
    largest = max(map(abs, limits))
    if unit not in ("m", "m/s", "N") or largest == 0:
        return 1.0, unit
    # From 0.1 to 100 of the unit shown.
    exponent = 3 * min(max(math.floor(math.log10(10 * largest) / 3), -3), 2)
    return 10.0**-exponent, EngFormatter.ENG_PREFIXES[exponent] + unit


def RunColor(i: int) -> str:
    """Returns the colour of run i of a figure; after the last they begin anew."""
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
    """Returns how the end of run i is drawn that diverges."""
    return {
        "color": RunColor(i),
        "marker": "x",
        "markersize": 5,
        "linestyle": "none",
        "zorder": 10,
    }


def EventStyle(marker: str, color: str) -> Look:
    """Returns how an event is drawn on a curve of a colour."""
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
    """Writes a name above a panel: its middle or its left end is at an x."""
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
    """Marks points (N) of the horizontal axis above a panel, on one of some levels."""
    y = np.full(len(x), 1.03 + 0.035 * level)
    ax.plot(x, y, transform=ax.get_xaxis_transform(), **MARK_STYLE, **look)


def Key(label: str, **line: Any) -> Line2D:
    """Returns the entry of a line in a legend."""
    return Line2D([], [], label=label, **line)


def RunKeys(labels: Iterable[str]) -> list[Line2D]:
    """Returns the entries of runs in a legend, in the order of their numbers."""
    return [Key(label, **RunStyle(i)) for i, label in enumerate(labels)]


def AddLegend(
    figure: matplotlib.figure.Figure,
    handles: Sequence[Artist],
    *,
    fontsize: float = FONT_SIZE,
) -> None:
    """Adds a legend above all panels, if there is anything to tell.

    It has as many columns as fit, by the width of an average letter.
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
    """Numbers as plain text, which is drawn faster; the power of ten is a formula."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Returns a number beside its tick."""
        formula = super().__call__(x, pos)
        return formula.removeprefix(r"$\mathdefault{").removesuffix("}$")


def FormatAxes(ax: Axes) -> None:
    """Gives a panel short numbers and a line at zero."""
    ax.yaxis.set_major_formatter(_ShortNumbers(useOffset=False, useMathText=True))
    ax.ticklabel_format(axis="y", scilimits=(-3, 4))
    ax.yaxis.get_offset_text().set_fontsize(SMALL_FONT_SIZE)
    ax.axhline(0.0, color=GREY, linewidth=0.4, zorder=0)


# The numbers of a scenario that have one unit wherever they stand, by the last part
# of their names. Gains whose unit the architecture decides are not among them.
_NAMES_BY_UNIT = {
    "s": "delay forward_delay return_delay sample_period std minimum depth duration "
    "stop_time max_step_size",
    "m": "start reference",
    "kg": "mass",
    "1/s": "G1 G2",
    "1/kg": "initial_psi minimum_psi",
    "N": "contact_force force_limit coulomb_friction",
    "N/m": "stiffness",
    "N s/m": "damping viscous_friction",
    "m/s": "velocity friction_speed",
    "rad": "phase",
    "rad/s": "frequency bandwidth",
    "s/s": "drift",
    "packets": "burst_length",
}
_UNITS = {x: unit for unit, names in _NAMES_BY_UNIT.items() for x in names.split()}


def _NameAndUnit(key: str) -> tuple[str, str]:
    """Returns a varied key of a scenario in words, and its unit; "" if it has none."""
    if key in DELAYS:
        return ("delay each way" if key == "delay" else key.replace("_", " ")), "s"
    parts = key.split(".")
    last = parts[-2] if parts[-1].isdecimal() and len(parts) > 1 else parts[-1]
    # The element of a vector is that of an axis.
    names = [
        AxesOf(6)[int(part)] if part.isdecimal() and int(part) < 6 else part
        for part in parts[-2:]
    ]
    return " ".join(names).replace("_", " "), _UNITS.get(last, "")


def AxisLabel(key: str) -> str:
    """Returns what the axis of a varied key of a scenario says: its name and unit."""
    name, unit = _NameAndUnit(key)
    return f"{name} [{unit}]" if unit else name


def IsNumber(value: Any) -> bool:
    """Returns whether a value is a number, and not a truth."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def ValueLabel(value: Any) -> str:
    """Returns a value of a scenario as a figure says it."""
    text = f"{value:g}" if IsNumber(value) else str(value).replace("_", " ")
    # Between two dollars matplotlib reads a formula.
    return text.replace("$", r"\$")


def LabelOfValue(key: str, value: Any) -> str:
    """Returns a value of a varied key as a legend says it, with its unit."""
    if key in CONTROLLERS:
        return ValueLabel(value)
    name, unit = _NameAndUnit(key)
    return f"{name} = {ValueLabel(value)} {unit}".strip()


def ShortLabels(labels: Sequence[str]) -> list[str]:
    """Returns labels of one varied key: its name stands in the first one only.

    "delay = 0.1 s", "delay = 0.2 s" become "delay = 0.1 s", "0.2 s". Others stay.
    """
    parts = [label.split(" = ") for label in labels]
    names = {name for name, *_ in parts}
    if len(names) != 1 or any(len(part) != 2 for part in parts):
        return list(labels)
    return [labels[0], *(value for _, value in parts[1:])]


def CellEdges(centres: Array) -> Array:
    """Returns the boundaries (N + 1) of cells around ascending centres (N)."""
    if len(centres) == 1:
        return centres + np.array([-0.5, 0.5])
    # The outermost cells reach as far to either side.
    padded = np.pad(centres, 1, mode="reflect", reflect_type="odd")
    return np.asarray((padded[1:] + padded[:-1]) / 2)


def MapLimits(centres: Array) -> Interval:
    """Returns where a map ends: at the outermost values, which halves their cells.

    No cell then reaches to where nothing was looked at.

    Args:
        centres: The values, ascending; a single one has the whole of its cell.
    """
    ends = CellEdges(centres) if len(centres) == 1 else centres
    return ends[0], ends[-1]

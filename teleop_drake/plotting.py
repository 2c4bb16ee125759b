"""Figures of runs: pure functions of recordings.

Every function returns a matplotlib Figure that belongs to the caller: pyplot is not
involved and no global setting changes. Colours are those of Okabe and Ito, which
colour-blind people can tell apart; line styles tell the runs apart in grey print.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from teleop_drake.files import Replacing
from teleop_drake.recording import Recording
from teleop_drake.scenario import Scenario, TrackingScenario
from teleop_drake.sweep import MetricUnits, SweepResult

# Okabe and Ito, "Color universal design" (2008), without yellow, too pale for lines.
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
_LINES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))
_GREY = "#808080"

# Sizes for print: two panels across the width of a text block.
_WIDTH = 7.0  # inches
_ROW_HEIGHT = 1.2  # inches
_FONT_SIZE = 8  # points
_SMALL_FONT_SIZE = 7  # points

# Points across a panel: enough that no corner shows.
_NUM_POINTS = 1500

# A run that diverges may widen the range of a panel by this share on either side.
_DIVERGED_SHARE = 1.0

# Up to this many components of a signal have a name in a legend.
_MAX_NAMED_COMPONENTS = 4

_BORDER_STYLE: dict[str, Any] = {
    "color": _GREY,
    "linestyle": (0, (1, 2)),
    "linewidth": 0.8,
    "zorder": 0,
}
_EVENTS = {"puncture": ("^", "puncture"), "contact": ("s", "first contact")}

# Suffixes that SaveFigure knows, and the metadata that would change with each file.
_METADATA: dict[str, dict[str, None]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


@dataclass(kw_only=True)
class _Row:
    """One signal: a panel against time and one against position.

    Attributes:
        label: What the axis shows, without the unit.
        unit: SI unit; empty if there is none.
        signal: Name of the signal.
        components: Which of its components are shown.
        command: Component of the surgeon's commands that is shown beside, or None.
        symbol: Name of the components in a legend, if there is more than one.
        is_x: Whether this is the position along x itself: borders are horizontal
            lines, and there is nothing to see against position.
    """

    label: str
    unit: str
    signal: str
    components: Sequence[int]
    command: int | None = None
    symbol: str = ""
    is_x: bool = False


@dataclass(kw_only=True)
class _Curves:
    """The components of a signal of one run, dense enough to draw.

    Attributes:
        time: (T,) in s; a time that stands twice is a jump.
        x: (T,) position along x in m.
        y: (T, k).
    """

    time: np.ndarray
    x: np.ndarray
    y: np.ndarray


def PlotComparison(recordings: Mapping[str, Recording]) -> Figure:
    """Plots runs of a task together, as the thesis does (Fig. 4.1 to 5.20).

    One row each for tool velocity (with what the surgeon commands), sensed force,
    tool position and control force, per task axis: against time on the left, against
    the position along x on the right. Filled triangles and squares mark the puncture
    and the first contact. A run that diverges ends in a cross and does not spoil the
    range for the others.

    Args:
        recordings: Runs by the name that the legend gives them, for instance
            {"direct force": ..., "adaptive": ...}; of robots with as many axes.

    Raises:
        ValueError: If there is no recording, or their numbers of axes differ.
    """
    if not recordings:
        raise ValueError("recordings: empty; allowed: at least one")
    sizes = {x["tool_position"].shape[1] for x in recordings.values()}
    if len(sizes) > 1:
        raise ValueError(
            f"recordings: runs with {sorted(sizes)} task axes; allowed: one number"
        )
    return _Plot(recordings, _MotionRows(list(recordings.values())))


def PlotRun(recording: Recording) -> Figure:
    """Plots one run: what PlotComparison shows and, if it adapts, Psi and weights.

    Of a run of a TrackingScenario it plots, per task axis against time, the position
    with the desired one, the tracking error, and the disturbance with its estimate.

    Args:
        recording: The run.
    """
    if isinstance(recording.scenario, TrackingScenario):
        return _PlotTracking(recording)
    return _Plot(
        {recording.scenario.controller.kind.replace("_", " "): recording},
        [*_MotionRows([recording]), *_TelemetryRows(recording)],
    )


def PlotWeights(recording: Recording) -> Figure:
    """Plots what an adaptive controller learns: Psi and the weights of its networks.

    Args:
        recording: A run with the signals `psi`, `weights_1` or `weights_3`.

    Raises:
        ValueError: If it has none of them.
    """
    rows = _TelemetryRows(recording)
    if not rows:
        raise ValueError(
            "recording: no signal psi, weights_1 or weights_3; allowed: a run of an "
            "adaptive controller"
        )
    return _Plot(
        {recording.scenario.controller.kind.replace("_", " "): recording}, rows
    )


def SaveFigure(figure: Figure, path: str | Path) -> None:
    """Writes a figure; the same figure gives the same bytes.

    The file appears complete or not at all.

    Args:
        figure: The figure.
        path: Where to; the suffix, .png, .svg or .pdf, decides the format.

    Raises:
        OSError: If the file cannot be written.
        ValueError: If the suffix is none of these.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _METADATA:
        raise ValueError(f"path: {str(path)!r}; allowed: *.png, *.svg or *.pdf")
    with (
        Replacing(path) as temporary,
        matplotlib.rc_context({"svg.hashsalt": "teleop-drake", "pdf.fonttype": 42}),
    ):
        figure.savefig(
            temporary, format=suffix[1:], dpi=200, metadata=_METADATA[suffix]
        )


def _AxisName(axis: int) -> str:
    return "xyz"[axis] if axis < 3 else str(axis + 1)


def _MotionRows(recordings: Sequence[Recording]) -> list[_Row]:
    n = recordings[0]["tool_position"].shape[1]
    rows = []
    for k in range(n):
        row = _Row(
            label=f"velocity $v_{_AxisName(k)}$",
            unit="m/s",
            signal="tool_velocity",
            components=[k],
            command=n + k,
        )
        rows.append(row)
    for k in range(n):
        row = _Row(
            label=f"sensed force $F_{{e,{_AxisName(k)}}}$",
            unit="N",
            signal="environment_force",
            components=[k],
        )
        # The layers push along x only: the others would be empty panels.
        if k == 0 or any(x["environment_force"][:, k].any() for x in recordings):
            rows.append(row)
    for k in range(n):
        row = _Row(
            label=f"position ${_AxisName(k)}$",
            unit="m",
            signal="tool_position",
            components=[k],
            is_x=k == 0,
        )
        rows.append(row)
    for k in range(n):
        row = _Row(
            label=f"control force $F_{{c,{_AxisName(k)}}}$",
            unit="N",
            signal="control_force",
            components=[k],
        )
        rows.append(row)
    return rows


def _TelemetryRows(recording: Recording) -> list[_Row]:
    return [
        _Row(
            label=label,
            unit=unit,
            signal=signal,
            components=range(recording[signal].shape[1]),
            symbol=symbol,
        )
        for signal, label, unit, symbol in (
            ("psi", r"$\Psi$", "1/kg", r"\Psi"),
            ("weights_1", "weights $W_1$", "", "W_1"),
            ("weights_3", "weights $W_3$", "", "W_3"),
        )
        if signal in recording.signals
    ]


def _Plot(recordings: Mapping[str, Recording], rows: Sequence[_Row]) -> Figure:
    figure = Figure(
        figsize=(_WIDTH, _ROW_HEIGHT * len(rows) + 0.7),
        # Aligned labels may end up a little further out than the layout reckons.
        layout=ConstrainedLayoutEngine(w_pad=0.1),
    )
    axes = figure.subplots(len(rows), 2, sharex="col", sharey="row", squeeze=False)
    runs = list(recordings.values())
    x_range = _Range(runs, [_Sample(run, "tool_position", [0]) for run in runs])
    x_scale, x_unit = _Unit(x_range, "m")
    borders = _Borders(runs, x_range)
    # These hold for the whole column.
    axes[0, 0].set_xlim(0.0, max(float(run.time[-1]) for run in runs) or 1.0)
    axes[0, 1].set_xlim(_Widen(x_range, x_scale))

    for row, (left, right) in zip(rows, axes, strict=True):
        curves = [_Sample(run, row.signal, row.components) for run in runs]
        commands = [] if row.command is None else [_Command(run, row) for run in runs]
        y_range = _Range(runs, curves, commands)
        scale, unit = _Unit(y_range, row.unit)
        left.set_ylim(_Widen(y_range, scale))
        left.set_ylabel(
            f"{row.label}\n[{unit}]" if unit else row.label, fontsize=_FONT_SIZE
        )
        for ax, x_axis_scale in ((left, None), (right, x_scale)):
            _Format(ax)
            _DrawPanel(ax, row, runs, curves, commands, scale, x_axis_scale)
        for border in borders:
            right.axvline(border * x_scale, **_BORDER_STYLE)
            if row.is_x:
                left.axhline(border * scale, **_BORDER_STYLE)
        right.set_visible(not row.is_x)
        if 1 < len(row.components) <= _MAX_NAMED_COMPONENTS:
            _AddComponentLegend(left, row)

    left, right = axes[-1]
    left.set_xlabel("time [s]", fontsize=_FONT_SIZE)
    right.set_xlabel(f"position $x$ [{x_unit}]", fontsize=_FONT_SIZE)
    for border, names in borders.items():
        axes[0, 1].annotate(
            "\n".join(names),
            (border * x_scale, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=_SMALL_FONT_SIZE,
        )
    figure.align_ylabels(axes[:, 0])
    _AddLegend(figure, recordings, rows)
    return figure


def _PlotTracking(recording: Recording) -> Figure:
    n = recording["tool_position"].shape[1]
    rows = (
        ("position", "m", ["tool_position", "desired_position"]),
        ("error", "m", ["tool_position"]),
        ("disturbance", "N", ["environment_force", "disturbance_estimate"]),
    )
    figure = Figure(
        figsize=(_WIDTH, _ROW_HEIGHT * len(rows) + 0.7), layout="constrained"
    )
    axes = figure.subplots(len(rows), n, sharex=True, squeeze=False)
    for (label, unit, signals), panels in zip(rows, axes, strict=True):
        for k, ax in enumerate(panels):
            curves = [_Sample(recording, signal, [k]) for signal in signals]
            if label == "error":
                desired = recording.Interpolate("desired_position", curves[0].time)
                curves[0].y = curves[0].y - desired[:, [k]]
            y_range = _Range([recording] * len(curves), curves)
            scale, shown_unit = _Unit(y_range, unit)
            _Format(ax)
            ax.set_ylim(_Widen(y_range, scale))
            ax.set_ylabel(
                f"{label} ${_AxisName(k)}$\n[{shown_unit}]", fontsize=_FONT_SIZE
            )
            for i, curve in enumerate(curves):
                ax.plot(curve.time, curve.y * scale, **_RunStyle(i))
    for ax in axes[-1]:
        ax.set_xlim(0.0, float(recording.time[-1]) or 1.0)
        ax.set_xlabel("time [s]", fontsize=_FONT_SIZE)
    figure.align_ylabels(axes)
    figure.legend(
        handles=[
            Line2D([], [], label=label, **_RunStyle(i))
            for i, label in enumerate(["actual", "desired, estimated"])
        ],
        loc="outside upper center",
        ncols=2,
        fontsize=_FONT_SIZE,
        frameon=False,
    )
    return figure


def _DrawPanel(
    ax: Axes,
    row: _Row,
    runs: Sequence[Recording],
    curves: Sequence[_Curves],
    commands: Sequence[_Curves],
    scale: float,
    x_scale: float | None,
) -> None:
    """Draws all runs against time or, if x_scale is not None, against position."""
    for command in commands:
        x = command.time if x_scale is None else command.x * x_scale
        ax.plot(x, command.y * scale, color=_GREY, linewidth=0.8, zorder=1)
    count = len(row.components)
    for i, (run, curve) in enumerate(zip(runs, curves, strict=True)):
        x = curve.time if x_scale is None else curve.x * x_scale
        for k in range(count):
            style = _RunStyle(i) if count == 1 else _ComponentStyle(k, count)
            ax.plot(x, curve.y[:, k] * scale, **style)
        if count > 1:
            continue
        _MarkEvents(ax, run, row, i, scale, x_scale)
        if run.termination == "diverged":
            end_x = np.clip(x[-1:], *ax.get_xlim())
            end_y = np.clip(curve.y[-1] * scale, *ax.get_ylim())
            ax.plot(end_x, end_y, **_EndStyle(i), clip_on=False)


def _Borders(
    runs: Sequence[Recording], x_range: tuple[float, float]
) -> dict[float, list[str]]:
    """Returns where tools puncture and collide within a range, and which it is."""
    borders: dict[float, list[str]] = {}
    for run in runs:
        for border, name in (
            (run.scenario.puncture_position, "puncture"),
            (run.scenario.contact_surface, "contact"),
        ):
            if border is None or not x_range[0] <= border <= x_range[1]:
                continue
            names = borders.setdefault(border, [])
            if name not in names:
                names.append(name)
    return borders


def _Sample(recording: Recording, signal: str, components: Sequence[int]) -> _Curves:
    """Returns a signal at the samples and, where it moves fast, between them."""
    time, y = recording.time, recording[signal][:, components]
    x = recording["tool_position"][:, 0]
    if len(components) > 1 or time[0] == time[-1]:
        return _Curves(time=time, x=x, y=y)  # Telemetry, which is slow.
    parts = np.ceil(_NUM_POINTS * np.diff(time) / (time[-1] - time[0])).astype(int)
    between = [
        np.linspace(time[i], time[i + 1], parts[i], endpoint=False)[1:]
        for i in np.flatnonzero(parts > 1)
    ]
    if between:
        extra = np.concatenate(between)
        y = np.concatenate([y, recording.Interpolate(signal, extra)[:, components]])
        x = np.concatenate([x, recording.Interpolate("tool_position", extra)[:, 0]])
        time = np.concatenate([time, extra])
        # Stable: the two sides of a jump stay in their order.
        order = np.argsort(time, kind="stable")
        time, x, y = time[order], x[order], y[order]
    return _Curves(time=time, x=x, y=y)


def _Command(recording: Recording, row: _Row) -> _Curves:
    """Returns the velocity which the surgeon commands, as it is sent."""
    command = recording.commands[:, row.command]
    x = recording["tool_position"][:, 0]
    return _Curves(time=recording.time, x=x, y=command[:, None])


def _Range(
    runs: Sequence[Recording],
    curves: Sequence[_Curves],
    commands: Sequence[_Curves] = (),
) -> tuple[float, float]:
    """Returns the range that shows the runs, those that diverge only in part."""
    diverged = [
        curve.y
        for run, curve in zip(runs, curves, strict=True)
        if run.termination == "diverged"
    ]
    shown = [
        curve.y
        for run, curve in zip(runs, curves, strict=True)
        if run.termination != "diverged"
    ]
    if not shown:
        # What is left is the time before it becomes hopeless.
        shown = [curve.y[curve.time <= 0.8 * curve.time[-1]] for curve in curves]
    shown += [command.y for command in commands]
    low, high = min(y.min() for y in shown), max(y.max() for y in shown)
    margin = _DIVERGED_SHARE * (high - low)
    wild = np.concatenate(diverged) if diverged else np.array([low, high])
    return (
        float(min(low, max(wild.min(), low - margin))),
        float(max(high, min(wild.max(), high + margin))),
    )


def _Widen(limits: tuple[float, float], scale: float) -> tuple[float, float]:
    """Returns the range in the unit shown, with a margin."""
    low, high = (limit * scale for limit in limits)
    # A constant stays a line, however little it varies; so does zero.
    margin = max(0.06 * (high - low), 0.01 * max(abs(low), abs(high))) or 0.5
    return low - margin, high + margin


def _Unit(limits: tuple[float, float], unit: str) -> tuple[float, str]:
    """Returns the scale and the unit with an SI prefix that suit a range."""
    largest = max(abs(limit) for limit in limits)
    if unit not in ("m", "m/s", "N") or largest == 0:
        return 1.0, unit
    # From 0.1 to 100 of the unit shown.
    exponent = min(max(math.floor(math.log10(10 * largest) / 3), -3), 2)
    prefix = {-3: "n", -2: "µ", -1: "m", 0: "", 1: "k", 2: "M"}[exponent]
    return 10.0 ** (-3 * exponent), prefix + unit


def _RunStyle(i: int) -> dict[str, Any]:
    return {
        "color": _COLORS[i % len(_COLORS)],
        "linestyle": _LINES[i % len(_LINES)],
        "linewidth": 1.1,
        "zorder": 2 + i,
    }


def _ComponentStyle(k: int, count: int) -> dict[str, Any]:
    is_named = count <= _MAX_NAMED_COMPONENTS
    return {
        "color": _COLORS[k % len(_COLORS)],
        "linestyle": _LINES[k % len(_LINES)] if is_named else "-",
        "linewidth": 1.1 if is_named else 0.6,
    }


def _EndStyle(i: int) -> dict[str, Any]:
    return {
        "color": _COLORS[i % len(_COLORS)],
        "marker": "x",
        "markersize": 5,
        "linestyle": "none",
        "zorder": 10,
    }


def _EventStyle(marker: str, color: str) -> dict[str, Any]:
    return {
        "marker": marker,
        "markersize": 3.5,
        "color": color,
        "markeredgecolor": "black",
        "markeredgewidth": 0.5,
        "linestyle": "none",
        "zorder": 9,
    }


def _MarkEvents(
    ax: Axes, run: Recording, row: _Row, i: int, scale: float, x_scale: float | None
) -> None:
    """Marks the puncture and the first contact on a curve of run i."""
    for name, (marker, _) in _EVENTS.items():
        time = np.array(run.EventTimes(name)[:1])
        if len(time) == 0:
            continue
        y = run.Interpolate(row.signal, time)[:, row.components[0]] * scale
        x = time
        if x_scale is not None:
            x = run.Interpolate("tool_position", time)[:, 0] * x_scale
        ax.plot(x, y, **_EventStyle(marker, _RunStyle(i)["color"]))


def _Format(ax: Axes) -> None:
    ax.tick_params(labelsize=_SMALL_FONT_SIZE, width=0.6, length=2.5)
    ax.ticklabel_format(axis="y", scilimits=(-3, 4), useOffset=False, useMathText=True)
    ax.yaxis.get_offset_text().set_fontsize(_SMALL_FONT_SIZE)
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_linewidth(0.6)
    ax.axhline(0.0, color=_GREY, linewidth=0.4, zorder=0)


def _AddComponentLegend(ax: Axes, row: _Row) -> None:
    count = len(row.components)
    size = math.isqrt(count)  # Matrices are recorded row by row.
    names = (
        [f"{i + 1}{j + 1}" for i in range(size) for j in range(size)]
        if size * size == count and row.signal == "psi"
        else [str(k + 1) for k in range(count)]
    )
    ax.legend(
        handles=[
            Line2D(
                [], [], label=f"${row.symbol}_{{{name}}}$", **_ComponentStyle(k, count)
            )
            for k, name in enumerate(names)
        ],
        ncols=2,
        fontsize=_SMALL_FONT_SIZE,
        frameon=False,
    )


def _AddLegend(
    figure: Figure, recordings: Mapping[str, Recording], rows: Sequence[_Row]
) -> None:
    if all(len(row.components) > 1 for row in rows):
        return  # Every panel tells its own lines apart.
    handles = []
    for i, (name, run) in enumerate(recordings.items()):
        style = _RunStyle(i)
        if run.termination == "diverged":
            style |= {**_EndStyle(i), "linestyle": style["linestyle"]}
            name = f"{name} (diverges at {run.time[-1]:.3g} s)"
        handles.append(Line2D([], [], label=name, **style))
    if any(row.command is not None for row in rows):
        handles.append(
            Line2D([], [], label="commanded velocity", color=_GREY, linewidth=0.8)
        )
    for event, (marker, label) in _EVENTS.items():
        if any(run.EventTimes(event) for run in recordings.values()):
            handles.append(Line2D([], [], label=label, **_EventStyle(marker, _GREY)))
    # One line if it fits, by the width of an average letter.
    widths = [0.5 + 0.058 * len(str(handle.get_label())) for handle in handles]
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=(
            len(handles) if sum(widths) <= _WIDTH else max(int(_WIDTH / max(widths)), 1)
        ),
        fontsize=_FONT_SIZE,
        frameon=False,
    )


def PlotSweep(result: SweepResult, metric: str) -> Figure:
    """Plots a metric of a sweep against the delay.

    A line for each controller; or, where more is varied, a panel for each and a line
    for each of the other values. A line is the median over the seeds, and the band
    around it reaches from the smallest to the largest. Runs that diverged or have no
    such number (a tool that never settles, for instance) are marked above the panel
    instead.

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
    scale, unit = _Unit(limits, MetricUnits(result.scenario)[metric])

    has_marks = values.shape[2] <= _MAX_NAMED_LINES
    figure, axes = grid.MakePanels()
    for index, ax in np.ndenumerate(axes):
        _Format(ax)
        marks = [
            (is_diverged, "x", "diverges"),
            (status == "failed", "^", "fails"),
        ]
        if not metric.startswith("diverged"):
            marks.append((is_missing, "o", "has none"))
        for i in range(values.shape[2]):
            style = grid.LineStyle(i)
            y = values[(*index, i)] * scale
            middle, low, high = np.full((3, len(y)), np.nan)
            has_any = np.isfinite(y).any(axis=1)
            middle[has_any] = np.nanmedian(y[has_any], axis=1)
            low[has_any] = np.nanmin(y[has_any], axis=1)
            high[has_any] = np.nanmax(y[has_any], axis=1)
            ax.plot(grid.x, middle, marker=".", markersize=3, **style)
            if y.shape[1] > 1:
                ax.fill_between(
                    grid.x, low, high, color=style["color"], alpha=0.2, linewidth=0
                )
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
        ax.set_ylabel(f"{label} [{unit}]" if unit else label, fontsize=_FONT_SIZE)
    handles = [
        Line2D([], [], label=label, **_SweepMark(marker, _GREY))
        for where, marker, label in marks
        if has_marks and where.any()
    ]
    grid.AddTitles(axes, num_marks=values.shape[2] if handles else 0)
    grid.AddLegend(figure, handles)
    return figure


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
        raise ValueError("result: no second key that is varied; allowed: two or more")
    status = grid.Arrange(result.Status())
    rank = np.select([status == "failed", status == "diverged"], [4, 3], 0)
    if isinstance(result.scenario, Scenario):
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
            _CellEdges(grid.x),
            _CellEdges(y),
            worst[index],
            cmap=ListedColormap([color for _, color in _OUTCOMES]),
            vmin=-0.5,
            vmax=len(_OUTCOMES) - 0.5,
            edgecolor="white",
            linewidth=0.3,
        )
        ax.tick_params(labelsize=_SMALL_FONT_SIZE, width=0.6, length=2.5)
        if y_labels is not None:
            ax.set_yticks(y, y_labels)
    for ax in axes[:, 0]:
        ax.set_ylabel(_AxisLabel(grid.line_key), fontsize=_FONT_SIZE)
    grid.AddTitles(axes)
    figure.legend(
        handles=[
            Patch(color=color, label=label)
            for i, (label, color) in enumerate(_OUTCOMES)
            if (worst == i).any()
        ],
        loc="outside upper center",
        ncols=len(_OUTCOMES),
        fontsize=_FONT_SIZE,
        frameon=False,
    )
    return figure


# How a run ends, from good to bad, and the colour of it.
_OUTCOMES = (
    ("completes", "#56B4E9"),
    ("settles", "#009E73"),
    ("never settles", "#E69F00"),
    ("diverges", "#D55E00"),
    ("fails", _GREY),
)

# More would be too small to read.
_MAX_PANELS = 24
_MAX_NAMED_LINES = 8

# Colours of values that have an order.
_SEQUENCE = colormaps["viridis"]

_DELAYS = ("delay", "forward_delay", "return_delay")


class _SweepGrid:
    """Who is who among the axes of a sweep.

    `Arrange` brings an array of the grid's shape into (rows, columns, lines, x,
    seeds). Columns are controllers and lines the values of `line_key`, the last key
    that is neither of these; where there is none, lines are controllers.
    """

    def __init__(self, result: SweepResult) -> None:
        axes = result.axes
        varied = [key for key, values in axes.items() if len(values) > 1]
        controller = [k for k in axes if k in ("controller", "controller.kind")][:1]
        seed = [k for k in axes if k == "seed"]
        numeric = [
            key
            for key, values in axes.items()
            if key not in seed and all(_IsNumber(value) for value in values)
        ]
        candidates = [
            *(k for k in _DELAYS if k in varied),
            *(k for k in numeric if k in varied),
            *numeric,
        ]
        x_key = next((key for key in candidates if key in numeric), None)
        if x_key is None:
            raise ValueError("result: no key with numbers; allowed: at least one")
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
                f"{_AxisLabel(key)} = {_ValueLabel(value)}"
                for key, value in zip(row_keys, row, strict=True)
            )
            for row in rows
        ]
        num_columns = max(len(self.column_values), 1)
        if len(rows) * num_columns > _MAX_PANELS:
            raise ValueError(
                f"result: needs {len(rows)} x {num_columns} panels; allowed: at most "
                f"{_MAX_PANELS}"
            )
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
            figsize=(_WIDTH, 0.8 + (2.6 if num_rows == 1 else 1.7) * num_rows),
            layout=ConstrainedLayoutEngine(w_pad=0.1),
        )
        panels = figure.subplots(
            num_rows, num_columns, sharex=True, sharey=True, squeeze=False
        )
        for ax in panels[-1]:
            ax.set_xlabel(_AxisLabel(self.x_key), fontsize=_FONT_SIZE)
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
                    fontsize=_FONT_SIZE,
                    y=1.03 + 0.035 * num_marks,
                    pad=2,
                )

    def LineStyle(self, i: int) -> dict[str, Any]:
        """Returns how line i is drawn."""
        if self.lines_are_controllers:
            return _RunStyle(i)
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
                else f"{_AxisLabel(self.line_key)} = {_ValueLabel(value)}",
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
                fontsize=_SMALL_FONT_SIZE,
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


def _AxisLabel(key: str) -> str:
    if key in _DELAYS:
        name = "delay each way" if key == "delay" else key.replace("_", " ")
        return f"{name} [s]"
    return ".".join(key.split(".")[-2:])


def _ValueLabel(value: Any) -> str:
    if _IsNumber(value):
        return f"{value:g}"
    return value.replace("_", " ") if isinstance(value, str) else str(value)


def _CellEdges(centres: np.ndarray) -> np.ndarray:
    """Returns the borders (N + 1) of cells around ascending centres (N)."""
    if len(centres) == 1:
        return centres[0] + np.array([-0.5, 0.5])
    inner = (centres[1:] + centres[:-1]) / 2
    first, last = 2 * centres[0] - inner[0], 2 * centres[-1] - inner[-1]
    return np.concatenate([[first], inner, [last]])

"""Figures of runs: pure functions of recordings.

Every function returns a matplotlib Figure that belongs to the caller: pyplot is not
involved and no global setting changes. Colours are those of Okabe and Ito, which
colour-blind people can tell apart; line styles tell the runs apart in grey print.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from teleop_drake.environments import CONTACT, PUNCTURE
from teleop_drake.figures.style import (
    BORDER_STYLE,
    COLORS,
    FONT_SIZE,
    GREY,
    LINES,
    SMALL_FONT_SIZE,
    WIDTH,
    FormatAxes,
    RunStyle,
    ScaleAndUnit,
    Widen,
)
from teleop_drake.files import Replacing
from teleop_drake.recording import Recording
from teleop_drake.tasks import Task, TaskOf
from teleop_drake.tasks.panels import (
    AxisName,
    AxisPanels,
    ShownNormal,
    SignalRow,
)

_ROW_HEIGHT = 1.2  # inches

# Points across a panel: enough that no corner shows.
_NUM_POINTS = 1500

# A run that diverges may widen the range of a panel by this share on either side.
_DIVERGED_SHARE = 1.0

# Up to this many components of a signal have a name in a legend.
_MAX_NAMED_COMPONENTS = 4

_EVENTS = {"puncture": ("^", "puncture"), "contact": ("s", "first contact")}

# Suffixes that SaveFigure knows, and the metadata that would change with each file.
_METADATA: dict[str, dict[str, None]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


@dataclass(kw_only=True)
class _Curves:
    """The components of a signal of one run, dense enough to draw.

    Attributes:
        time: (T,) in s; a time that stands twice is a jump.
        x: (T,) position in m along the direction that is shown.
        y: (T, k).
    """

    time: np.ndarray
    x: np.ndarray
    y: np.ndarray


def PlotComparison(
    recordings: Mapping[str, Recording], *, task: Task[Any] | None = None
) -> Figure:
    """Plots runs of a task together, as the thesis does (Fig. 4.1 to 5.20).

    One row each for tool velocity (with what the surgeon commands), sensed force,
    tool position and control force, per task axis: against time on the left, against
    the position on the right, that along the normal of the contact surface or, if there
    is none, along x. Filled triangles and squares mark the puncture and the first
    contact. A run that diverges ends in a cross and does not spoil the
    range for the others.

    Args:
        recordings: Runs by the name that the legend gives them, for instance
            {"direct force": ..., "adaptive": ...}; of robots with as many axes.
        task: What says which panels there are; None: the task of the first scenario.

    Raises:
        ValueError: If there is no recording, or their numbers of axes differ, or it
            is a task whose runs are not compared.
    """
    if not recordings:
        raise ValueError("recordings: empty; allowed: at least one")
    sizes = {x["tool_position"].shape[1] for x in recordings.values()}
    if len(sizes) > 1:
        raise ValueError(
            f"recordings: runs with {sorted(sizes)} task axes; allowed: one number"
        )
    runs = list(recordings.values())
    panels = (task or TaskOf(runs[0].scenario)).Panels(runs)
    if isinstance(panels, AxisPanels):
        raise ValueError(
            f"recordings: runs of {runs[0].scenario.name}; allowed: teleoperations"
        )
    return PlotRows(recordings, panels)


def PlotRun(recording: Recording, *, task: Task[Any] | None = None) -> Figure:
    """Plots one run: what PlotComparison shows and, if it adapts, Psi and weights.

    Of a tracking it plots, per task axis against time, the position
    with the desired one, the tracking error, and the disturbance with its estimate.

    Args:
        recording: The run.
        task: What says which panels there are; None: the task of its scenario.
    """
    task = task or TaskOf(recording.scenario)
    panels = task.Panels([recording])
    if isinstance(panels, AxisPanels):
        return _PlotAxes(recording, panels)
    return PlotRows(
        {recording.scenario.controller.kind.replace("_", " "): recording},
        [*panels, *_TelemetryRows(recording)],
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
    return PlotRows(
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


def _TelemetryRows(recording: Recording) -> list[SignalRow]:
    return [
        SignalRow(
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


def PlotRows(recordings: Mapping[str, Recording], rows: Sequence[SignalRow]) -> Figure:
    """Plots signals of runs together, one row of panels each.

    Args:
        recordings: Runs by the name that the legend gives them.
        rows: The signals, from top to bottom.
    """
    figure = Figure(
        figsize=(WIDTH, _ROW_HEIGHT * len(rows) + 0.7),
        # Aligned labels may end up a little further out than the layout reckons.
        layout=ConstrainedLayoutEngine(w_pad=0.1),
    )
    axes = figure.subplots(len(rows), 2, sharex="col", sharey="row", squeeze=False)
    runs = list(recordings.values())
    normal_W = ShownNormal(runs)
    curves = [_Sample(run, normal_W, "tool_position", [0]) for run in runs]
    for curve in curves:
        curve.y = curve.x[:, np.newaxis]
    x_range = _Range(runs, curves)
    x_scale, x_unit = ScaleAndUnit(x_range, "m")
    borders = _Borders(runs, normal_W, x_range)

    def IsX(row: SignalRow) -> bool:
        """Returns whether a row is the position that the right column is against."""
        is_position = row.signal == "tool_position" and len(row.components) == 1
        return is_position and bool(normal_W[row.components[0]] == 1)

    # These hold for the whole column.
    axes[0, 0].set_xlim(0.0, max(float(run.time[-1]) for run in runs) or 1.0)
    axes[0, 1].set_xlim(Widen(x_range, x_scale))

    for row, (left, right) in zip(rows, axes, strict=True):
        curves = [_Sample(run, normal_W, row.signal, row.components) for run in runs]
        commands = (
            []
            if row.command is None
            else [_Command(run, normal_W, row) for run in runs]
        )
        y_range = _Range(runs, curves, commands)
        scale, unit = ScaleAndUnit(y_range, row.unit)
        left.set_ylim(Widen(y_range, scale))
        left.set_ylabel(
            f"{row.label}\n[{unit}]" if unit else row.label, fontsize=FONT_SIZE
        )
        for ax, x_axis_scale in ((left, None), (right, x_scale)):
            FormatAxes(ax)
            _DrawPanel(ax, row, runs, normal_W, curves, commands, scale, x_axis_scale)
        for border in borders:
            right.axvline(border * x_scale, **BORDER_STYLE)
            if IsX(row):
                left.axhline(border * scale, **BORDER_STYLE)
        right.set_visible(not IsX(row))
        if 1 < len(row.components) <= _MAX_NAMED_COMPONENTS:
            _AddComponentLegend(left, row)

    left, right = axes[-1]
    left.set_xlabel("time [s]", fontsize=FONT_SIZE)
    right.set_xlabel(f"{_PositionName(normal_W)} [{x_unit}]", fontsize=FONT_SIZE)
    for border, names in borders.items():
        axes[0, 1].annotate(
            "\n".join(names),
            (border * x_scale, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=SMALL_FONT_SIZE,
        )
    figure.align_ylabels(axes[:, 0])
    _AddLegend(figure, recordings, rows)
    return figure


def _PlotAxes(recording: Recording, panels: AxisPanels) -> Figure:
    n = recording["tool_position"].shape[1]
    rows = panels.rows
    figure = Figure(
        figsize=(WIDTH, _ROW_HEIGHT * len(rows) + 0.7), layout="constrained"
    )
    axes = figure.subplots(len(rows), n, sharex=True, squeeze=False)
    for row, row_axes in zip(rows, axes, strict=True):
        for k, ax in enumerate(row_axes):
            curves = [
                _Sample(recording, np.eye(n)[0], signal, [k]) for signal in row.signals
            ]
            if row.reference:
                for curve in curves:
                    reference = recording.Interpolate(row.reference, curve.time)
                    curve.y = curve.y - reference[:, [k]]
            y_range = _Range([recording] * len(curves), curves)
            scale, shown_unit = ScaleAndUnit(y_range, row.unit)
            FormatAxes(ax)
            ax.set_ylim(Widen(y_range, scale))
            ax.set_ylabel(
                f"{row.label} ${AxisName(k)}$\n[{shown_unit}]", fontsize=FONT_SIZE
            )
            for i, curve in enumerate(curves):
                ax.plot(curve.time, curve.y * scale, **RunStyle(i))
    for ax in axes[-1]:
        ax.set_xlim(0.0, float(recording.time[-1]) or 1.0)
        ax.set_xlabel("time [s]", fontsize=FONT_SIZE)
    figure.align_ylabels(axes)
    figure.legend(
        handles=[
            Line2D([], [], label=label, **RunStyle(i))
            for i, label in enumerate(panels.names)
        ],
        loc="outside upper center",
        ncols=len(panels.names),
        fontsize=FONT_SIZE,
        frameon=False,
    )
    return figure


def _DrawPanel(
    ax: Axes,
    row: SignalRow,
    runs: Sequence[Recording],
    normal_W: np.ndarray,
    curves: Sequence[_Curves],
    commands: Sequence[_Curves],
    scale: float,
    x_scale: float | None,
) -> None:
    """Draws all runs against time or, if x_scale is not None, against position."""
    for command in commands:
        x = command.time if x_scale is None else command.x * x_scale
        ax.plot(x, command.y * scale, color=GREY, linewidth=0.8, zorder=1)
    count = len(row.components)
    for i, (run, curve) in enumerate(zip(runs, curves, strict=True)):
        x = curve.time if x_scale is None else curve.x * x_scale
        for k in range(count):
            style = RunStyle(i) if count == 1 else _ComponentStyle(k, count)
            ax.plot(x, curve.y[:, k] * scale, **style)
        if count > 1:
            continue
        _MarkEvents(ax, run, normal_W, row, i, scale, x_scale)
        if run.termination == "diverged":
            end_x = np.clip(x[-1:], *ax.get_xlim())
            end_y = np.clip(curve.y[-1] * scale, *ax.get_ylim())
            ax.plot(end_x, end_y, **_EndStyle(i), clip_on=False)


def _PositionName(normal_W: np.ndarray) -> str:
    """Returns what a position along a normal is called."""
    axis = int(np.argmax(np.abs(normal_W)))
    if abs(normal_W[axis]) != 1:
        return "position along the normal"
    sign = "-" if normal_W[axis] < 0 else ""
    return f"position ${sign}{AxisName(axis)}$"


def _Borders(
    runs: Sequence[Recording], normal_W: np.ndarray, x_range: tuple[float, float]
) -> dict[float, list[str]]:
    """Returns where tools puncture and collide within a range, and which it is."""
    borders: dict[float, list[str]] = {}
    for run in runs:
        for name in (PUNCTURE, CONTACT):
            surface = run.FindSurface(name)
            if surface is None or not np.array_equal(surface.normal_W, normal_W):
                continue
            border = float(surface.Along(surface.point_W))
            if not x_range[0] <= border <= x_range[1]:
                continue
            names = borders.setdefault(border, [])
            if name not in names:
                names.append(name)
    return borders


def _Sample(
    recording: Recording, normal_W: np.ndarray, signal: str, components: Sequence[int]
) -> _Curves:
    """Returns a signal at the samples and, where it moves fast, between them."""
    time, y = recording.time, recording[signal][:, components]
    x = recording["tool_position"] @ normal_W
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
        between_x = recording.Interpolate("tool_position", extra) @ normal_W
        x = np.concatenate([x, between_x])
        time = np.concatenate([time, extra])
        # Stable: the two sides of a jump stay in their order.
        order = np.argsort(time, kind="stable")
        time, x, y = time[order], x[order], y[order]
    return _Curves(time=time, x=x, y=y)


def _Command(recording: Recording, normal_W: np.ndarray, row: SignalRow) -> _Curves:
    """Returns the velocity which the surgeon commands, as it is sent."""
    command = recording.commands[:, row.command]
    x = recording["tool_position"] @ normal_W
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


def _ComponentStyle(k: int, count: int) -> dict[str, Any]:
    is_named = count <= _MAX_NAMED_COMPONENTS
    return {
        "color": COLORS[k % len(COLORS)],
        "linestyle": LINES[k % len(LINES)] if is_named else "-",
        "linewidth": 1.1 if is_named else 0.6,
    }


def _EndStyle(i: int) -> dict[str, Any]:
    return {
        "color": COLORS[i % len(COLORS)],
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
    ax: Axes,
    run: Recording,
    normal_W: np.ndarray,
    row: SignalRow,
    i: int,
    scale: float,
    x_scale: float | None,
) -> None:
    """Marks the puncture and the first contact on a curve of run i."""
    for name, (marker, _) in _EVENTS.items():
        time = np.array(run.EventTimes(name)[:1])
        if len(time) == 0:
            continue
        y = run.Interpolate(row.signal, time)[:, row.components[0]] * scale
        x = time
        if x_scale is not None:
            x = run.Interpolate("tool_position", time) @ normal_W * x_scale
        ax.plot(x, y, **_EventStyle(marker, RunStyle(i)["color"]))


def _AddComponentLegend(ax: Axes, row: SignalRow) -> None:
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
        fontsize=SMALL_FONT_SIZE,
        frameon=False,
    )


def _AddLegend(
    figure: Figure, recordings: Mapping[str, Recording], rows: Sequence[SignalRow]
) -> None:
    if all(len(row.components) > 1 for row in rows):
        return  # Every panel tells its own lines apart.
    handles = []
    for i, (name, run) in enumerate(recordings.items()):
        style = RunStyle(i)
        if run.termination == "diverged":
            style |= {**_EndStyle(i), "linestyle": style["linestyle"]}
            name = f"{name} (diverges at {run.time[-1]:.3g} s)"
        handles.append(Line2D([], [], label=name, **style))
    if any(row.command is not None for row in rows):
        handles.append(
            Line2D([], [], label="commanded velocity", color=GREY, linewidth=0.8)
        )
    for event, (marker, label) in _EVENTS.items():
        if any(run.EventTimes(event) for run in recordings.values()):
            handles.append(Line2D([], [], label=label, **_EventStyle(marker, GREY)))
    # One line if it fits, by the width of an average letter.
    widths = [0.5 + 0.058 * len(str(handle.get_label())) for handle in handles]
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=(
            len(handles) if sum(widths) <= WIDTH else max(int(WIDTH / max(widths)), 1)
        ),
        fontsize=FONT_SIZE,
        frameon=False,
    )

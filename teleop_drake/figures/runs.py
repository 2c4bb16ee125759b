"""Figures of runs: pure functions of recordings.

Every function returns a matplotlib Figure that belongs to the caller: pyplot is not
involved and no global setting changes. Colours are those of Okabe and Ito, which
colour-blind people can tell apart; line styles tell the runs apart in grey print.
"""

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from teleop_drake.environments import CONTACT, PUNCTURE
from teleop_drake.figures.saving import SaveFigure
from teleop_drake.figures.selection import SelectAxisRows, SelectRows, SelectTime
from teleop_drake.figures.style import (
    BOUNDARY_STYLE,
    FONT_SIZE,
    GREY,
    SMALL_FONT_SIZE,
    WIDTH,
    EndStyle,
    EventStyle,
    Figure,
    FormatAxes,
    RunStyle,
    ScaleAndUnit,
    Widen,
    WidthOf,
)
from teleop_drake.figures.telemetry import (
    AddComponentLegend,
    ComponentStyle,
    TelemetryRows,
)
from teleop_drake.recording import Recording
from teleop_drake.tasks import Task, TaskOf
from teleop_drake.tasks.panels import (
    AxisName,
    AxisPanels,
    NormalOfRuns,
    SignalRow,
)
from teleop_drake.validation import Refuse

_ROW_HEIGHT = 1.2  # inches
_LOW_ROW_HEIGHT = 0.9  # Where there are runs below others.

# More runs than these have a panel each, at most so many beside each other, the others
# below; more than those do not fit on a page.
_MAX_OVERLAID = 3
_MAX_BESIDE = 5
_MAX_MULTIPLES = 10

# Points across a panel: enough that no corner shows.
_NUM_POINTS = 1500

# A run that diverges may widen the range of a panel by this share on either side.
_DIVERGED_SHARE = 1.0

_EVENTS = {"puncture": ("^", "puncture"), "contact": ("s", "first contact")}

__all__ = ["PlotComparison", "PlotRows", "PlotRun", "PlotWeights", "SaveFigure"]


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
    recordings: Mapping[str, Recording],
    *,
    task: Task[Any] | None = None,
    signals: Sequence[str] | None = None,
    time: tuple[float, float] | None = None,
    columns: int = 2,
) -> Figure:
    """Plots runs of a task together, as the thesis does (Fig. 4.1 to 5.20).

    One row each for tool velocity (with what the operator commands), sensed force,
    tool position and control force, per task axis: against time on the left, against
    the position on the right, that along the normal of the contact surface or, if there
    is none, along x. Filled triangles and squares mark the puncture and the first
    contact. A run that diverges ends in a cross and does not spoil the
    range for the others.

    Args:
        recordings: Runs by the name that the legend gives them, for instance
            {"direct force": ..., "adaptive": ...}; of robots with as many axes.
        task: What says which panels there are; None: the task of the first scenario.
        signals: Names of the signals to show, any of the recording; None: those that
            the task shows.
        time: From when to when, s; None: all of it.
        columns: Columns of a printed page that the figure spans: 2, or 1, in which only
            the panels against time have room.

    Raises:
        ValueError: If there is no recording, or their numbers of axes differ, or it
            is a task whose runs are not compared; or what is to be shown is not there.
        UnknownSignal: If a run does not have one of the signals.
    """
    if not recordings:
        Refuse("recordings", {}, "one or more")
    sizes = {x["tool_position"].shape[1] for x in recordings.values()}
    if len(sizes) > 1:
        Refuse("recordings.num_axes", sorted(sizes), "the same for all")
    recordings = {name: SelectTime(x, time) for name, x in recordings.items()}
    runs = list(recordings.values())
    panels = (task or TaskOf(runs[0].scenario)).Panels(runs)
    if isinstance(panels, AxisPanels):
        Refuse("recordings.scenario", runs[0].scenario.name, "teleoperations")
    return PlotRows(recordings, SelectRows(panels, runs, signals), columns=columns)


def PlotRun(
    recording: Recording,
    *,
    task: Task[Any] | None = None,
    signals: Sequence[str] | None = None,
    time: tuple[float, float] | None = None,
    columns: int = 2,
) -> Figure:
    """Plots one run: what PlotComparison shows and, if it adapts, Psi and weights.

    Of a tracking it plots, per task axis against time, the position
    with the desired one, the tracking error, and the disturbance with its estimate. Of
    a Diagram of one's own it plots every signal against time.

    Args:
        task: What says which panels there are; None: the task of its scenario.
        signals: Names of the signals to show, any of the recording; None: those that
            the task shows.
        time: From when to when, s; None: all of it.
        columns: Columns of a printed page that the figure spans: 2, or 1, in which only
            the panels against time have room.

    Raises:
        UnknownSignal: If the run does not have one of the signals.
        ValueError: If what is to be shown is not there.
    """
    recording = SelectTime(recording, time)
    if recording.scenario is None and task is None:
        return _PlotSignals(recording, signals, columns)
    task = task or TaskOf(recording.scenario)
    panels = task.Panels([recording])
    if isinstance(panels, AxisPanels):
        return _PlotAxes(recording, SelectAxisRows(panels, signals), columns)
    rows = [*panels, *TelemetryRows(recording)]
    return PlotRows(
        {recording.scenario.controller.kind.replace("_", " "): recording},
        SelectRows(rows, [recording], signals),
        columns=columns,
    )


def _PlotSignals(
    recording: Recording, signals: Sequence[str] | None, columns: int
) -> Figure:
    """Plots signals against time, a panel for each with a line for each component."""
    names = list(recording) if signals is None else signals
    size = (WidthOf(columns), _ROW_HEIGHT * len(names) + 0.3)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(len(names), sharex=True, squeeze=False)[:, 0]
    for name, ax in zip(names, axes, strict=True):
        FormatAxes(ax)
        for i, y in enumerate(recording[name].T):
            ax.plot(recording.time, y, **RunStyle(i))
        ax.set_ylabel(name.replace("_", " "), fontsize=FONT_SIZE)
    axes[-1].set_xlabel("time [s]", fontsize=FONT_SIZE)
    return figure


def PlotWeights(recording: Recording) -> Figure:
    """Plots what an adaptive controller learns: Psi and the weights of its networks.

    Args:
        recording: A run with the signals `psi`, `weights_1` or `weights_3`.

    Raises:
        ValueError: If it has none of them.
    """
    rows = TelemetryRows(recording)
    if not rows:
        Refuse(
            "recording.signals",
            sorted(recording.signals),
            "those of an adaptive controller, psi, weights_1 or weights_3 among them",
        )
    return PlotRows(
        {recording.scenario.controller.kind.replace("_", " "): recording}, rows
    )


def PlotRows(
    recordings: Mapping[str, Recording], rows: Sequence[SignalRow], *, columns: int = 2
) -> Figure:
    """Plots signals of runs together, one row of panels each.

    Args:
        recordings: Runs by the name that the legend gives them.
        rows: The signals, from top to bottom.
        columns: Columns of a printed page that the figure spans, 1 or 2; in one there
            are no panels against the position.
    """
    runs = list(recordings.values())
    normal_W = NormalOfRuns(runs)
    places = _PlacesOf(len(runs), columns)
    num_banks = math.ceil(len(places) / _MAX_BESIDE)
    num_beside = math.ceil(len(places) / num_banks)
    row_height = _ROW_HEIGHT if num_banks == 1 else _LOW_ROW_HEIGHT
    figure = Figure(
        figsize=(WidthOf(columns), row_height * num_banks * len(rows) + 0.7),
        # Aligned labels may end up a little further out than the layout reckons.
        layout=ConstrainedLayoutEngine(w_pad=0.1),
    )
    grid = figure.subplots(
        num_banks * len(rows), num_beside, sharex="col", sharey="row", squeeze=False
    )
    # A row for each signal and a column for each place, wherever it is on the page.
    axes = np.hstack(np.vsplit(grid, num_banks))
    for ax in axes[:, len(places) :].flat:
        ax.set_visible(False)
    axes = axes[:, : len(places)]
    against = _AgainstPosition(runs, normal_W)
    # These hold for the whole column.
    begin = min(float(run.time[0]) for run in runs)
    end = max(float(run.time[-1]) for run in runs)
    for place, ax in zip(places, axes[0], strict=True):
        if place.is_position:
            ax.set_xlim(Widen(against.range, against.scale))
        else:
            ax.set_xlim(begin, end if end > begin else begin + 1.0)
    for row, row_axes in zip(rows, axes, strict=True):
        _DrawRow(row_axes, places, row, runs, normal_W, against)
    _LabelColumns(places, axes, f"{_PositionName(normal_W)} [{against.unit}]")
    for place, ax in zip(places, axes[0], strict=True):
        if place.is_position:
            _NameBoundaries(ax, against.boundaries, against.scale)
    if len(places) > 2:
        _TitleMultiples(axes[0], recordings)
    if num_banks > 1:
        for ax in grid[:, 0]:  # A low panel has no room for a name and its symbol.
            label = ax.get_ylabel().replace("\n", " ").replace(" $", "\n$")
            ax.set_ylabel(label, fontsize=FONT_SIZE)
    figure.align_ylabels(grid[:, 0])
    _AddLegend(figure, recordings, rows, names_runs=len(places) <= 2)
    return figure


@dataclass(frozen=True)
class _Place:
    """A column of panels: the numbers of the runs in it, and what they are against."""

    runs: Sequence[int]
    is_position: bool = False


class _AgainstPosition:
    """What the panels against the position share.

    Attributes:
        range: Of the position that the runs reach, m.
        scale, unit: What the position is shown in.
        boundaries: The names of the surfaces by where they are, m.
    """

    def __init__(self, runs: Sequence[Recording], normal_W: np.ndarray) -> None:
        curves = [_Sample(run, normal_W, "tool_position", [0]) for run in runs]
        for curve in curves:
            curve.y = curve.x[:, np.newaxis]
        self.range = _Range(runs, curves)
        self.scale, self.unit = ScaleAndUnit(self.range, "m")
        self.boundaries = _Boundaries(runs, normal_W, self.range)


def _DrawRow(
    row_axes: Sequence[Axes],
    places: Sequence[_Place],
    row: SignalRow,
    runs: Sequence[Recording],
    normal_W: np.ndarray,
    against: _AgainstPosition,
) -> None:
    """Draws a signal into its row of panels."""
    curves = [_Sample(run, normal_W, row.signal, row.components) for run in runs]
    commands = (
        [] if row.command is None else [_Command(run, normal_W, row) for run in runs]
    )
    y_range = _Range(runs, curves, commands)
    scale, unit = ScaleAndUnit(y_range, row.unit)
    label = f"{row.label}\n[{unit}]" if unit else row.label
    # The position that the right column is against has no panel there.
    is_x = row.signal == "tool_position" and len(row.components) == 1
    is_x = is_x and bool(normal_W[row.components[0]] == 1)
    for place, ax in zip(places, row_axes, strict=True):
        FormatAxes(ax)
        ax.set_ylim(Widen(y_range, scale))
        if (spec := ax.get_subplotspec()) and spec.is_first_col():
            ax.set_ylabel(label, fontsize=FONT_SIZE)
        _DrawPanel(
            ax,
            row,
            runs,
            normal_W,
            curves,
            commands,
            scale,
            against.scale if place.is_position else None,
            shown=place.runs,
        )
        for boundary in against.boundaries:
            if place.is_position:
                ax.axvline(boundary * against.scale, **BOUNDARY_STYLE)
            elif is_x:
                ax.axhline(boundary * scale, **BOUNDARY_STYLE)
        ax.set_visible(not (place.is_position and is_x))
    if len(row.components) > 1:
        AddComponentLegend(row_axes[0], row)


def _LabelColumns(
    places: Sequence[_Place], axes: np.ndarray, position_label: str
) -> None:
    """Writes below the lowest visible panel of each column what it is against."""
    for place, column in zip(places, axes.T, strict=True):
        for ax in [ax for ax in column if ax.get_visible()][-1:]:
            ax.tick_params(labelbottom=True)
            ax.set_xlabel(
                position_label if place.is_position else "time [s]", fontsize=FONT_SIZE
            )


def _PlacesOf(num_runs: int, columns: int) -> list[_Place]:
    """Returns the columns of panels of a figure.

    Three runs can be told apart in one panel. More have a column each, on a page as
    long as they fit there.
    """
    everyone = range(num_runs)
    if _MAX_OVERLAID < num_runs <= _MAX_MULTIPLES and columns == 2:
        return [_Place([i]) for i in everyone]
    against_time = _Place(everyone)
    return [against_time] if columns == 1 else [against_time, _Place(everyone, True)]


def _NameBoundaries(
    ax: Axes, boundaries: Mapping[float, list[str]], scale: float
) -> None:
    """Writes the names of surfaces above a panel against the position."""
    for boundary, names in boundaries.items():
        ax.annotate(
            "\n".join(names),
            (boundary * scale, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=SMALL_FONT_SIZE,
        )


def _TitleMultiples(
    row_axes: Sequence[Axes], recordings: Mapping[str, Recording]
) -> None:
    """Writes above each column of panels which run it has, and how that ends."""
    for i, (ax, (name, run)) in enumerate(
        zip(row_axes, recordings.items(), strict=True)
    ):
        title = "\n".join(textwrap.wrap(name, 14, break_long_words=False))
        if run.termination == "diverged":
            title += f"\ndiverges at {run.time[-1]:.3g} s"
        ax.set_title(title, fontsize=SMALL_FONT_SIZE, color=RunStyle(i)["color"])
        ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))


def _PlotAxes(recording: Recording, panels: AxisPanels, columns: int) -> Figure:
    n = recording["tool_position"].shape[1]
    rows = panels.rows
    width = WidthOf(columns)
    figure = Figure(
        figsize=(width, _ROW_HEIGHT * len(rows) + 0.7), layout="constrained"
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
        begin, end = map(float, recording.time[[0, -1]])
        ax.set_xlim(begin, end if end > begin else begin + 1.0)
        ax.set_xlabel("time [s]", fontsize=FONT_SIZE)
    figure.align_ylabels(axes)
    figure.legend(
        handles=[
            Line2D([], [], label=label, **RunStyle(i))
            for i, label in enumerate(panels.names)
        ],
        loc="outside upper center",
        ncols=len(panels.names) if columns == 2 else 1,
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
    shown: Sequence[int],
) -> None:
    """Draws runs against time or, if x_scale is not None, against position."""
    for command in (commands[i] for i in (shown if commands else ())):
        x = command.time if x_scale is None else command.x * x_scale
        ax.plot(x, command.y * scale, color=GREY, linewidth=0.8, zorder=1)
    count = len(row.components)
    for i in shown:
        run, curve = runs[i], curves[i]
        x = curve.time if x_scale is None else curve.x * x_scale
        for k in range(count):
            style = RunStyle(i) if count == 1 else ComponentStyle(row, k)
            if len(shown) < len(runs):
                style["linestyle"] = "-"  # There is nothing to tell it from.
            ax.plot(x, curve.y[:, k] * scale, **style)
        if count > 1:
            continue
        _MarkEvents(ax, run, normal_W, row, i, scale, x_scale)
        if run.termination == "diverged":
            end_x = np.clip(x[-1:], *ax.get_xlim())
            end_y = np.clip(curve.y[-1] * scale, *ax.get_ylim())
            ax.plot(end_x, end_y, **EndStyle(i), clip_on=False)


def _PositionName(normal_W: np.ndarray) -> str:
    """Returns what a position along a normal is called."""
    axis = int(np.argmax(np.abs(normal_W)))
    if abs(normal_W[axis]) != 1:
        return "position along the normal"
    sign = "-" if normal_W[axis] < 0 else ""
    return f"position ${sign}{AxisName(axis)}$"


def _Boundaries(
    runs: Sequence[Recording], normal_W: np.ndarray, x_range: tuple[float, float]
) -> dict[float, list[str]]:
    """Returns where tools puncture and collide within a range, and which it is."""
    boundaries: dict[float, list[str]] = {}
    for run in runs:
        for name in (PUNCTURE, CONTACT):
            surface = run.FindSurface(name)
            if surface is None or not np.array_equal(surface.normal_W, normal_W):
                continue
            boundary = float(surface.Along(surface.point_W))
            if not x_range[0] <= boundary <= x_range[1]:
                continue
            names = boundaries.setdefault(boundary, [])
            if name not in names:
                names.append(name)
    return boundaries


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
    """Returns the velocity which the operator commands, as it is sent."""
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
        ax.plot(x, y, **EventStyle(marker, RunStyle(i)["color"]))


def _AddLegend(
    figure: Figure,
    recordings: Mapping[str, Recording],
    rows: Sequence[SignalRow],
    *,
    names_runs: bool,
) -> None:
    if all(len(row.components) > 1 for row in rows):
        return  # Every panel tells its own lines apart.
    handles = []
    for i, (name, run) in enumerate(recordings.items()):
        style = RunStyle(i)
        if run.termination == "diverged":
            style |= {**EndStyle(i), "linestyle": style["linestyle"]}
            name = f"{name} (diverges at {run.time[-1]:.3g} s)"
        if names_runs:
            handles.append(Line2D([], [], label=name, **style))
    if any(row.command is not None for row in rows):
        handles.append(
            Line2D([], [], label="commanded velocity", color=GREY, linewidth=0.8)
        )
    for event, (marker, label) in _EVENTS.items():
        if any(run.EventTimes(event) for run in recordings.values()):
            handles.append(Line2D([], [], label=label, **EventStyle(marker, GREY)))
    if not handles:
        return
    # One line if it fits, by the width of an average letter.
    width = figure.get_figwidth()
    margin = 0.5 if width >= WIDTH else 0.75
    widths = [margin + 0.058 * len(str(handle.get_label())) for handle in handles]
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=(
            len(handles) if sum(widths) <= width else max(int(width / max(widths)), 1)
        ),
        fontsize=FONT_SIZE,
        frameon=False,
    )

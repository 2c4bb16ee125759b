"""Figures of runs: pure functions of recordings.

Every function returns a matplotlib Figure that belongs to the caller: pyplot is not
involved and no global setting changes. Colours are those of Okabe and Ito, which
colour-blind people can tell apart; line styles tell the runs apart in grey print.
"""

import itertools
import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from teleop_drake.loops.framework.arrays import Array, Interval
from teleop_drake.loops.framework.validation import CheckKind, Refuse
from teleop_drake.loops.run.recording import CheckRecording, Recording
from teleop_drake.model.blocks.environments import CONTACT, PUNCTURE
from teleop_drake.model.signals import ScaleAndUnit
from teleop_drake.model.task_recording import CheckTaskRecording, TaskRecording
from teleop_drake.model.tasks import Task, TaskOf
from teleop_drake.model.tasks.panels import AxisName, NormalOfRuns, SignalRow
from teleop_drake.study.figures import style
from teleop_drake.study.figures.curves import Curve, RangeOf, SampleCurve, TimeLimits
from teleop_drake.study.figures.labels import ShortLabels
from teleop_drake.study.figures.layout import MakePanels
from teleop_drake.study.figures.saving import SaveFigure
from teleop_drake.study.figures.selection import CheckRecordings, SelectRows, SelectTime
from teleop_drake.study.figures.style import (
    GREY,
    SMALL_FONT_SIZE,
    Figure,
    Key,
    RunStyle,
)

_ROW_HEIGHT = 1.2  # inches
_LOW_ROW_HEIGHT = 0.9  # inches; where there are several banks

# Up to _MAX_OVERLAID runs share a panel, and so do more than _MAX_MULTIPLES, which do
# not fit on a page otherwise. Runs in between have a column of panels each, at most
# _MAX_BESIDE of them in one bank; further banks stand below.
_MAX_OVERLAID = 3
_MAX_BESIDE = 5
_MAX_MULTIPLES = 10

_EVENTS = {PUNCTURE: ("^", "puncture"), CONTACT: ("s", "first contact")}
_COMMAND_STYLE: style.Look = {"color": GREY, "linewidth": 0.8}

__all__ = ["PlotComparison", "PlotRows", "PlotRun", "SaveFigure"]


def PlotComparison(
    recordings: Mapping[str, TaskRecording],
    *,
    task: Task[Any] | None = None,
    signals: Sequence[str] | None = None,
    time: Interval | None = None,
    columns: int = 2,
) -> Figure:
    """Plots runs of a task together, as the thesis does (Fig. 4.1 to 5.20).

    Each task axis has rows for tool velocity (with the operator's command), sensed
    force, tool position and control force. The left panels are against time, the right
    ones against the position along the normal of the contact surface or, without such a
    surface, along x. Filled triangles and squares mark the puncture and the first
    contact. A run that diverges ends in a cross and is shown only in part, so that the
    range suits the others.

    Args:
        recordings: Runs by the name that the legend gives them, for instance
            {"direct force": ..., "adaptive": ...}; of robots with as many axes.
        task: The task that defines the panels; by default that of the first scenario.
        signals: Names of recorded signals to show; by default those of the task.
        time: The window of time to show, s; by default the whole run.
        columns: Columns of a printed page that the figure spans: 2, or 1, in which only
            the panels against time have room.

    Raises:
        ValueError: If there is no recording, the numbers of axes differ, the runs of
            the task are not comparable, or `signals`, `time` or `columns` is invalid.
        UnknownSignal: If a run does not have one of the signals.
    """
    allowed = 'a dictionary of Recordings by name, as {"direct_force": recording}'
    CheckKind("recordings", recordings, Mapping, allowed)
    checked = {x: CheckTaskRecording("recordings", y) for x, y in recordings.items()}
    CheckRecordings(checked)
    checked = {name: SelectTime(x, time) for name, x in checked.items()}
    runs = list(checked.values())
    task = task or TaskOf(runs[0].scenario)
    if not task.is_compared:
        Refuse("recordings.scenario", runs[0].scenario.name, "teleoperations")
    rows = SelectRows(task.Panels(runs), runs, signals)
    return PlotRows(checked, rows, columns=columns)


def PlotRun(
    recording: Recording,
    *,
    task: Task[Any] | None = None,
    signals: Sequence[str] | None = None,
    time: Interval | None = None,
    columns: int = 2,
) -> Figure:
    """Plots one run: the panels of PlotComparison, and Psi and weights if it adapts.

    For a tracking task, it plots per task axis against time the position with the
    desired one, the tracking error, and the disturbance with its estimate. For a user's
    own Diagram, it plots every signal against time. Arguments and errors are those of
    PlotComparison.
    """
    CheckRecording("recording", recording)
    recording = SelectTime(recording, time)
    width = style.WidthOf(columns)
    if task is None and not isinstance(recording, TaskRecording):
        names = list(recording) if signals is None else signals
        rows = SelectRows([], [recording], names)
        return PlotRows({"": recording}, rows, columns=1, width=width)
    run = CheckTaskRecording("recording", recording)
    task = task or TaskOf(run.scenario)
    rows = task.Panels([run])
    if task.is_compared:
        rows = [*rows, *_TelemetryRows(recording)]
    else:
        columns = 1
    rows = SelectRows(rows, [recording], signals)
    name = run.scenario.controller.kind.replace("_", " ")
    return PlotRows({name: recording}, rows, columns=columns, width=width)


def PlotRows(
    recordings: Mapping[str, Recording],
    rows: Sequence[SignalRow],
    *,
    columns: int = 2,
    width: float | None = None,
    row_height: float = _ROW_HEIGHT,
) -> Figure:
    """Plots signals of runs together, one row of panels each.

    Args:
        recordings: Runs by the name that the legend gives them.
        rows: The signals, from top to bottom.
        columns: Columns of a printed page that the figure spans, 1 or 2; in one there
            are no panels against the position.
        width: Width of the figure in inches; by default that of the columns.
        row_height: Height of a row of panels in inches. Several banks have lower rows.
    """
    shown = _Runs(recordings)
    places = shown.Places(columns)
    num_banks = math.ceil(len(places) / _MAX_BESIDE)
    num_rows = num_banks * len(rows)
    num_columns = math.ceil(len(places) / num_banks)
    height = row_height if num_banks == 1 else _LOW_ROW_HEIGHT
    figure, grid = MakePanels(
        num_rows,
        num_columns,
        height=height * num_rows + 0.7,
        width=width or style.WidthOf(columns),
        # The layout underestimates how far out aligned labels stand.
        padding=0.1,
    )
    # A row for each signal and a column for each place, whatever its bank.
    axes = np.hstack(np.vsplit(grid, num_banks))
    axes, unused = np.split(axes, [len(places)], axis=1)
    for ax in unused.flat:
        ax.set_visible(False)
    for row, row_axes in zip(rows, axes, strict=True):
        label = shown.DrawRow(row_axes, places, row)
        if num_banks > 1:  # Beside a low panel, the unit follows the symbol.
            label = label.replace("\n", " ").replace(" $", "\n$")
        for ax in row_axes[::num_columns]:
            ax.set_ylabel(label)
    # The lowest visible panel of a column names the horizontal axis.
    for place, column in zip(places, axes.T, strict=True):
        for ax in [ax for ax in column if ax.get_visible()][-1:]:
            ax.tick_params(labelbottom=True)
            ax.set_xlabel(place.label)
        for x, name in place.boundaries.items():
            style.NameAbove(column[0], x, name)
    if len(places) > 2:
        _TitleMultiples(axes[0], recordings)
    figure.align_ylabels()
    if any(len(row.components) == 1 for row in rows):
        keys = _MarkKeys(recordings, rows)
        if len(places) <= 2 and "" not in recordings:
            keys = _RunKeys(recordings) + keys
        style.AddLegend(figure, keys)
    return figure


class _Place(NamedTuple):
    """A column of panels with one horizontal axis: time, or the position.

    Attributes:
        runs: The indices of the runs in it.
        label, limits: Label and limits of the axis, in the unit shown.
        scale: The factor from a position in m to the unit shown; 0 for time.
        boundaries: The names of the surfaces by their positions, in the unit shown.
    """

    runs: Sequence[int]
    label: str
    limits: Interval
    scale: float = 0.0
    boundaries: Mapping[float, str] = {}


class _Runs:
    """The runs of a figure, and the direction along which positions are shown."""

    def __init__(self, recordings: Mapping[str, Recording]) -> None:
        self._runs = list(recordings.values())
        of_tasks = [run for run in self._runs if isinstance(run, TaskRecording)]
        has_tool = bool(of_tasks) and "tool_position" in self._runs[0]
        self._normal_W = NormalOfRuns(of_tasks) if has_tool else np.zeros(0)
        self._boundaries: dict[float, list[str]] = {}
        for run, name in itertools.product(of_tasks, _EVENTS):
            surface = run.FindSurface(name)
            if surface is not None and (surface.normal_W == self._normal_W).all():
                x = surface.Along(surface.point_W)
                names = self._boundaries.setdefault(x, [])
                names += [name] if name not in names else []

    def Places(self, columns: int) -> list[_Place]:
        """Returns the columns of panels of a figure.

        Three runs can be told apart in one panel. More have a column each, as long as
        these fit on a page.
        """
        everyone = range(len(self._runs))
        against_time = _Place(everyone, "time [s]", TimeLimits(self._runs))
        if _MAX_OVERLAID < len(everyone) <= _MAX_MULTIPLES and columns == 2:
            return [against_time._replace(runs=[i]) for i in everyone]
        if columns == 1:
            return [against_time]
        curves = [SampleCurve(run, "tool_position", [0]) for run in self._runs]
        low, high = RangeOf(
            [x._replace(y=self._Along(i, x.time)) for i, x in enumerate(curves)]
        )
        scale, unit = ScaleAndUnit((low, high), "m")
        against_position = _Place(
            everyone,
            f"{_PositionName(self._normal_W)} [{unit}]",
            style.Widen((low, high), scale),
            scale,
            {
                x * scale: "\n".join(names) if low <= x <= high else ""
                for x, names in self._boundaries.items()
            },
        )
        return [against_time, against_position]

    def _Along(self, i: int, times: Array) -> Array:
        """Returns the position of run i along the normal at some times, m."""
        position = self._runs[i].Interpolate("tool_position", times)
        return np.asarray(position @ self._normal_W)

    def _X(self, place: _Place, i: int, times: Array) -> Array:
        """Returns the places of some times of run i on the horizontal axis."""
        return self._Along(i, times) * place.scale if place.scale else times

    def _Curves(self, row: SignalRow) -> list[Curve]:
        """Returns the curve of the signal of a row for each run."""
        curves = []
        for run in self._runs:
            curve = SampleCurve(run, row.signal, row.components)
            if row.reference:
                reference = run.Interpolate(row.reference, curve.time)
                curve = curve._replace(y=curve.y - reference[:, row.components])
            curves.append(curve)
        return curves

    def DrawRow(
        self, row_axes: Sequence[Axes], places: Sequence[_Place], row: SignalRow
    ) -> str:
        """Draws a signal into its row of panels, and returns its name and unit."""
        curves = self._Curves(row)
        commands = self._Commands(row)
        y_range = RangeOf(curves, commands)
        scale, unit = ScaleAndUnit(y_range, row.unit)
        # The position along the normal is not drawn against itself.
        normal = self._normal_W
        is_x = row.signal == "tool_position" and list(normal[row.components]) == [1]
        for place, ax in zip(places, row_axes, strict=True):
            style.FormatAxes(ax)
            ax.set(xlim=place.limits, ylim=style.Widen(y_range, scale))
            for i in place.runs if commands else ():
                x = self._X(place, i, commands[i].time)
                ax.plot(x, commands[i].y * scale, **_COMMAND_STYLE, zorder=1)
            for i in place.runs:
                self._DrawRun(ax, place, row, i, curves[i], scale)
            for boundary in place.boundaries:
                ax.axvline(boundary, **style.BOUNDARY_STYLE)
            for y in self._boundaries if is_x else ():
                ax.axhline(y * scale, **style.BOUNDARY_STYLE)
            ax.set_visible(not (place.scale and is_x))
        if len(row.components) > 1:
            row_axes[0].legend(ncols=2, fontsize=SMALL_FONT_SIZE, frameon=False)
        return f"{row.label}\n[{unit}]" if unit else row.label

    def _Commands(self, row: SignalRow) -> list[Curve]:
        """Returns for each run the curve beside the signal, if the row has one."""
        if row.beside:
            return self._Curves(replace(row, signal=row.beside))
        if row.command is None:
            return []
        return [
            Curve(x.time, x.commands[:, [row.command]])
            for x in self._runs
            if isinstance(x, TaskRecording)
        ]

    def _DrawRun(
        self,
        ax: Axes,
        place: _Place,
        row: SignalRow,
        i: int,
        curve: Curve,
        scale: float,
    ) -> None:
        """Draws run i and marks its first puncture, first contact and divergence."""
        run = self._runs[i]
        x = self._X(place, i, curve.time)
        y = curve.y * scale
        if len(row.components) > 1:
            _DrawGroups(ax, x, y, row.groups)
            return
        look = RunStyle(i)
        if len(place.runs) < len(self._runs):
            look["linestyle"] = "-"  # It is alone in its panel.
        ax.plot(x, y, **look)
        for event, (marker, _) in _EVENTS.items():
            first = np.array(run.EventTimes(event)[:1])
            if first.size:
                y_first = run.Interpolate(row.signal, first)
                if row.reference:
                    y_first = y_first - run.Interpolate(row.reference, first)
                look = style.EventStyle(marker, style.RunColor(i))
                x_first = self._X(place, i, first)
                ax.plot(x_first, y_first[:, row.components] * scale, **look)
        if curve.diverges:
            end_x = np.clip(x[-1:], *ax.get_xlim())
            end_y = np.clip(y[-1], *ax.get_ylim())
            ax.plot(end_x, end_y, **style.EndStyle(i), clip_on=False)


def _PositionName(normal_W: Array) -> str:
    """Returns the name of a position along a normal."""
    axis = int(np.argmax(np.abs(normal_W)))
    if abs(normal_W[axis]) != 1:
        return "position along the normal"
    sign = "-" if normal_W[axis] < 0 else ""
    return f"position ${sign}{AxisName(axis)}$"


def _TelemetryRows(recording: Recording) -> list[SignalRow]:
    """Returns the rows for the estimates of an adaptive controller, if it has any.

    The weights of a network are a matrix with a row for each task axis.
    """
    n = recording["tool_position"].shape[1]
    axes = [f"axis ${AxisName(k)}$" for k in range(n)]
    # Matrices are recorded row by row.
    entries = [rf"$\Psi_{{{k // n + 1}{k % n + 1}}}$" for k in range(n * n)]
    return [
        SignalRow(
            label=label,
            unit=unit,
            signal=signal,
            components=range(recording[signal].shape[1]),
            groups=groups,
        )
        for signal, label, unit, groups in (
            ("psi", r"$\Psi$", "1/kg", entries if n <= 2 else axes),
            ("weights_1", "weights $W_1$", "m/s²", axes),
            ("weights_3", "weights $W_3$", "N/s", axes),
        )
        if signal in recording
    ]


def _DrawGroups(ax: Axes, x: Array, y: Array, groups: Sequence[str]) -> None:
    """Draws the components of a signal (T, k), each group of them in one colour."""
    for i, components in enumerate(np.split(y, len(groups), axis=1)):
        each = components.shape[1]
        look = RunStyle(i)
        label = groups[i]
        if each > 1:
            look = {"color": style.RunColor(i), "linewidth": 0.6}
            label = f"{each} of {label}" if len(groups) > 1 else f"all {each}"
        line, *_ = ax.plot(x, components, **look)
        line.set_label(label)


def _Divergence(run: Recording) -> str:
    """Returns the time at which a run diverges, in words; "" if it does not."""
    if run.termination != "diverged":
        return ""
    return f"diverges at {run.time[-1]:.3g} s"


def _TitleMultiples(
    row_axes: Sequence[Axes], recordings: Mapping[str, Recording]
) -> None:
    """Writes above each column of panels the name of its run and its divergence."""
    for i, (name, run) in enumerate(recordings.items()):
        ax = row_axes[i]
        title = textwrap.fill(name, 14, break_long_words=False)
        title = f"{title}\n{_Divergence(run)}".rstrip()
        ax.set_title(title, fontsize=SMALL_FONT_SIZE, color=style.RunColor(i))
        ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))


def _RunKeys(recordings: Mapping[str, Recording]) -> list[Line2D]:
    """Returns the legend entries of runs, with the times at which they diverge."""
    keys = []
    names = ShortLabels(list(recordings))
    for i, (name, run) in enumerate(zip(names, recordings.values(), strict=True)):
        end = _Divergence(run)
        cross = style.EndStyle(i) if end else {}
        look = {**cross, **RunStyle(i)}
        keys.append(Key(f"{name} ({end})" if end else name, **look))
    return keys


def _MarkKeys(
    recordings: Mapping[str, Recording], rows: Sequence[SignalRow]
) -> list[Line2D]:
    """Returns the legend entries of commands and of marked events."""
    keys = []
    if any(row.command is not None for row in rows):
        keys.append(Key("commanded velocity", **_COMMAND_STYLE))
    beside = dict.fromkeys(row.beside.replace("_", " ") for row in rows if row.beside)
    if beside:
        keys.append(Key(", ".join(beside), **_COMMAND_STYLE))
    for event, (marker, label) in _EVENTS.items():
        if any(run.EventTimes(event) for run in recordings.values()):
            keys.append(Key(label, **style.EventStyle(marker, GREY)))
    return keys

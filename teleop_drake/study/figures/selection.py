"""Selection of signals and of a window of time for a figure."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from teleop_drake.loops.framework.arrays import Interval
from teleop_drake.loops.framework.validation import CheckNames, Refuse, Show
from teleop_drake.loops.run.recording import Recording
from teleop_drake.model.signals import AxesOf, AxisUnit, PartUnit, UnitOf
from teleop_drake.model.tasks.panels import SignalRow

_R = TypeVar("_R", bound=Recording)

# The largest number of components of a signal that are named one by one or, where runs
# are compared, have a row each.
_MAX_ROWS = 4


def CheckRecordings(recordings: Mapping[str, Recording]) -> None:
    """Checks that runs can be drawn in one picture.

    Raises:
        ValueError: If there is no run, or the numbers of axes differ.
    """
    if not recordings:
        Refuse("recordings", {}, "one or more")
    sizes = {x["tool_position"].shape[1] for x in recordings.values()}
    if len(sizes) > 1:
        Refuse("recordings.num_axes", sorted(sizes), "the same for all")


def SelectRows(
    rows: Sequence[SignalRow],
    recordings: Sequence[Recording],
    signals: Sequence[str] | None,
) -> list[SignalRow]:
    """Returns the rows of a figure that show the given signals, in their order.

    Args:
        rows: The rows of the task.
        signals: Names of signals; None selects all rows. A signal without a row of the
            task gets rows of its own.

    Raises:
        UnknownSignal: If a run lacks one of the signals.
        ValueError: If `signals` is empty, or a signal does not fit into rows.
    """
    CheckNames("signals", signals)
    if signals is None:
        return list(rows)
    if not signals:
        Refuse("signals", [], "the name of one signal or more")
    selected: list[SignalRow] = []
    for signal in signals:
        own = [row for row in rows if row.signal == signal]
        selected += own or _RowsOf(signal, recordings)
    return selected


def _RowsOf(signal: str, recordings: Sequence[Recording]) -> list[SignalRow]:
    """Returns rows for a signal that the task does not show."""
    sizes = {recording[signal].shape[1] for recording in recordings}
    if len(sizes) > 1:
        Refuse("signals", signal, f"of one size in all runs, not of {sorted(sizes)}")
    (size,) = sizes
    unit = UnitOf(signal)
    name = signal.replace("_", " ")
    own = recordings[0].components.get(signal)
    if len(recordings) == 1 and size > 1 and unit is None:
        # Components without axes share a row.
        named = own or [f"$c_{{{k + 1}}}$" for k in range(size)]
        return [
            SignalRow(
                label=name,
                unit="",
                signal=signal,
                components=range(size),
                groups=named if size <= _MAX_ROWS else [name],
            )
        ]
    parts = recordings[0].Components(signal, size)
    axes = AxesOf(size) if unit is not None else tuple(map(str, range(1, size + 1)))
    if own is not None:
        shown = [(f"{name}\n{part}", "") for part in own]
    elif isinstance(parts[0], str):  # A packet.
        end = signal.rpartition("_")[2]
        shown = [(f"{part}\n{end}", PartUnit(part)) for part in parts]
    elif size > _MAX_ROWS:
        Refuse("signals", signal, f"of {_MAX_ROWS} components at most to compare runs")
    else:
        shown = [
            (f"{name} ${axis}$" if size > 1 else name, AxisUnit(unit or "", axis))
            for axis in axes
        ]
    return [
        SignalRow(label=label, unit=own_unit, signal=signal, components=[k])
        for k, (label, own_unit) in enumerate(shown)
    ]


def SelectTime(recording: _R, window: Interval | None) -> _R:
    """Returns the part of a run within a window of time.

    Returns:
        The samples in the window and interpolated ones at its ends. The part counts as
        completed if the run continues after it.

    Raises:
        ValueError: If the window does not run from a time >= 0 to a later one, or the
            run ends before it.
    """
    if window is None:
        return recording
    begin, end = window
    if not 0 <= begin < end:
        Refuse("time", list(window), "from a time >= 0 to a later one (s)")
    last = float(recording.time[-1])
    if begin >= last:
        Refuse("time", list(window), f"before {Show(last)} s, when the run has ended")
    return replace(
        recording.Part(begin, end),
        events=[event for event in recording.events if begin <= event.time <= end],
        termination=recording.termination if end >= last else "completed",
    )

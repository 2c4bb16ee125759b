"""Metrics as tables of text."""

import itertools
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from teleop_drake.recording import Recording
    from teleop_drake.sweep import SweepResult


def Words(name: str) -> str:
    """Returns the name of a metric in words."""
    return name.replace("_", " ").replace(".", " ")


def Ending(recording: "Recording") -> str:
    """Returns how a run ended, in a word or two."""
    if recording.termination == "completed":
        return "completed"
    return f"{recording.termination} at {recording.time[-1]:.4g} s"


def Headline(recording: "Recording") -> str:
    """Returns what was simulated, for how long and how it ended, on one line."""
    from teleop_drake.tasks import TaskOf

    scenario = recording.scenario
    line = f"{scenario.name}, {scenario.controller.kind}: "
    channels = TaskOf(scenario).Channels(scenario)
    if channels:
        line += (
            f"delay {_Delay(channels['forward_channel'])} forward, "
            f"{_Delay(channels['return_channel'])} back, "
        )
    line += f"{recording.time[-1]:g} s simulated, {recording.termination}"
    if recording.reason:
        line += f" ({recording.reason})"
    if channels and recording.termination == "diverged":
        line += "\n`teleop-drake analyze` with the same options finds the delay margins"
    return line


def _Delay(channel: Any) -> str:
    """Returns the delay of a channel in s, and the file that adds to it."""
    trace = getattr(channel, "trace", None)
    if not trace:
        return f"{channel.delay:g} s"
    from teleop_drake.blocks.channels.trace import ReadTrace

    is_halved = ReadTrace("trace", trace).is_halved
    halved = " (half of ping's round trips)" if is_halved else ""
    return f"{channel.delay:g} s and {trace}{halved}"


# More runs than these have a row each: a column each would be too wide to read.
MAX_COLUMNS = 3

_SOLVER = ("engine", "steps", "derivative_evaluations", "wall_time_s")


def Table(
    recordings: Mapping[str, "Recording"],
    records: Sequence[Any],
    *,
    is_verbose: bool = False,
) -> str:
    """Returns the metrics of some runs.

    Up to three runs have a column each. More have a row each, with the most used
    metrics.

    Args:
        is_verbose: Whether to show all metrics and what the solver did, a column for
            each run.
    """
    from teleop_drake.figures.style import ShortLabels
    from teleop_drake.sweep import SelectMetrics
    from teleop_drake.tasks.metrics import FlattenMetrics, MetricUnits

    runs = list(recordings.values())
    units = {"wall_time_s": "s"}
    for recording in runs:
        units |= MetricUnits(recording.scenario)
    columns = []
    for record in records:
        channels = FlattenMetrics(record.get("channels", {}))
        column = FlattenMetrics(record["metrics"]) | channels
        if is_verbose:
            column |= {key: record["solver"][key] for key in _SOLVER}
        columns.append(column)
    if len(runs) > MAX_COLUMNS and not is_verbose:
        shown = SelectMetrics(runs[0].scenario)
        labels = [[label] for label in recordings]
        ends = [Ending(recording) for recording in runs]
        return MetricRows([""], labels, columns, {x: units[x] for x in shown}, ends)
    # A group such as `puncture` is null where there was none.
    rows = list(dict.fromkeys(itertools.chain(*columns)))
    groups = {row.split(".")[0] for row in rows if "." in row}
    lines = [["", *ShortLabels(list(recordings)), ""]]
    for row in rows:
        if row in groups:
            continue
        cells = [Cell(column.get(row)) for column in columns]
        lines.append([Words(row), *cells, units.get(row, "")])
    return Align(lines)


def SeedsTable(result: "SweepResult", metrics: Sequence[str] = ()) -> str:
    """Returns statistics over the seeds: a row for each metric.

    There is a column for each controller, and one for each difference to the first of
    them. A cell has a median, or a share of the runs, and its interval.

    Args:
        result: A sweep that varies the seed, and beside it at most the controller.
        metrics: The metrics; none: those that most people look at.
    """
    from teleop_drake.sweep import Differences, SelectMetrics, Statistics
    from teleop_drake.sweep.statistics import CONTROLLERS

    shown = list(metrics) or SelectMetrics(result.scenario)
    key = next((k for k in CONTROLLERS if k in result.axes), "")
    columns: dict[str, dict[str, str]] = {}
    units = {}
    for row in [*Statistics(result), *Differences(result)]:
        is_share = row["statistic"] == "share"
        if not is_share and row["metric"] not in shown:
            continue
        name = str(row.get(key, ""))
        if "baseline" in row:
            name += f" - {row['baseline']}"
        columns.setdefault(name, {})[row["metric"]] = _CellWithInterval(row)
        units[row["metric"]] = "of the runs" if is_share else row["unit"]
    lines = [["", *columns, ""]]
    for metric, unit in units.items():
        cells = [column.get(metric, "") for column in columns.values()]
        lines.append([Words(metric), *cells, unit])
    num_seeds = len(result.axes["seed"])
    title = f"Medians over {num_seeds} seeds, and shares of the runs; 95 % intervals"
    return f"{title}\n{Align(lines)}"


def _CellWithInterval(row: Mapping[str, Any]) -> str:
    if row["low"] is None:
        return Cell(row["value"])
    return f"{row['value']:.4g} [{row['low']:.3g}, {row['high']:.3g}]"


# More rows of a sweep do not fit on a screen.
_MAX_ROWS = 40


def SweepTable(result: "SweepResult", metrics: Sequence[str] = ()) -> str:
    """Returns the metrics of the runs of a sweep, a row for each.

    Args:
        metrics: The metrics; none: the most used ones that the runs have.
    """
    from teleop_drake.figures.style import ValueLabel
    from teleop_drake.tasks.metrics import MetricUnits

    units = MetricUnits(result.scenario)
    shown = {metric: units[metric] for metric in metrics or result.Metrics()}
    rows = result.Table()
    first = rows[:_MAX_ROWS]
    keys = [key for key, values in result.axes.items() if len(values) > 1]
    labels = [[ValueLabel(row[key]) for key in keys] for row in first]
    ends = [row["status"] for row in first]
    text = MetricRows(keys, labels, first, shown, ends)
    if len(rows) > _MAX_ROWS:
        text += f"\n... {len(rows) - _MAX_ROWS} more are in runs.csv"
    return text


# Letters of a line in the head of a column.
_HEAD_WIDTH = 12


def MetricRows(
    heads: Sequence[str],
    labels: Sequence[Sequence[str]],
    values: Sequence[Mapping[str, Any]],
    units: Mapping[str, str],
    ends: Sequence[str],
) -> str:
    """Returns a table with a row for each run, and how it ended.

    Args:
        heads: Names of the columns that tell which run it is.
        labels: What stands there, for each run.
        values: The metrics of each run by their names.
        units: Units of the metrics that are shown, by their names.
        ends: How each run ended.
    """
    stacks = [[head] for head in heads]
    for metric, unit in units.items():
        words = textwrap.wrap(Words(metric), _HEAD_WIDTH)
        stacks.append([*words, unit and f"[{unit}]"])
    # The heads end on the same line.
    upwards = itertools.zip_longest(*map(reversed, stacks), fillvalue="")
    lines = [[*row, ""] for row in upwards][::-1]
    for label, metrics, end in zip(labels, values, ends, strict=True):
        cells = [Cell(metrics.get(metric), digits=4) for metric in units]
        lines.append([*label, *cells, end])
    return Align(lines)


def Align(lines: Sequence[Sequence[str]]) -> str:
    """Returns columns: the first and the last to the left, the others to the right."""
    first, *others, last = zip(*lines, strict=True)
    columns = [_Fit(first, str.ljust), *(_Fit(x, str.rjust) for x in others), last]
    rows = zip(*columns, strict=True)
    return "\n".join("  ".join(row).rstrip() for row in rows)


def _Fit(cells: Sequence[str], justify: Callable[[str, int], str]) -> list[str]:
    """Returns the cells of a column, all as wide as the widest."""
    width = max(map(len, cells))
    return [justify(cell, width) for cell in cells]


def Cell(value: Any, digits: int = 5) -> str:
    """Returns a value as the cell of a table."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value) if isinstance(value, int | str) else f"{value:.{digits}g}"

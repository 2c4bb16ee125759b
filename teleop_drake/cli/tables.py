"""Metrics as tables of text."""

import itertools
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from teleop_drake.model.task_recording import TaskRecording
    from teleop_drake.study.sweep import TaskSweepResult


def Words(name: str) -> str:
    """Returns the name of a metric in words."""
    return name.replace("_", " ").replace(".", " ")


def Ending(recording: "TaskRecording") -> str:
    """Returns how a run ended, in a word or two."""
    if recording.termination == "completed":
        return "completed"
    return f"{recording.termination} at {recording.time[-1]:.4g} s"


def Headline(recording: "TaskRecording") -> str:
    """Returns a line with the scenario, the delays, the simulated time and the ending.

    A second line tells what the run did. After a divergence a third line names the
    command that explains it.
    """
    from teleop_drake.model.tasks import TaskOf
    from teleop_drake.model.tasks.metrics import RunSentence

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
    line += f"\n{RunSentence(recording)}"
    if channels and recording.termination == "diverged":
        line += "\n`teleop-drake analyze` with the same options finds the delay margins"
    return line


def _Delay(channel: Any) -> str:
    """Returns the delay of a channel in s, and the trace that adds to it, as text."""
    trace = getattr(channel, "trace", None)
    if not trace:
        return f"{channel.delay:g} s"
    from teleop_drake.model.kinds import FileOf
    from teleop_drake.model.tables.measured import HALVED
    from teleop_drake.model.tables.packets import ReadMeasured

    is_halved = ReadMeasured("trace", trace).kind == HALVED
    halved = " (half of its round trips)" if is_halved else ""
    return f"{channel.delay:g} s and {FileOf(trace)}{halved}"


# The largest number of runs with a column each. More runs have a row each, because so
# many columns would be too wide to read.
MAX_COLUMNS = 3

_SOLVER = ("engine", "steps", "derivative_evaluations", "wall_time_s")


def Table(
    recordings: Mapping[str, "TaskRecording"],
    records: Sequence[Any],
    *,
    is_verbose: bool = False,
) -> str:
    """Returns the metrics of several runs as a table.

    Up to three runs have a column each. More have a row each, with the most used
    metrics.

    Args:
        recordings: The runs, keyed by label.
        records: The runs' RunSummary(), in the same order.
        is_verbose: Whether to show all metrics and the solver's statistics, with a
            column for each run.
    """
    from teleop_drake.model.tasks.metrics import FlattenMetrics, MetricUnits
    from teleop_drake.study.figures.labels import ShortLabels
    from teleop_drake.study.sweep import SelectMetrics

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
    # A group of metrics such as `puncture` is null in a run without that event. It has
    # no row, because its metrics have rows.
    rows = list(dict.fromkeys(itertools.chain(*columns)))
    groups = {row.split(".")[0] for row in rows if "." in row}
    lines = [["", *ShortLabels(list(recordings)), ""]]
    for row in rows:
        if row in groups:
            continue
        unknown = Missing(row)
        cells = [Cell(column.get(row), unknown=unknown) for column in columns]
        lines.append([Words(row), *cells, units.get(row, "")])
    return Align(lines)


def SeedsTable(result: "TaskSweepResult", metrics: Sequence[str] = ()) -> str:
    """Returns statistics over the seeds as a table with a row for each metric.

    Each controller has a column, and each difference from the first controller has one.
    A cell shows a median, or a share of the runs, and its interval.

    Args:
        result: A sweep that varies the seed, and beside it at most the controller.
        metrics: Names of metrics; by default, the most used ones.
    """
    from teleop_drake.study.sweep import Differences, SelectMetrics, Statistics
    from teleop_drake.study.sweep.statistics import CONTROLLERS

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
        return Cell(row["value"], unknown=Missing(row["metric"]))
    return f"{row['value']:.4g} [{row['low']:.3g}, {row['high']:.3g}]"


# The largest number of rows of a sweep; more do not fit on a screen.
_MAX_ROWS = 40


def SweepTable(result: "TaskSweepResult", metrics: Sequence[str] = ()) -> str:
    """Returns the metrics of a sweep as a table with a row for each run.

    Args:
        metrics: Names of metrics; by default, the most used ones that the runs have.
    """
    from teleop_drake.study.figures.labels import ValueLabel

    units = result.units
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


# The width of a column's head, in characters, at which its words are wrapped.
_HEAD_WIDTH = 12


def MetricRows(
    heads: Sequence[str],
    labels: Sequence[Sequence[str]],
    values: Sequence[Mapping[str, Any]],
    units: Mapping[str, str],
    ends: Sequence[str],
) -> str:
    """Returns a table with a row for each run: its labels, metrics and ending.

    Args:
        heads: The heads of the columns that identify a run.
        labels: The cells of these columns, for each run.
        values: The metrics of each run, keyed by name.
        units: The units of the metrics to show, keyed by name.
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
        cells = [
            Cell(metrics.get(metric), digits=4, unknown=Missing(metric))
            for metric in units
        ]
        lines.append([*label, *cells, end])
    return Align(lines)


def Align(lines: Sequence[Sequence[str]]) -> str:
    """Returns lines of cells as a table.

    The first and the last column are aligned to the left, the others to the right.
    """
    first, *widths, _ = [max(map(len, cells)) for cells in zip(*lines, strict=True)]
    rows = []
    for label, *cells, end in lines:
        middle = map(str.rjust, cells, widths)
        rows.append("  ".join([label.ljust(first), *middle, end]).rstrip())
    return "\n".join(rows)


def Missing(metric: str) -> str:
    """Returns the cell of a metric that a run does not have."""
    from teleop_drake.model.tasks.metrics import MissingInWords

    return MissingInWords(metric)


def Cell(value: Any, digits: int = 5, *, unknown: str = "-") -> str:
    """Returns a value as the cell of a table; `unknown` stands for None."""
    if value is None:
        return unknown
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value) if isinstance(value, int | str) else f"{value:.{digits}g}"

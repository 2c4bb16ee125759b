"""Metrics as tables of text."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from teleop_drake.recording import Recording
    from teleop_drake.sweep import SweepResult


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
    return f"{channel.delay:g} s" + (f" and {trace}" if trace else "")


def Table(recordings: Mapping[str, "Recording"], records: Sequence[Any]) -> str:
    """Returns the metrics of some runs: a row for each, a column for each run."""
    from teleop_drake.tasks.metrics import FlattenMetrics, MetricUnits

    units = {"wall_time_s": "s"}
    for recording in recordings.values():
        units |= MetricUnits(recording.scenario)
    columns = {
        name: FlattenMetrics(record["metrics"])
        | FlattenMetrics(record.get("channels", {}))
        | {
            key: record["solver"][key]
            for key in ("engine", "steps", "derivative_evaluations", "wall_time_s")
        }
        for name, record in zip(recordings, records, strict=True)
    }
    # A group such as `puncture` is null where there was none.
    rows: dict[str, None] = {}
    for column in columns.values():
        rows |= dict.fromkeys(column)
    groups = {row.split(".")[0] for row in rows if "." in row}
    lines = [["", *columns, ""]]
    for row in rows:
        if row in groups:
            continue
        cells = [Cell(column.get(row)) for column in columns.values()]
        label = row.replace("_", " ").replace(".", " ")
        lines.append([label, *cells, units.get(row, "")])
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
    for row in Statistics(result):
        if row["statistic"] == "share" or row["metric"] in shown:
            is_share = row["statistic"] == "share"
            units[row["metric"]] = "of the runs" if is_share else row["unit"]
            column = columns.setdefault(str(row.get(key, "")), {})
            column[row["metric"]] = _CellWithInterval(row)
    for row in Differences(result):
        if row["metric"] in shown:
            name = f"{row[key]} - {row['baseline']}"
            columns.setdefault(name, {})[row["metric"]] = _CellWithInterval(row)
    lines = [["", *columns, ""]]
    for metric, unit in units.items():
        cells = [column.get(metric, "") for column in columns.values()]
        lines.append([metric.replace("_", " ").replace(".", " "), *cells, unit])
    num_seeds = len(result.axes["seed"])
    title = f"Medians over {num_seeds} seeds, and shares of the runs; 95 % intervals"
    return f"{title}\n{Align(lines)}"


def _CellWithInterval(row: Mapping[str, Any]) -> str:
    if row["low"] is None:
        return Cell(row["value"])
    return f"{row['value']:.4g} [{row['low']:.3g}, {row['high']:.3g}]"


def Align(lines: Sequence[Sequence[str]]) -> str:
    """Returns columns: the first and the last to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(
            [
                line[0].ljust(widths[0]),
                *(c.rjust(w) for c, w in zip(line[1:-1], widths[1:-1], strict=True)),
                line[-1],
            ]
        ).rstrip()
        for line in lines
    )


def Cell(value: Any) -> str:
    """Returns a value as the cell of a table."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value) if isinstance(value, int | str) else f"{value:.5g}"

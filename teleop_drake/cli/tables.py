"""Metrics as tables of text."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from teleop_drake.recording import Recording


# Unit of each metric of RunSummary, by the last part of its name.
_UNITS = {
    "start_velocity_overshoot": "m/s",
    "time": "s",
    "velocity": "m/s",
    "force": "N",
    "velocity_overshoot": "m/s",
    "initial_impact_force": "N",
    "peak_force": "N",
    "rebound_velocity": "m/s",
    "settling_time": "s",
    "velocity_rms_error": "m/s",
    "force_rms_error": "N",
    "control_force_peak": "N",
    "control_force_variation": "N",
    "diverged_at": "s",
    "max_error": "m",
    "rms_error": "m",
    "disturbance_rms_error": "N",
    "wall_time_s": "s",
}


def Headline(recording: "Recording") -> str:
    """Returns what was simulated, for how long and how it ended, on one line."""
    from teleop_drake.scenario import Scenario

    scenario = recording.scenario
    line = f"{scenario.name}, {scenario.controller.kind}: "
    if isinstance(scenario, Scenario):
        line += (
            f"delay {scenario.forward_channel.delay:g} s forward, "
            f"{scenario.return_channel.delay:g} s back, "
        )
    line += f"{recording.time[-1]:g} s simulated, {recording.termination}"
    return f"{line} ({recording.reason})" if recording.reason else line


def Table(records: Mapping[str, Mapping[str, Any]]) -> str:
    """Returns the metrics of some runs: a row for each, a column for each run."""
    from teleop_drake.sweep import CHANNEL_METRICS, FlattenMetrics

    units = _UNITS | CHANNEL_METRICS
    columns = {
        name: FlattenMetrics(record["metrics"])
        | FlattenMetrics(record.get("channels", {}))
        | {
            key: record["solver"][key]
            for key in ("steps", "derivative_evaluations", "wall_time_s")
        }
        for name, record in records.items()
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
        unit = next((units[part] for part in row.split(".") if part in units), "")
        lines.append([row.replace("_", " ").replace(".", " "), *cells, unit])
    return Align(lines)


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
    return str(value) if isinstance(value, int) else f"{value:.5g}"

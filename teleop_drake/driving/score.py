"""The score of a drive: overshoot, impact, time."""

from collections.abc import Sequence
from typing import Any

from teleop_drake.driving.drive import Segment
from teleop_drake.tasks.metrics import RunMetrics

UNITS = {
    "overshoot": "m/s",
    "puncture_overshoot": "m/s",
    "impact": "N",
    "time": "s",
    "driven": "s",
    "rate": "",
}
"""What Score() counts, and its units."""


def Score(segment: Segment) -> dict[str, float | None]:
    """Returns what counts of a segment; less is better.

    * overshoot (m/s): by how much the tool was at most faster than the command that
      arrived, before the first surface.
    * puncture_overshoot (m/s): the same after the puncture; None without one.
    * impact (N): greatest force of the first contact; None without one.
    * time (s): until the contact, or without one until the puncture; None without both.
    * driven (s): how long the segment was.
    * rate: simulated s in a second.
    """
    metrics: dict[str, Any] = RunMetrics(segment.recording)
    puncture, collision = metrics["puncture"] or {}, metrics["collision"] or {}
    return {
        "overshoot": metrics["start_velocity_overshoot"],
        "puncture_overshoot": puncture.get("velocity_overshoot"),
        "impact": collision.get("initial_impact_force"),
        "time": collision.get("time", puncture.get("time")),
        "driven": float(segment.recording.time[-1]),
        "rate": segment.rate,
    }


def Scores(segments: Sequence[Segment]) -> list[list[str]]:
    """Returns the scores as the cells of a table: a row for each segment."""
    rows = [["", *(f"{key.replace('_', ' ')}" for key in UNITS), "settings"]]
    rows.append(["", *UNITS.values(), ""])
    for i, segment in enumerate(segments, start=1):
        values = Score(segment).values()
        cells = ["-" if value is None else f"{value:.4g}" for value in values]
        rows.append([str(i), *cells, str(segment.settings)])
    return rows

"""The metrics and the summary of a run, computed from its recording."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from teleop_drake.loops.delays.packet_statistics import PacketStatistics
from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.numerics.step_polynomials import finite_part
from teleop_drake.model.scenario import AnyScenario
from teleop_drake.model.signals import AxesOf, AxisUnit
from teleop_drake.model.task_recording import CheckTaskRecording, TaskRecording
from teleop_drake.model.tasks import Task, TaskOf

CHANNEL_METRICS = {
    item.name: "s" if item.name.startswith(("delay_", "age_")) else ""
    for item in dataclasses.fields(PacketStatistics)
}
"""Metrics of the packets of a network channel; see PacketStatistics. In a table each
name begins with the name of the channel, as in `forward_channel.age_mean`."""


def RunMetrics(recording: TaskRecording, *, task: Task[Any] | None = None) -> Record:
    """Returns the metrics of a run, which its task defines.

    Insertion.Metrics() describes the metrics of a teleoperation, Tracking.Metrics() the
    metrics of the tracking of chapter 3.

    Args:
        recording: A run. Samples after its last finite sample are ignored.
        task: The task that defines the metrics; by default the task of the scenario.

    Returns:
        The `metrics` object of `teleop-drake run --json`: finite numbers, lists of
        them with one entry per task axis, bool and None.

    Raises:
        ValueError: If the recording has no finite sample.
    """
    CheckTaskRecording("recording", recording)
    task = task or TaskOf(recording.scenario)
    return task.Metrics(_FinitePart(recording))


def RunSentence(recording: TaskRecording, *, task: Task[Any] | None = None) -> str:
    """Returns what a run did, in one sentence, such as "Waves hit the bone ..."

    Args:
        recording: A run. Samples after its last finite sample are ignored.
        task: The task that words it; by default the task of the scenario.

    Raises:
        ValueError: If the recording has no finite sample.
    """
    task = task or TaskOf(recording.scenario)
    finite = _FinitePart(recording)
    return task.Outcome(finite, task.Metrics(finite))


def RunSummary(recording: TaskRecording, *, task: Task[Any] | None = None) -> Record:
    """Returns the object that `teleop-drake run --json` prints.

    Args:
        recording: A run. Samples after its last finite sample are ignored.
        task: The task that defines the metrics; by default the task of the scenario.

    Returns:
        A dict of finite numbers, None, bool, str, and lists and dicts of these:

        * scenario: its name.
        * controller: its kind.
        * The particulars of the task: forward_delay and return_delay in s; for a
          tracking diverged, and diverged_at in s or None.
        * duration: the duration in the scenario, s.
        * metrics: the result of RunMetrics().
        * final: position in m, velocity in m/s and environment_force in N of the last
          sample, n each.
        * notes: what was left out and why, a sentence each; only if there are any.
        * channels: the PacketStatistics of each network channel by its name; only if
          there are network channels.
        * solver: the SolverStatistics.

    Raises:
        ValueError: If the recording has no finite sample.
    """
    CheckTaskRecording("recording", recording)
    task = task or TaskOf(recording.scenario)
    recording = _FinitePart(recording)
    scenario = recording.scenario
    statistics: Record = {}
    if recording.notes:
        statistics["notes"] = recording.notes
    if recording.channels:
        statistics["channels"] = {
            name: dataclasses.asdict(channel)
            for name, channel in recording.channels.items()
        }
    return {
        "scenario": scenario.name,
        "controller": scenario.controller.kind,
        **task.Particulars(recording),
        "duration": float(scenario.duration),
        "metrics": task.Metrics(recording),
        "final": {
            "position": recording["tool_position"][-1].tolist(),
            "velocity": recording["tool_velocity"][-1].tolist(),
            "environment_force": recording["environment_force"][-1].tolist(),
        },
        **statistics,
        "solver": dataclasses.asdict(recording.solver),
    }


def MetricUnits(scenario: AnyScenario) -> dict[str, str]:
    """Returns the units of all scalar metrics of a scenario, by their names.

    The metrics of its network channels are included.
    """
    task = TaskOf(scenario)
    units = dict(task.units) | {
        f"{name}.{key}": unit
        for name, channel in task.Channels(scenario).items()
        if channel.has_packet_statistics
        for key, unit in CHANNEL_METRICS.items()
    }
    return {
        name.replace("*", axis): AxisUnit(unit, axis)
        for name, unit in units.items()
        for axis in (AxesOf(scenario.num_axes) if name.endswith("*") else " ")
    }


def FlattenMetrics(metrics: Mapping[str, Any], prefix: str = "") -> Record:
    """Returns metrics keyed by dotted names, `puncture.time` or `rms_error.x`."""
    flat: Record = {}
    for key, value in metrics.items():
        if isinstance(value, Mapping):
            flat |= FlattenMetrics(value, f"{prefix}{key}.")
        elif isinstance(value, list):
            axes = AxesOf(len(value))
            flat |= {f"{prefix}{key}.{a}": x for a, x in zip(axes, value, strict=True)}
        else:
            flat[prefix + key] = value
    return flat


def MissingInWords(name: str) -> str:
    """Returns the text for a metric that a run does not have: some times never come."""
    is_time = name.endswith("time") or name == "diverged_at"
    return "never" if is_time else "-"


def _FinitePart(recording: TaskRecording) -> TaskRecording:
    """Returns the part of a recording before its first row that is not finite."""
    series = recording.time, recording.signals, recording.steps
    time, signals, steps = finite_part(series)
    if len(time) == 0:
        Refuse("recording.time", [], "a list of one finite sample or more")
    if time is recording.time:
        return recording
    return dataclasses.replace(recording, time=time, signals=signals, steps=steps)

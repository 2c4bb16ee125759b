"""Insertion: a teleoperated tool is pushed into the layers of an environment."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydrake.systems.framework import Diagram

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.run.recording import Event
from teleop_drake.model.blocks.environments import CONTACT, PUNCTURE
from teleop_drake.model.scenario import CONTROLLERS, Scenario
from teleop_drake.model.signals import AxisUnit
from teleop_drake.model.stations import MakeArchitecture
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks.base import Divergence, SpeedLimit, Task
from teleop_drake.model.tasks.insertion_metrics import (
    AXIS_METRICS,
    COLLISION_METRICS,
    PUNCTURE_METRICS,
    UNITS,
    FindCrossings,
    InsertionRun,
    StartVelocityOvershoot,
)
from teleop_drake.model.tasks.panels import AxisName, NormalOfRuns, SignalRow
from teleop_drake.model.tasks.sentences import InsertionInWords, Sentence
from teleop_drake.model.teleoperator import MakeTeleoperator

# Names of the events of crossing a surface, inwards and outwards.
_CROSSINGS = {PUNCTURE: ("puncture", "heal"), CONTACT: ("contact", "release")}


class Insertion(Task[Scenario]):
    """The task of moving the tool through a boundary, or against a hard surface.

    Puncture and contact are the tool's crossings of the environment's surfaces
    `puncture` and `contact`.
    """

    controllers = tuple(CONTROLLERS)
    systems = ("robot", "environment")
    units = UNITS
    page_metrics: ClassVar[str] = "insertion"

    def Check(self, scenario: Scenario) -> None:
        """Checks a scenario, and makes its architecture to check derived values.

        Raises:
            ScenarioError: If the scenario is not valid.
            ValueError: If a derived value is not allowed.
        """
        super().Check(scenario)
        MakeArchitecture(scenario)

    def MakeDiagram(self, scenario: Scenario) -> Diagram:
        """Makes the teleoperator.

        Raises:
            ScenarioError: If the scenario is not valid.
        """
        return MakeTeleoperator(scenario)

    def MakeSpeedLimit(self, scenario: Scenario) -> SpeedLimit:
        """Returns the limit of the tool's speed, a multiple of the commanded speed."""
        ratio = scenario.divergence_speed_ratio
        return SpeedLimit(
            speed=ratio * float(np.linalg.norm(scenario.surgeon.velocity)),
            name=f"{ratio:g} times the commanded speed",
        )

    def FindEvents(self, recording: TaskRecording) -> list[Event]:
        """Returns the tool's crossings of surfaces and the operator's changes of mode.

        Args:
            recording: A run whose events are not found yet.
        """
        events = _OperatorEvents(recording)
        found = FindCrossings(recording)
        for surface, crossings in zip(recording.surfaces, found, strict=True):
            # Of several surfaces with the same name, only the first one has events.
            if surface is not recording.FindSurface(surface.name):
                continue
            names = _CROSSINGS.get(surface.name, ())
            for name, times in zip(names, crossings, strict=False):
                events += [Event(name=name, time=time) for time in times]
        return sorted(events, key=lambda event: event.time)

    def Metrics(self, recording: TaskRecording) -> Record:
        """Returns the metrics of an insertion, which insertion_metrics defines.

        * start_velocity_overshoot.
        * puncture: PUNCTURE_METRICS; None if the tool never crosses that surface.
        * collision: COLLISION_METRICS; None if the tool never reaches that surface.
        * AXIS_METRICS, each per task axis.
        * diverged: whether the run ended early because the tool's speed exceeded its
          limit or the solver failed.
        * diverged_at: the time in s at which the run diverged, or None.

        Args:
            recording: A run, all of its numbers finite.

        Returns:
            The `metrics` object of `teleop-drake run --json`: finite numbers, lists of
            them with one entry per task axis, bool and None.
        """
        run = InsertionRun(recording)
        puncture = collision = None
        if run.puncture.time is not None:
            puncture = {name: f(run) for name, (f, _) in PUNCTURE_METRICS.items()}
        if run.contact.time is not None:
            collision = {name: f(run) for name, (f, _) in COLLISION_METRICS.items()}
        per_axis = {name: f(run) for name, (f, _) in AXIS_METRICS.items()}
        return {
            "start_velocity_overshoot": StartVelocityOvershoot(run),
            "puncture": puncture,
            "collision": collision,
            **{name: None if x is None else x.tolist() for name, x in per_axis.items()},
            **Divergence(recording),
        }

    def Outcome(self, recording: TaskRecording, metrics: Record) -> str:
        """Returns what a run did: whether it hit the hard surface and came to rest."""
        return Sentence(recording, InsertionInWords(recording, metrics))

    def Particulars(self, recording: TaskRecording) -> Record:
        """Returns forward_delay and return_delay in s."""
        scenario = recording.teleoperation
        return {
            "forward_delay": float(scenario.forward_channel.delay),
            "return_delay": float(scenario.return_channel.delay),
        }

    def Panels(self, recordings: Sequence[TaskRecording]) -> list[SignalRow]:
        """Returns velocity, sensed force, position and control force, per task axis.

        An axis without a force of the environment has no row for the sensed force.

        Args:
            recordings: One run or more, of robots with the same number of axes.
        """
        n = recordings[0]["tool_position"].shape[1]
        normal_W = NormalOfRuns(recordings)
        return [
            SignalRow(
                label=label % f"{{{AxisName(k)}}}" if k > 2 else label % AxisName(k),
                unit=AxisUnit(unit, AxisName(k)),
                signal=signal,
                components=[k],
                command=n + k if signal == "tool_velocity" else None,
            )
            for signal, label, unit in (
                ("tool_velocity", "velocity $v_%s$", "m/s"),
                ("environment_force", "sensed force $F_{e,%s}$", "N"),
                ("tool_position", "position $%s$", "m"),
                ("control_force", "control force $F_{c,%s}$", "N"),
            )
            for k in range(n)
            if signal != "environment_force"
            or normal_W[k]
            or any(recording[signal][:, k].any() for recording in recordings)
        ]


def _OperatorEvents(recording: TaskRecording) -> list[Event]:
    """Returns the events at which the operator starts to hold a force, or stops."""
    if "surgeon_mode" not in recording:
        return []
    # The mode is interpolated, and not a whole number, where a step was cut.
    mode = np.round(recording["surgeon_mode"][:, 0])
    events = []
    for row in 1 + np.flatnonzero(np.diff(mode)):
        name = "surgeon_force" if mode[row] == 1.0 else "surgeon_stop"
        events.append(Event(name=name, time=float(recording.time[row])))
    return events

"""Insertion: a teleoperated tool is pushed into what the environment is made of."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram

from teleop_drake.environments import CONTACT, PUNCTURE
from teleop_drake.recording import Event, Recording
from teleop_drake.scenario import CONTROLLERS, Scenario
from teleop_drake.stations import MakeArchitecture
from teleop_drake.tasks.base import SpeedLimit, Task
from teleop_drake.tasks.insertion_metrics import UNITS, InsertionMetrics
from teleop_drake.tasks.panels import AxisName, NormalOfRuns, SignalRow
from teleop_drake.tasks.pieces import Split
from teleop_drake.teleoperator import MakeTeleoperator

# What it is called to cross a surface into it and out of it.
_CROSSINGS = {PUNCTURE: ("puncture", "heal"), CONTACT: ("contact", "release")}


class Insertion(Task[Scenario]):
    """The operator moves the tool through a boundary, or against a hard surface.

    Puncture and contact are where the environment's surfaces of these names are.
    """

    controllers = tuple(CONTROLLERS)
    systems = ("robot", "environment")
    units = UNITS

    def Check(self, scenario: Scenario) -> None:
        """Checks a scenario, and the architecture that derives from it.

        Raises:
            ScenarioError: If it is not valid.
            ValueError: If what derives from it is not allowed.
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
        """Returns the multiple of the commanded speed that ends a run as diverged."""
        ratio = scenario.divergence_speed_ratio
        return SpeedLimit(
            speed=ratio * float(np.linalg.norm(scenario.surgeon.velocity)),
            name=f"{ratio:g} times the commanded speed",
        )

    def FindEvents(self, recording: Recording) -> list[Event]:
        """Returns when the tool crosses a surface and when the operator switches.

        Args:
            recording: A run, its events not found yet.
        """
        times, pieces = recording.time, Split(recording)
        p = pieces.Sample(recording["tool_position"])
        surfaces = {name: recording.FindSurface(name) for name in _CROSSINGS}
        depths = {name: x.Depth(p) for name, x in surfaces.items() if x is not None}
        names = [_CROSSINGS[name] for name in depths]
        events = [
            Event(name=names[i][0 if is_inwards else 1], time=time)
            for time, i, is_inwards in pieces.Crossings(*depths.values())
        ]
        mode = recording["surgeon_mode"][:, 0]
        for i in np.flatnonzero(np.diff(mode)):
            name = "surgeon_force" if mode[i + 1] == 1 else "surgeon_stop"
            events.append(Event(name=name, time=float(times[i + 1])))
        return sorted(events, key=lambda event: event.time)

    def Metrics(self, recording: Recording) -> dict[str, Any]:
        """Returns overshoots, the puncture, the collision and the errors of a run.

        Args:
            recording: A run, all of its numbers finite.

        Returns:
            What InsertionMetrics() describes.
        """
        return InsertionMetrics(recording)

    def Particulars(self, recording: Recording) -> dict[str, Any]:
        """Returns forward_delay and return_delay in s."""
        scenario = recording.teleoperation
        return {
            "forward_delay": float(scenario.forward_channel.delay),
            "return_delay": float(scenario.return_channel.delay),
        }

    def Panels(self, recordings: Sequence[Recording]) -> list[SignalRow]:
        """Returns velocity, sensed force, position and control force, per task axis.

        Axes along which no environment pushes have no row for the sensed force.

        Args:
            recordings: Runs of robots with as many axes, at least one.
        """
        n = recordings[0]["tool_position"].shape[1]
        normal_W = NormalOfRuns(recordings)
        return [
            SignalRow(
                label=label % AxisName(k),
                unit=unit,
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

"""Insertion: a teleoperated tool is pushed into what the environment is made of.

Its metrics are overshoots, the puncture, the collision and the errors. Instants are
located, not sampled; see teleop_drake.integrator.measuring.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram

from teleop_drake.environments import CONTACT, PUNCTURE, FindSurface, Surface
from teleop_drake.integrator.measuring import (
    BEFORE,
    DISTANCE,
    MAXIMUM,
    MINIMUM,
    RMS,
    SETTLING,
    TIME,
    VARIATION,
)
from teleop_drake.recording import Event, Recording
from teleop_drake.scenario import CONTROLLERS, Scenario
from teleop_drake.signals import AxisUnit
from teleop_drake.stations import MakeArchitecture
from teleop_drake.tasks.base import SpeedLimit, Task
from teleop_drake.tasks.measures import Measures, Places, PlacesOf
from teleop_drake.tasks.panels import AxisName, NormalOfRuns, SignalRow
from teleop_drake.teleoperator import MakeTeleoperator

# A command that is slower than this share of |v_d| points nowhere: it may be zero but
# for rounding.
AT_REST = 1e-6

SETTLING_RATIO = 0.05
"""Share of |v_d| under which the tool counts as settled; of the force too at rest."""

UNITS = {
    "start_velocity_overshoot": "m/s",
    "puncture.time": "s",
    "puncture.velocity": "m/s",
    "puncture.force": "N",
    "puncture.velocity_overshoot": "m/s",
    "collision.time": "s",
    "collision.velocity": "m/s",
    "collision.initial_impact_force": "N",
    "collision.peak_force": "N",
    "collision.rebound_velocity": "m/s",
    "collision.settling_time": "s",
    "collision.rest_time": "s",
    "velocity_rms_error.*": "m/s",
    "force_rms_error.*": "N",
    "coordination_rms_error.*": "m",
    "control_force_peak.*": "N",
    "control_force_variation.*": "N",
    "diverged": "",
    "diverged_at": "s",
}
"""Scalar metrics of an insertion and their units; * stands for each task axis."""

_WATCHED = "tool_position", "tool_velocity", "environment_force", "control_force"

# What it is called to cross a surface into it and out of it.
CROSSINGS = {PUNCTURE: ("puncture", "heal"), CONTACT: ("contact", "release")}


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

    def Measures(
        self,
        scenario: Scenario,
        places: Places,
        surfaces: tuple[Surface, ...],
        *,
        is_constant: bool,
    ) -> Measures:
        """Returns what Metrics() describes.

        Args:
            is_constant: Whether the operator commands surgeon.velocity all the time.
        """
        v_d = np.asarray(scenario.surgeon.velocity, float)
        n, speed = v_d.size, float(np.linalg.norm(v_d))
        result = Measures(mode=places.get("surgeon_mode", (-1,))[0])
        result.Watch(*(places[name] for name in _WATCHED))
        is_felt = "felt_velocity" in places or "return_packet_received" in places
        if "felt_velocity" in places or not is_felt:
            result.Watch(places["felt_velocity" if is_felt else "tool_velocity"])
        else:
            result.Watch((places["return_packet_received"][0] + n, n, "m/s"))
        if "velocity_command" in places:
            sent = places["force_command"], places["velocity_command"]
            result.Watch(*sent, late=True)
        else:
            result.Watch(places["forward_packet_received"])
        p, v, F, F_c, felt, F_hd, v_dd = result.Vectors(n)
        one = result.One()
        for surface in surfaces:
            depth = surface.normal_W @ p
            # A layer may begin at infinity, along axes on which its normal has a part.
            is_along = surface.normal_W != 0
            begin = surface.point_W[is_along] @ surface.normal_W[is_along]
            depth -= np.where(one, begin, 0.0)
            is_first = FindSurface(surfaces, surface.name) is surface
            names = CROSSINGS.get(surface.name, ()) if is_first else ()
            result.AddEvent(depth, *names)
        normal = FirstNormal(surfaces, v_d)
        along = v_d @ normal * one if is_constant else normal @ v_dd
        result.AddEvent(along + AT_REST * speed * one)
        excess = normal @ v - along + result.One(1)
        until = PUNCTURE, CONTACT
        start = [excess, 0 * one]
        result.Add(self, "start_velocity_overshoot", MAXIMUM, start, "", until)
        if (found := FindSurface(surfaces, PUNCTURE)) is not None:
            for name, operation, form, *ends in (
                ("time", TIME, 0 * one),
                ("velocity", BEFORE, found.normal_W @ v),
                ("force", BEFORE, found.normal_W @ F),
                ("velocity_overshoot", MAXIMUM, excess, CONTACT),
            ):
                result.Add(self, f"puncture.{name}", operation, [form], PUNCTURE, ends)
        if (found := FindSurface(surfaces, CONTACT)) is not None:
            v_x, F_x = found.normal_W @ v, found.normal_W @ F
            slow = SETTLING_RATIO * speed * result.One(2)
            near, alone = SETTLING_RATIO * result.One(3), result.One(4)
            # Translation and rotation, each by itself.
            apart = np.outer(np.arange(n) % 3 == 0, alone)
            for name, operation, forms, *ends in (
                ("time", TIME, []),
                ("velocity", BEFORE, [v_x]),
                ("initial_impact_force", MAXIMUM, [F_x], "release"),
                ("peak_force", MAXIMUM, [F_x]),
                ("rebound_velocity", MINIMUM, [v_x]),
                ("settling_time", SETTLING, [v_x + slow + alone]),
                ("rest_time", SETTLING, [*(v + slow + apart), *(F + near + apart)]),
            ):
                result.Add(self, f"collision.{name}", operation, forms, CONTACT, ends)
        result.AddPerAxis(self, "velocity_rms_error", RMS, v - v_dd)
        result.AddPerAxis(self, "force_rms_error", RMS, F - F_hd)
        if is_felt:
            name = "coordination_rms_error"
            result.AddPerAxis(self, name, DISTANCE, felt[:3], p[:3])
        result.AddPerAxis(self, "control_force_peak", MAXIMUM, F_c, -F_c)
        result.AddPerAxis(self, "control_force_variation", VARIATION, F_c)
        return result

    def FindEvents(self, recording: Recording) -> list[Event]:
        """Returns when the tool crosses a surface and when the operator switches.

        Args:
            recording: A run, its events not found yet.
        """
        return self._Of(recording)[0]

    def _Of(self, recording: Recording) -> tuple[list[Event], dict[str, Any]]:
        scenario = recording.teleoperation
        measures = self.Measures(
            scenario,
            PlacesOf(recording),
            recording.surfaces,
            is_constant=recording.has_constant_command,
        )
        return measures.Of(recording, scenario.forward_channel.delay)

    def Metrics(self, recording: Recording) -> dict[str, Any]:
        """Returns the metrics of an insertion.

        With v_d = surgeon.velocity, and all times simulation time. An operator of
        another kind than constant_velocity does not command that all the time: there
        overshoots compare with the command as it arrives at the slave at each instant,
        v_dd below. The surfaces are those that the environment told; x is the direction
        of the normal into the surface in question. An overshoot is one in the direction
        of the command: s = -1 if v_d_x < 0 by more than 1e-6 of |v_d|, else 1. Without
        a surface of the name there is no puncture or collision.

        * start_velocity_overshoot (m/s): max of s (v_x - v_d_x) before the puncture,
          without a puncture before the contact, else over the whole run; at least 0.
          Where the environment has no surfaces, x is the direction of v_d.
        * puncture, None if the tool never crosses the surface `puncture`:
            * time (s): when it first does.
            * velocity (m/s): v_x then.
            * force (N): F_e_x just before, in the layer's own law.
            * velocity_overshoot (m/s): max of s (v_x - v_d_x) from the puncture to the
              first contact after it, or to the end. Not floored.
        * collision, None if the tool never reaches the surface `contact`:
            * time (s): when it first does.
            * velocity (m/s): v_x then.
            * initial_impact_force (N): max of F_e_x until it first leaves the surface.
            * peak_force (N): max of F_e_x from the first contact on.
            * rebound_velocity (m/s): min of v_x from the first contact on, whatever the
              command: away from the surface is along -x.
            * settling_time (s): from the first contact until |v_x| stays under 5 % of
              |v_d| to the end of the recording. None if it does not, or the run
              diverges, or it was as slow for as long before without staying so: a
              recording that happens to end while v_x passes through 0 has not settled.
            * rest_time (s): the same of the tool in all directions and of the force:
              until |v| stays under 5 % of |v_d|, and |F_e - F_end| under 5 % of
              |F_end|, the force at the end of the run. A force that creeps ends
              elsewhere in a longer run. With six axes, both hold of what moves and of
              what turns, each by itself; moments count where there are any.
        * velocity_rms_error (m/s per axis): rms over the run of v - v_dd, v_dd being
          the velocity command as the slave receives it, or, in an architecture that
          does not send it, the operator's command delayed by forward_channel.delay.
        * force_rms_error (N per axis): rms over the run of F_e - F_hd, F_hd being the
          haptic force as the slave receives it, or delayed by the same time.
        * coordination_rms_error (m per axis): rms over the run of x_m - p_WT. Master
          and tool begin at one place, and x_m is where the felt velocity takes the
          master from there: over exact channels the tool's place one return delay ago,
          unless the architecture lets the hand feel something else. Of six axes the
          first three have it. None if the recording has not what was felt.
        * control_force_peak (N per axis): max of |F_c|.
        * control_force_variation (N per axis): total variation of F_c, jumps included.
        * diverged, diverged_at (s): whether the run ended early because the tool's
          speed grew out of bounds or the solver failed, and when; else None.

        Args:
            recording: A run, all of its numbers finite.

        Returns:
            The `metrics` object of `teleop-drake run --json`: finite numbers, lists of
            them with one entry per task axis, bool and None.
        """
        has_diverged = recording.termination == "diverged"
        _, found = self._Of(recording)
        puncture, collision = (found.pop(x, {}) for x in ("puncture", "collision"))
        per_axis = [name[:-2] for name in UNITS if name.endswith(".*")]
        return {
            "start_velocity_overshoot": found.pop("start_velocity_overshoot"),
            "puncture": puncture if puncture.get("time") is not None else None,
            "collision": collision if collision.get("time") is not None else None,
            **{x: list(found[x].values()) if x in found else None for x in per_axis},
            "diverged": has_diverged,
            "diverged_at": float(recording.time[-1]) if has_diverged else None,
        }

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


def FirstNormal(surfaces: tuple[Surface, ...], v_d: np.ndarray) -> np.ndarray:
    """Returns the normal of the surface that comes first, else where v_d points."""
    named = [FindSurface(surfaces, name) for name in (PUNCTURE, CONTACT)]
    for surface in (*named, *surfaces):
        if surface is not None:
            return surface.normal_W
    return v_d / np.linalg.norm(v_d)

"""Insertion: a teleoperated tool is pushed into what the environment is made of.

Its metrics are overshoots, the puncture, the collision and the errors. Instants are
located, not sampled; see teleop_drake.tasks.pieces.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram

from teleop_drake.environments import CONTACT, PUNCTURE, FindSurface, Surface
from teleop_drake.numerics.step_polynomials import lagrange, shares
from teleop_drake.recording import Event, Recording
from teleop_drake.scenario import CONTROLLERS, Scenario
from teleop_drake.signals import AxisUnit
from teleop_drake.stations import MakeArchitecture
from teleop_drake.tasks.base import SpeedLimit, Task
from teleop_drake.tasks.panels import AxisName, NormalOfRuns, SignalRow
from teleop_drake.tasks.pieces import Pieces, Split, Traces
from teleop_drake.teleoperator import MakeTeleoperator

# A command that is slower than this share of |v_d| points nowhere: it may be zero but
# for rounding.
AT_REST = 1e-6

# Longer than what instants are rounded by, s.
_INSTANT = 1e-11

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

    def FindEvents(self, recording: Recording) -> list[Event]:
        """Returns when the tool crosses a surface and when the operator switches.

        Args:
            recording: A run, its events not found yet.
        """
        times, pieces = recording.time, Split(recording)
        p = pieces.Sample(recording["tool_position"])
        surfaces = {name: recording.FindSurface(name) for name in CROSSINGS}
        depths = {name: x.Depth(p) for name, x in surfaces.items() if x is not None}
        names = [CROSSINGS[name] for name in depths]
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
        signals = _MakeSignals(recording)
        pieces, excess, F_c = signals.pieces, signals.excess, Traces(signals.F_c)
        pierced, surface = map(recording.FindSurface, (PUNCTURE, CONTACT))
        t_puncture = signals.FirstCrossing(pierced, True)
        t_contact = signals.FirstCrossing(surface, True)
        t_start_end = t_puncture if t_puncture < math.inf else t_contact
        has_diverged = recording.termination == "diverged"

        stretches = {"start": (excess, -math.inf, t_start_end)}
        puncture: dict[str, Any] | None = None
        collision: dict[str, Any] | None = None
        if pierced is not None and t_puncture < math.inf:
            v_x, F_x = pierced.Along(signals.v), pierced.Along(signals.F_e)
            puncture = {
                "time": t_puncture,
                "velocity": pieces.ValueBefore(v_x, t_puncture),
                "force": pieces.ValueBefore(F_x, t_puncture),
            }
            t_next = signals.FirstCrossing(surface, True, after=t_puncture)
            stretches["free"] = excess, t_puncture, t_next
        if surface is not None and t_contact < math.inf:
            v_x, F_x = surface.Along(signals.v), surface.Along(signals.F_e)
            collision = {
                "time": t_contact,
                "velocity": pieces.ValueBefore(v_x, t_contact),
            }
            t_release = signals.FirstCrossing(surface, False, after=t_contact)
            stretches["impact"] = F_x, t_contact, t_release
            stretches["contact"] = F_x, t_contact, math.inf
            stretches["rebound"] = -v_x, t_contact, math.inf
        largest = pieces.Maxima(stretches)
        if puncture is not None:
            puncture["velocity_overshoot"] = largest["free"]
        if collision is not None:
            collision["initial_impact_force"] = largest["impact"]
            collision["peak_force"] = largest["contact"]
            collision["rebound_velocity"] = -largest["rebound"]
            v_d = recording.teleoperation.surgeon.velocity
            slow = SETTLING_RATIO * float(np.linalg.norm(v_d))
            v, F_e = signals.v, signals.F_e
            parts = [slice(0, 3), slice(3, 6)][: math.ceil(v.shape[2] / 3)]
            motions = {
                "settling_time": [_Exceeding(v_x[..., None], slow)],
                "rest_time": [
                    *(_Exceeding(v[..., part], slow) for part in parts),
                    *(
                        _Leaving(F_e[..., part])
                        for part in parts
                        if F_e[..., part].any()
                    ),
                ],
            }
            for name, moving in motions.items():
                after = _SettlingTime(pieces, moving, t_contact)
                collision[name] = None if has_diverged else after
        errors = pieces.RootMeanSquare(signals.errors)
        return {
            "start_velocity_overshoot": max(largest["start"], 0.0),
            "puncture": puncture,
            "collision": collision,
            "velocity_rms_error": errors[len(F_c) :],
            "force_rms_error": errors[: len(F_c)],
            "coordination_rms_error": _CoordinationError(recording, pieces),
            "control_force_peak": np.abs(F_c).max(axis=1).tolist(),
            "control_force_variation": np.abs(np.diff(F_c)).sum(axis=1).tolist(),
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


@dataclass(kw_only=True)
class _Signals:
    """The signals in pieces that end where a surface is crossed.

    Attributes:
        pieces: M.
        v: (M, d + 1, n) tool velocity in the pieces, and so on.
        excess: (M, d + 1) how far v exceeds the command, in the direction of it.
        errors: (M, d + 1, 2n) [F_e - F_hd; v - v_dd].
        crossings: (time, number of the surface, whether into it), ascending.
        surfaces: Of the environment.
    """

    pieces: Pieces
    v: np.ndarray
    F_e: np.ndarray
    F_c: np.ndarray
    excess: np.ndarray
    errors: np.ndarray
    crossings: list[tuple[float, int, bool]]
    surfaces: tuple[Surface, ...]

    def FirstCrossing(
        self, surface: Surface | None, inwards: bool, after: float = -math.inf
    ) -> float:
        """Returns when a surface is first crossed, infinity if it is not."""
        for time, crossed, is_inwards in self.crossings:
            is_it = self.surfaces[crossed] is surface
            if is_it and is_inwards == inwards and time > after:
                return time
        return math.inf


def FirstNormal(surfaces: tuple[Surface, ...], v_d: np.ndarray) -> np.ndarray:
    """Returns the normal of the surface that comes first, else where v_d points."""
    named = [FindSurface(surfaces, name) for name in (PUNCTURE, CONTACT)]
    for surface in (*named, *surfaces):
        if surface is not None:
            return surface.normal_W
    return v_d / np.linalg.norm(v_d)


def _MakeSignals(recording: Recording) -> _Signals:
    surfaces = recording.surfaces
    v_d = np.asarray(recording.teleoperation.surgeon.velocity, dtype=float)
    normal = FirstNormal(surfaces, v_d)
    n = len(normal)

    instants = _Echoes(recording)
    pieces = Split(recording, instants)
    p = pieces.Sample(recording["tool_position"])
    crossings = pieces.Crossings(*(surface.Depth(p) for surface in surfaces))
    instants += [crossing for crossing, _, _ in crossings]
    slowest = AT_REST * float(np.linalg.norm(v_d))
    if not recording.has_constant_command:
        along = _ReceivedCommands(recording, pieces)[:, :, n:] @ normal
        instants += [reversal for reversal, _, _ in pieces.Crossings(along + slowest)]
    pieces = Split(recording, instants)

    v, F_e, F_c = (
        pieces.Sample(recording[name])
        for name in ("tool_velocity", "environment_force", "control_force")
    )
    commands = _ReceivedCommands(recording, pieces)
    is_constant = recording.has_constant_command
    along = (v_d[None, None] if is_constant else commands[:, :, n:]) @ normal
    # The command reverses only where a piece ends.
    is_back = along.mean(axis=1, keepdims=True) < -slowest
    return _Signals(
        pieces=pieces,
        v=v,
        F_e=F_e,
        F_c=F_c,
        excess=np.where(is_back, -1.0, 1.0) * (np.einsum("...i,i", v, normal) - along),
        errors=np.concatenate([F_e, v], axis=2) - commands,
        crossings=crossings,
        surfaces=surfaces,
    )


def _Echoes(recording: Recording) -> list[float]:
    """Returns when the jumps of a command that is not sent would arrive, in s."""
    if "velocity_command" not in recording.signals:
        return []
    time, commands = recording.time, recording.commands
    has_jumped = (np.diff(time) == 0) & np.any(np.diff(commands, axis=0), axis=1)
    jumps = np.append(time[0], time[1:][has_jumped])
    return list(jumps + recording.teleoperation.forward_channel.delay)


def _ReceivedCommands(recording: Recording, pieces: Pieces) -> np.ndarray:
    """Returns [F_hd; v_dd] (M, d + 1, 2n) in the pieces."""
    if "velocity_command" not in recording.signals:
        return pieces.Sample(recording["forward_packet_received"])
    times = pieces.Times(shares(pieces.rows.shape[1] - 1))
    # Within the piece, where a jump at its ends has happened, or has not.
    inwards = np.minimum(_INSTANT, (pieces.end - pieces.begin) / 8)
    times[:, 0] += inwards
    times[:, -1] -= inwards
    times -= recording.teleoperation.forward_channel.delay
    values = np.concatenate(
        [
            recording.Interpolate(name, times.ravel()).reshape(*times.shape, -1)
            for name in ("force_command", "velocity_command")
        ],
        axis=2,
    )
    values[times < 0] = 0.0
    return values


def _CoordinationError(recording: Recording, pieces: Pieces) -> list[float] | None:
    """Returns the rms of x_m - p_WT, None if what is felt was not recorded."""
    p = pieces.Sample(recording["tool_position"])
    n = p.shape[2]
    if "felt_velocity" in recording.signals:
        felt = pieces.Sample(recording["felt_velocity"])
    elif "return_packet_received" in recording.signals:
        felt = pieces.Sample(recording["return_packet_received"])[:, :, n : 2 * n]
    else:
        return None
    # An angular velocity is not the rate of a rotation vector.
    p, felt = p[:, :, :3], felt[:, :, :3]
    return pieces.RootMeanSquare(p[0, 0] + pieces.Integral(felt) - p)


def _Exceeding(x: np.ndarray, limit: float) -> np.ndarray:
    """Returns |x|^2 - limit^2 (M, 2d + 1), of which x (M, d + 1, k) is made."""
    degree = x.shape[1] - 1
    x = lagrange(shares(2 * degree), degree) @ x
    return np.asarray((x * x).sum(axis=2) - limit**2)


def _Leaving(x: np.ndarray) -> np.ndarray:
    """Returns what is positive where x is not within 5 % of where it ends."""
    end = x[-1, -1]
    return _Exceeding(x - end, SETTLING_RATIO * float(np.linalg.norm(end)))


def _SettlingTime(
    pieces: Pieces, moving: Sequence[np.ndarray], t_contact: float
) -> float | None:
    """Returns how long after contact no signal is positive, None if one ever is again.

    It is None as well if that lasts no longer than it has before.
    """
    first = pieces.CountBefore(t_contact)
    if first == len(pieces.end):
        return None
    is_moving = [bool(signal[first, 0] >= 0) for signal in moving]
    slow_since = None if any(is_moving) else t_contact
    longest = 0.0
    for time, number, is_upwards in pieces.Crossings(*moving):
        if time <= t_contact:
            continue
        is_moving[number] = is_upwards
        if slow_since is not None and is_upwards:
            longest = max(longest, time - slow_since)
        if slow_since is None or is_upwards:
            slow_since = None if any(is_moving) else time
    if slow_since is None or pieces.end[-1] - slow_since <= longest:
        return None
    return slow_since - t_contact

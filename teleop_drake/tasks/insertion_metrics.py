"""What counts in an insertion: overshoots, the puncture, the collision, the errors.

Between two samples the environment's force is that of the material's own law, and every
other signal is as in teleop_drake.tasks.pieces. Instants are located, not sampled.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from teleop_drake.environments import CONTACT, PUNCTURE, FindSurface, Surface
from teleop_drake.environments.surface import StackNormal
from teleop_drake.recording import Recording
from teleop_drake.tasks.pieces import (
    Crossings,
    Maximum,
    Motion,
    NodeTimes,
    RootMeanSquare,
    Sample,
    Split,
    Trace,
    ValueBefore,
    Variation,
)

# A command that is slower than this share of |v_d| points nowhere: it may be zero but
# for rounding.
_AT_REST = 1e-6

SETTLING_RATIO = 0.05
"""Share of |v_d| under which the tool counts as settled."""

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
    "velocity_rms_error.*": "m/s",
    "force_rms_error.*": "N",
    "control_force_peak.*": "N",
    "control_force_variation.*": "N",
    "control_force_variation_error.*": "N",
    "diverged": "",
    "diverged_at": "s",
}
"""Scalar metrics of an insertion and their units; * stands for each task axis."""


@dataclass(kw_only=True)
class _Pieces:
    """The signals between the samples and the crossings of the surfaces.

    Attributes:
        begin, end: (M,) times in s, ascending.
        v: (M, 8, n) tool velocity at the nodes of each piece, and so on.
        bold_F_c: F_c that turns between samples where they leave that open.
        excess: (M, 8) how far v exceeds the command, in the direction of the command.
        crossings: (time, number of the surface, whether into it), ascending.
        surfaces: Of the environment.
    """

    begin: np.ndarray
    end: np.ndarray
    v: np.ndarray
    excess: np.ndarray
    F_e: np.ndarray
    F_c: np.ndarray
    bold_F_c: np.ndarray
    v_dd: np.ndarray
    F_hd: np.ndarray
    crossings: list[tuple[float, int, bool]]
    surfaces: tuple[Surface, ...]

    def CountBefore(self, time: float) -> int:
        """Returns how many pieces lie before a time."""
        return int(np.count_nonzero(self.begin + self.end < 2 * time))

    def FirstCrossing(
        self, surface: Surface | None, inwards: bool, after: float = -math.inf
    ) -> float | None:
        """Returns when a surface is first crossed, None if it is not."""
        for time, crossed, is_inwards in self.crossings:
            is_it = self.surfaces[crossed] is surface
            if is_it and is_inwards == inwards and time > after:
                return time
        return None

    def RootMeanSquare(self, error: np.ndarray) -> list[float]:
        """Returns the rms over time of a signal (M, 8, n), per axis."""
        return RootMeanSquare(self.begin, self.end, error)


def InsertionMetrics(recording: Recording) -> dict[str, Any]:
    """Returns the metrics of an insertion.

    With v_d = surgeon.velocity, and all times simulation time. An operator of another
    kind than constant_velocity does not command that all the time: there overshoots
    compare with the command as it arrives at the slave at each instant, v_dd below.
    The surfaces are those that the environment told; x is the direction of the normal
    into the surface in question. An overshoot is one in the direction of the command:
    s = -1 if v_d_x < 0 by more than 1e-6 of |v_d|, else 1. Without a surface of the
    name there is no puncture or collision.

    * start_velocity_overshoot (m/s): max of s (v_x - v_d_x) before the puncture,
      without a puncture before the contact, else over the whole run; at least 0. Where
      the environment has no surfaces, x is the direction of v_d.
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
          |v_d| to the end of the recording. None if it does not, or the run diverges,
          or it was as slow for as long before without staying so: a recording that
          happens to end while v_x passes through 0 has not settled.
    * velocity_rms_error (m/s per axis): rms over the run of v - v_dd, v_dd being the
      velocity command as the slave receives it, or, in an architecture that does not
      send it, the operator's command delayed by forward_channel.delay.
    * force_rms_error (N per axis): rms over the run of F_e - F_hd, F_hd being the
      haptic force as the slave receives it, or delayed by the same time.
    * control_force_peak (N per axis): max of |F_c|.
    * control_force_variation (N per axis): total variation of F_c, jumps included.
    * control_force_variation_error (N per axis): an estimate of what it misses. Where
      there are too few samples from one jump to the next, as between packets, F_c goes
      from sample to sample without turning; this is how much more its variation would
      be if it went along parabolas there.
    * diverged, diverged_at (s): whether the run ended early because the tool's speed
      grew out of bounds or the solver failed, and when; else None.

    Args:
        recording: A run, all of its numbers finite. If the environment tells no stack
            of materials, the recorded force is interpolated; a robot of one's own
            without `tool_acceleration` has its position and velocity interpolated.

    Returns:
        The `metrics` object of `teleop-drake run --json`: finite numbers, lists of
        them with one entry per task axis, bool and None.
    """
    v_d = np.asarray(recording.teleoperation.surgeon.velocity, dtype=float)
    pieces = _MakePieces(recording)
    pierced, surface = map(recording.FindSurface, (PUNCTURE, CONTACT))
    t_puncture = pieces.FirstCrossing(pierced, True)
    t_contact = pieces.FirstCrossing(surface, True)
    has_diverged = recording.termination == "diverged"

    start_ends = [time for time in (t_puncture, t_contact) if time is not None]
    start_end = pieces.CountBefore(start_ends[0]) if start_ends else len(pieces.v)
    puncture = collision = None
    if pierced is not None and t_puncture is not None:
        t_next = pieces.FirstCrossing(surface, True, after=t_puncture)
        puncture = _Puncture(pieces, pierced, t_puncture, t_next)
    if surface is not None and t_contact is not None:
        collision = _Collision(pieces, surface, t_contact, v_d)
        if has_diverged:
            collision["settling_time"] = None
    variation = Variation(pieces.F_c)
    return {
        "start_velocity_overshoot": max(Maximum(pieces.excess, 0, start_end), 0.0),
        "puncture": puncture,
        "collision": collision,
        "velocity_rms_error": pieces.RootMeanSquare(pieces.v - pieces.v_dd),
        "force_rms_error": pieces.RootMeanSquare(pieces.F_e - pieces.F_hd),
        "control_force_peak": [
            float(np.abs(Trace(axis)).max()) for axis in np.moveaxis(pieces.F_c, 2, 0)
        ],
        "control_force_variation": variation.tolist(),
        "control_force_variation_error": np.abs(
            Variation(pieces.bold_F_c) - variation
        ).tolist(),
        "diverged": has_diverged,
        "diverged_at": float(recording.time[-1]) if has_diverged else None,
    }


def _Puncture(
    pieces: _Pieces,
    surface: Surface,
    time: float,
    t_next: float | None,
) -> dict[str, Any]:
    """Returns the metrics of a puncture; t_next is when the next contact is."""
    v_x, F_x = surface.Along(pieces.v), surface.Along(pieces.F_e)
    i = pieces.CountBefore(time)
    j = len(v_x) if t_next is None else pieces.CountBefore(t_next)
    return {
        "time": time,
        "velocity": ValueBefore(v_x, i),
        "force": ValueBefore(F_x, i),
        "velocity_overshoot": Maximum(pieces.excess, i, j),
    }


def _Collision(
    pieces: _Pieces, surface: Surface, time: float, v_d: np.ndarray
) -> dict[str, Any]:
    """Returns the metrics of a collision, of a run that does not diverge."""
    v_x, F_x = surface.Along(pieces.v), surface.Along(pieces.F_e)
    num_pieces = len(v_x)
    i = pieces.CountBefore(time)
    t_release = pieces.FirstCrossing(surface, False, after=time)
    j = num_pieces if t_release is None else pieces.CountBefore(t_release)
    settled = SETTLING_RATIO * float(np.linalg.norm(v_d))
    return {
        "time": time,
        "velocity": ValueBefore(v_x, i),
        "initial_impact_force": Maximum(F_x, i, j),
        "peak_force": Maximum(F_x, i, num_pieces),
        "rebound_velocity": -Maximum(-v_x, i, num_pieces),
        "settling_time": _SettlingTime(pieces, v_x, time, settled),
    }


def _FirstNormal(surfaces: tuple[Surface, ...], v_d: np.ndarray) -> np.ndarray:
    """Returns the normal of the surface that comes first, else where v_d points."""
    named = [FindSurface(surfaces, name) for name in (PUNCTURE, CONTACT)]
    for surface in (*named, *surfaces):
        if surface is not None:
            return surface.normal_W
    direction: np.ndarray = v_d / np.linalg.norm(v_d)
    return direction


def _MakePieces(recording: Recording) -> _Pieces:
    time, surfaces = recording.time, recording.surfaces
    v_d = np.asarray(recording.teleoperation.surgeon.velocity, dtype=float)
    normal = _FirstNormal(surfaces, v_d)
    n = len(normal)

    echoes: list[float] = []
    if "velocity_command" in recording.signals:
        # Where the commands jump once they are delayed.
        jumps = np.append(time[0], time[1:][np.diff(time) == 0])
        jumps += recording.teleoperation.forward_channel.delay
        echoes = jumps[jumps < time[-1]].tolist()
    begin, end = Split(time, echoes)
    p, v = Motion(recording, begin, end)
    crossings = sorted(
        (crossing, i, is_inwards)
        for i, surface in enumerate(surfaces)
        for crossing, is_inwards in Crossings(begin, end, surface.Depth(p))
    )
    instants = [crossing for crossing, _, _ in crossings]
    slowest = _AT_REST * float(np.linalg.norm(v_d))
    if not recording.has_constant_command:
        along = _ReceivedCommands(recording, begin, end)[:, :, n:] @ normal
        instants += [reversal for reversal, _ in Crossings(begin, end, along + slowest)]
    if instants:
        begin, end = Split(time, [*echoes, *instants])
        p, v = Motion(recording, begin, end)

    F_e = _StackForce(surfaces, p, v)
    if F_e is None:
        F_e = Sample(recording, "environment_force", begin, end)
    commands = _ReceivedCommands(recording, begin, end)
    v_dd = commands[:, :, n:]
    command = np.broadcast_to(v_d, v.shape) if recording.has_constant_command else v_dd
    along = command @ normal
    # The command reverses only where a piece ends.
    is_back = along.mean(axis=1, keepdims=True) < -slowest
    return _Pieces(
        begin=begin,
        end=end,
        v=v,
        excess=np.where(is_back, -1.0, 1.0) * (v @ normal - along),
        F_e=F_e,
        F_c=Sample(recording, "control_force", begin, end),
        bold_F_c=Sample(recording, "control_force", begin, end, is_cautious=False),
        v_dd=v_dd,
        F_hd=commands[:, :, :n],
        crossings=crossings,
        surfaces=surfaces,
    )


def _StackForce(
    surfaces: tuple[Surface, ...], p: np.ndarray, v: np.ndarray
) -> np.ndarray | None:
    """Returns F_e (M, 8, n) in a stack of materials, None if they are no stack.

    A crossing is an end of a piece, so each piece lies in one material.
    """
    normal = StackNormal(surfaces)
    if normal is None:
        return None
    depth = np.array([surface.Depth(p.mean(axis=1)) for surface in surfaces])
    is_passed = np.asarray(depth >= 0)
    # The one that is nearest in front of the piece; one may be infinitely far away.
    distance = np.where(is_passed, np.minimum(depth, np.finfo(float).max), np.inf)
    nearest = np.argmin(distance, axis=0)
    stiffness, damping, relaxed = (
        np.array([getattr(surface.material, name) for surface in surfaces])[nearest]
        for name in ("stiffness", "damping", "relaxed")
    )
    is_in_material = np.any(is_passed, axis=0)
    force = stiffness[:, None] * (p @ normal - relaxed[:, None])
    force += damping[:, None] * (v @ normal)
    result: np.ndarray = (is_in_material[:, None] * force)[:, :, None] * normal
    return result


def _ReceivedCommands(
    recording: Recording, begin: np.ndarray, end: np.ndarray
) -> np.ndarray:
    """Returns [F_hd; v_dd] (M, 8, 2n) at the nodes of the pieces."""
    if "velocity_command" not in recording.signals:
        return Sample(recording, "forward_packet_received", begin, end)
    delay = recording.teleoperation.forward_channel.delay
    times = NodeTimes(begin, end)
    # At a jump Interpolate() returns the value before it; the first node is after it.
    times[:, 0] += 1e-9 * (end - begin)
    times -= delay
    values = np.concatenate(
        [
            recording.Interpolate(name, times.ravel()).reshape(*times.shape, -1)
            for name in ("force_command", "velocity_command")
        ],
        axis=2,
    )
    values[times < 0] = 0.0
    return values


def _SettlingTime(
    pieces: _Pieces, v_x: np.ndarray, t_contact: float, threshold: float
) -> float | None:
    """Returns how long after contact |v_x| stays under a threshold, if it does."""
    first = pieces.CountBefore(t_contact)
    begin, end, v_x = pieces.begin[first:], pieces.end[first:], v_x[first:]
    if len(begin) == 0:
        return None
    changes = sorted(
        (time, not exceeds)
        for direction in (1, -1)
        for time, exceeds in Crossings(begin, end, direction * v_x - threshold)
    )
    slow_since = t_contact if abs(v_x[0, 0]) < threshold else None
    longest = 0.0
    for time, is_slow in changes:
        if slow_since is not None:
            longest = max(longest, time - slow_since)
        slow_since = time if is_slow else None
    if slow_since is None or end[-1] - slow_since <= longest:
        return None
    return slow_since - t_contact

"""The metrics of an insertion.

Each metric is one of the functions below, computed from the signals of an InsertionRun.
In each step of the run the signals are polynomials. The instant of an event is a root
of such a polynomial, a peak is its extreme, and integrals are exact. The operations are
defined in laws.signal_metrics. To add your own metric, write such a function
and call it in the Metrics() of your own task. Pages do not show it.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.numerics.pieces import SAME_INSTANT, Crossings, Pieces
from teleop_drake.model.blocks.environments import (
    CONTACT,
    PUNCTURE,
    FindSurface,
    Surface,
)
from teleop_drake.model.laws.signal_metrics import (
    Band,
    extremes,
    first_after,
    integral,
    rms,
    settling_time,
    value_before,
    values_in,
    variation,
)
from teleop_drake.model.task_recording import TaskRecording

AT_REST = 1e-6
"""The share of |v_d| below which a command counts as zero, because of rounding."""

SETTLING_RATIO = 0.05
"""The share of |v_d| below which the tool's speed counts as settled. For the rest time
the deviation from the final force must be below this share of that force."""


class Passage(NamedTuple):
    """The passage of the tool through a surface.

    Attributes:
        time: The time of the first crossing into the surface, s; None if there is none.
        since: The pieces from that time on; all pieces if there is no crossing.
        crossings: The crossings of the surface; upwards means into the surface.
        velocity: Velocity of the tool along the surface's normal, m/s (p, 5).
        force: The force on the environment along the normal, N (p, 5).
    """

    time: float | None
    since: slice
    crossings: Crossings
    velocity: Array
    force: Array


class InsertionRun:
    """The signals of an insertion in pieces, and the times of its events.

    A signal is an array (p, 5, n); see numerics.pieces. The pieces are the steps of the
    recording, cut where the received command jumps or reverses and where the tool
    crosses a surface. Times are in s.

    v_d is surgeon.velocity. An operator of another kind than constant_velocity does not
    command v_d all the time. Overshoots are then relative to the received command at
    each instant.

    Attributes:
        recording: The run, all of its numbers finite.
        v_d: The velocity that the scenario commands, m/s (n).
        speed: |v_d|, m/s.
        normal: The normal (n) of the first existing surface among the puncture surface,
            the contact surface and the first surface of the list; without surfaces the
            direction of v_d.
        pieces: The pieces of time in which the signals are polynomials.
        position: Position of the tool, m.
        velocity: Velocity of the tool, m/s.
        force: The robot's force on the environment, N.
        haptic_force: The operator's force as the slave receives it, N.
        command: The velocity command as the slave receives it, m/s.
        puncture: The passage of the surface `puncture`.
        contact: The passage of the hard surface `contact`.
        overshoot: The excess of the tool's velocity over its command, m/s, with its
            extremes (p, 9). It is taken along the normal and positive in the direction
            of the command.
        contact_velocity: contact.velocity with its extremes (p, 9).
        contact_force: contact.force with its extremes (p, 9).
        control_force: F_c with its extremes, N (p, 9, n).
    """

    def __init__(self, recording: TaskRecording):
        self.recording = recording
        self.v_d = np.asarray(recording.teleoperation.surgeon.velocity, float)
        self.speed = float(np.linalg.norm(self.v_d))
        self.normal = FirstNormal(recording.surfaces, self.v_d)
        self._crossings = FindCrossings(recording)
        # Pieces end where the received command may jump or reverse and at the tool's
        # crossings of surfaces.
        received, delay = self._Received()
        cuts = [time + delay for time in self._Turns(received)]
        for crossings in self._crossings:
            cuts += [*crossings.upwards, *crossings.downwards]
        self.pieces = Pieces(recording.time, recording.steps, cuts)
        signal = self.pieces.signal
        self.position = signal(recording["tool_position"])
        self.velocity = signal(recording["tool_velocity"])
        self.force = signal(recording["environment_force"])
        packet = signal(received, delay)
        n = len(self.v_d)
        self.haptic_force = packet[..., :n]
        self.command = packet[..., n:]
        self.puncture = self._Passage(PUNCTURE)
        self.contact = self._Passage(CONTACT)
        # One call for all signals takes a third of the time of four calls.
        values = extremes(
            np.dstack(
                [
                    self._Overshoot(),
                    self.contact.velocity,
                    self.contact.force,
                    signal(recording["control_force"]),
                ]
            )
        )
        self.overshoot = values[..., 0]
        self.contact_velocity = values[..., 1]
        self.contact_force = values[..., 2]
        self.control_force = values[..., 3:]

    def _Overshoot(self) -> Array:
        """Returns the excess of the tool's velocity over its command, m/s (p, 5)."""
        # A constant command counts from the beginning, before the slave receives it.
        along = self.command @ self.normal
        if self.recording.has_constant_command:
            along = np.full_like(along, self.v_d @ self.normal)
        mean = along.mean(axis=1, keepdims=True)
        excess = self.velocity @ self.normal - along
        return np.where(mean < -AT_REST * self.speed, -excess, excess)

    def _Passage(self, name: str) -> Passage:
        """Returns the passage of a surface, without crossings if it does not exist."""
        surface = self.recording.FindSurface(name)
        normal = self.normal
        crossings = Crossings([], [])
        if surface is not None:
            normal = surface.normal_W
            crossings = self._crossings[self.recording.surfaces.index(surface)]
        time = next(iter(crossings.upwards), None)
        return Passage(
            time=time,
            since=self.pieces.between(time),
            crossings=crossings,
            velocity=self.velocity @ normal,
            force=self.force @ normal,
        )

    def _Received(self) -> tuple[Array, float]:
        """Returns the signal [F_h; v_d] and the delay in s after which it is received.

        The delay is 0 if the received packet contains [F_h; v_d], because it is
        recorded at the slave. Otherwise the commands and the channel's delay are used.
        """
        if "velocity_command" in self.recording:
            delay = self.recording.teleoperation.forward_channel.delay
            return self.recording.commands, delay
        return self.recording["forward_packet_received"], 0.0

    def _Turns(self, commands: Array) -> list[float]:
        """Returns the times in s at which the commands [F_h; v_d] start or change.

        A change is a jump of any command or a reversal of the velocity command.
        """
        time = self.recording.time
        is_same_instant = np.diff(time) <= SAME_INSTANT
        has_changed = (np.diff(commands, axis=0) != 0).any(axis=1)
        jumps = 1 + np.flatnonzero(is_same_instant & has_changed)
        heading = commands[:, len(self.v_d) :] @ self.normal + AT_REST * self.speed
        pieces = Pieces(time, self.recording.steps)
        reversals = pieces.crossings(pieces.signal(heading[:, np.newaxis])[..., 0])
        return [*time[[0, *jumps]], *reversals.upwards, *reversals.downwards]


# The metrics of an insertion. The index x means the component along a normal: for
# overshoots along InsertionRun.normal, for other metrics along the normal of the
# surface `puncture` or `contact`.


def StartVelocityOvershoot(run: InsertionRun) -> float:
    """Returns the max of s (v_x - v_d_x) before the puncture, m/s; at least 0.

    Without a puncture the maximum is taken before the contact; without a contact, over
    the whole run. s is -1 where v_d_x is negative by more than 1e-6 of |v_d|, and
    otherwise 1.
    """
    end = run.contact.time if run.puncture.time is None else run.puncture.time
    before = values_in(run.overshoot, run.pieces.between(None, end))
    return max(0.0, float(before.max()))


def PunctureTime(run: InsertionRun) -> float | None:
    """Returns the time at which the tool first crosses the surface `puncture`, s."""
    return run.puncture.time


def PunctureVelocity(run: InsertionRun) -> float:
    """Returns v_x just before the puncture, m/s."""
    return float(value_before(run.puncture.velocity, run.puncture.since))


def PunctureForce(run: InsertionRun) -> float:
    """Returns F_e_x just before the puncture, in the layer that the tool leaves, N."""
    return float(value_before(run.puncture.force, run.puncture.since))


def PunctureVelocityOvershoot(run: InsertionRun) -> float:
    """Returns the max of s (v_x - v_d_x) after the puncture, m/s.

    The maximum is taken until the first contact after the puncture, or to the end. It
    may be negative. s is defined in StartVelocityOvershoot().
    """
    contact = first_after(run.puncture.time, run.contact.crossings.upwards)
    behind = run.pieces.between(run.puncture.time, contact)
    return float(values_in(run.overshoot, behind).max())


def CollisionTime(run: InsertionRun) -> float | None:
    """Returns the time at which the tool first reaches the surface `contact`, s."""
    return run.contact.time


def CollisionVelocity(run: InsertionRun) -> float:
    """Returns v_x just before the first contact, m/s."""
    return float(value_before(run.contact.velocity, run.contact.since))


def InitialImpactForce(run: InsertionRun) -> float:
    """Returns the max of F_e_x from first contact to the first release, N."""
    release = first_after(run.contact.time, run.contact.crossings.downwards)
    first_contact = run.pieces.between(run.contact.time, release)
    return float(values_in(run.contact_force, first_contact).max())


def PeakForce(run: InsertionRun) -> float:
    """Returns the max of F_e_x from the first contact on, N."""
    return float(values_in(run.contact_force, run.contact.since).max())


def ReboundVelocity(run: InsertionRun) -> float:
    """Returns the min of v_x from the first contact on, m/s, for any command.

    A negative value is a motion away from the surface.
    """
    return float(values_in(run.contact_velocity, run.contact.since).min())


def SettlingTime(run: InsertionRun) -> float | None:
    """Returns the time from contact until |v_x| stays below 5 % of |v_d|, s.

    The result is None if |v_x| does not stay below the limit to the end, or if the run
    diverges. It is also None if |v_x| was below the limit for at least as long earlier
    and then exceeded it: a run that ends while v_x passes through 0 has not settled.
    """
    v_x = run.contact.velocity[..., np.newaxis]
    return _Settling(run, [Band(v_x, SETTLING_RATIO * run.speed)])


def RestTime(run: InsertionRun) -> float | None:
    """Returns the time from contact until the tool and its force are at rest, s.

    At rest, |v| stays below 5 % of |v_d| and |F_e - F_end| below 5 % of |F_end|, where
    F_end is the force at the end of the run. F_end depends on the duration of the run
    if the force creeps. With six axes both conditions apply separately to translation
    and rotation. A force or moment that is always 0 is ignored.
    """
    bands = []
    for first in range(0, len(run.v_d), 3):
        axes = slice(first, first + 3)
        bands.append(Band(run.velocity[..., axes], SETTLING_RATIO * run.speed))
        force = run.force[..., axes]
        if force.any():
            end = force[-1, -1]
            radius = SETTLING_RATIO * float(np.linalg.norm(end))
            bands.append(Band(force - end, radius))
    return _Settling(run, bands)


def _Settling(run: InsertionRun, bands: Sequence[Band]) -> float | None:
    """Returns the time from contact until all vectors stay in their bands, s."""
    if run.recording.termination == "diverged":
        return None
    return settling_time(run.pieces, run.contact.since, bands)


def VelocityRmsError(run: InsertionRun) -> Array:
    """Returns the rms over the run of v - v_dd per axis, m/s.

    v_dd is the velocity command as the slave receives it. In an architecture that does
    not send it, v_dd is the operator's command delayed by forward_channel.delay.
    """
    return rms(run.velocity - run.command, run.pieces.length)


def ForceRmsError(run: InsertionRun) -> Array:
    """Returns the rms over the run of F_e - F_hd per axis, N.

    F_hd is the haptic force as the slave receives it. In an architecture that does not
    send it, F_hd is the operator's force delayed by forward_channel.delay.
    """
    return rms(run.force - run.haptic_force, run.pieces.length)


def CoordinationRmsError(run: InsertionRun) -> Array | None:
    """Returns the rms over the run of x_m - p_WT per axis, m.

    Master and tool start at the same position, and x_m is this position plus the
    integral of the felt velocity. With exact channels x_m is the tool's position
    delayed by the return channel, unless the architecture feeds back another velocity.
    With six axes the metric has only the first three. The result is None if the
    recording has no felt velocity.
    """
    velocity = run.recording.felt_velocity
    if velocity is None:
        return None
    tool = run.position[..., :3]
    felt = run.pieces.signal(velocity[:, :3])
    return rms(integral(felt, run.pieces.length, tool[0, 0]) - tool, run.pieces.length)


def ControlForcePeak(run: InsertionRun) -> Array:
    """Returns the max of |F_c| per axis, N."""
    return np.abs(run.control_force).max(axis=(0, 1))


def ControlForceVariation(run: InsertionRun) -> Array:
    """Returns the total variation of F_c per axis, jumps included, N."""
    return variation(run.control_force)


_Metrics: TypeAlias = Mapping[str, tuple[Callable[[InsertionRun], Any], str]]

PUNCTURE_METRICS: _Metrics = {
    "time": (PunctureTime, "s"),
    "velocity": (PunctureVelocity, "m/s"),
    "force": (PunctureForce, "N"),
    "velocity_overshoot": (PunctureVelocityOvershoot, "m/s"),
}
"""Metrics of a run with a puncture: function and unit."""

COLLISION_METRICS: _Metrics = {
    "time": (CollisionTime, "s"),
    "velocity": (CollisionVelocity, "m/s"),
    "initial_impact_force": (InitialImpactForce, "N"),
    "peak_force": (PeakForce, "N"),
    "rebound_velocity": (ReboundVelocity, "m/s"),
    "settling_time": (SettlingTime, "s"),
    "rest_time": (RestTime, "s"),
}
"""Metrics of a run with a contact: function and unit."""

AXIS_METRICS: _Metrics = {
    "velocity_rms_error": (VelocityRmsError, "m/s"),
    "force_rms_error": (ForceRmsError, "N"),
    "coordination_rms_error": (CoordinationRmsError, "m"),
    "control_force_peak": (ControlForcePeak, "N"),
    "control_force_variation": (ControlForceVariation, "N"),
}
"""Metrics that have a value for each task axis: function and unit."""

UNITS = {
    "start_velocity_overshoot": "m/s",
    **{f"puncture.{name}": unit for name, (_, unit) in PUNCTURE_METRICS.items()},
    **{f"collision.{name}": unit for name, (_, unit) in COLLISION_METRICS.items()},
    **{f"{name}.*": unit for name, (_, unit) in AXIS_METRICS.items()},
    "diverged": "",
    "diverged_at": "s",
}
"""Scalar metrics of an insertion and their units; * stands for each task axis."""


def FirstNormal(surfaces: tuple[Surface, ...], v_d: Array) -> Array:
    """Returns the normal of the puncture, contact or first surface.

    Without surfaces it is the direction of v_d.
    """
    named = [FindSurface(surfaces, name) for name in (PUNCTURE, CONTACT)]
    for surface in (*named, *surfaces):
        if surface is not None:
            return surface.normal_W
    return v_d / np.linalg.norm(v_d)


def FindCrossings(recording: TaskRecording) -> list[Crossings]:
    """Returns the tool's crossings of each surface; upwards means into the surface."""
    pieces = Pieces(recording.time, recording.steps)
    position = pieces.signal(recording["tool_position"])
    return [pieces.crossings(x.Depth(position)) for x in recording.surfaces]

"""Numbers that describe one run: pure functions of a recording.

The integrator's steps are long compared with what happens in them, so no number is
read off at the samples. Between two samples every signal is a polynomial: position
and velocity by quintic Hermite interpolation of (p_WT, v_WT, a_WT), the environment
force by the law of the layer, everything else by Recording.Interpolate(). Instants
are roots of these polynomials, peaks are their extremes, and integrals are exact for
them. Reported metrics thus converge with the solver, not with the sampling.
"""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebval, chebvander
from numpy.polynomial.legendre import Legendre

from teleop_drake.environments.surface import (
    CONTACT,
    PUNCTURE,
    FindSurface,
    StackNormal,
    Surface,
)
from teleop_drake.recording import Recording
from teleop_drake.scenario import TrackingScenario

SETTLING_RATIO = 0.05
"""Share of |v_d| under which the tool counts as settled."""

# A polynomial of degree 7 on a piece of time is kept as its values at the 8
# Gauss-Lobatto points of [-1, 1], both ends included.
_DEGREE = 7
_INNER = np.sort(Legendre.basis(_DEGREE).deriv().roots().real)
_NODES = np.concatenate([[-1.0], _INNER, [1.0]])
# Weights of the mean over the piece, exact up to degree 13.
_WEIGHTS = 1 / (_DEGREE * (_DEGREE + 1) * Legendre.basis(_DEGREE)(_NODES) ** 2)
_TO_CHEBYSHEV = np.linalg.inv(chebvander(_NODES, _DEGREE))
_DERIVATIVE = chebvander(_NODES, _DEGREE - 1) @ chebder(_TO_CHEBYSHEV)

# Pieces shorter than this share of the recording are jumps.
_SHORTEST_PIECE = 1e-14


@dataclass(kw_only=True)
class _Pieces:
    """The signals between the samples and the crossings of the surfaces.

    Attributes:
        begin, end: (M,) times in s, ascending.
        v: (M, 8, n) tool velocity at the nodes of each piece, and so on.
        crossings: (time, number of the surface, whether into it), ascending.
        surfaces: Of the environment.
    """

    begin: np.ndarray
    end: np.ndarray
    v: np.ndarray
    F_e: np.ndarray
    F_c: np.ndarray
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
        return _RootMeanSquare(self.begin, self.end, error)


def RunMetrics(recording: Recording) -> dict[str, Any]:
    """Returns the metrics of a run.

    With v_d = surgeon.velocity (constant), and all times simulation time. The surfaces
    are those that the environment told; x is the direction of the normal into the
    surface in question. An overshoot is one in the direction of the command: s = -1 if
    v_d_x < 0, else 1. Without a surface of the name there is no puncture or collision.

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
      send it, the surgeon's command delayed by forward_channel.delay.
    * force_rms_error (N per axis): rms over the run of F_e - F_hd, F_hd being the
      haptic force as the slave receives it, or delayed likewise.
    * control_force_peak (N per axis): max of |F_c|.
    * control_force_variation (N per axis): total variation of F_c, jumps included.
    * diverged, diverged_at (s): whether the run ended early because the tool's speed
      grew out of bounds or the solver failed, and when; else None.

    A run of a TrackingScenario has these instead, each per axis:

    * max_error (m): max of |r - r_d|.
    * rms_error (m): rms over the run of r - r_d.
    * disturbance_rms_error (N): rms over the run of W Phi - F_e, what the network
      does not know of the disturbance.

    Args:
        recording: A run. If the environment tells no stack of materials, the recorded
            force is interpolated; a robot of one's own without `tool_acceleration` has
            its position and velocity interpolated.

    Returns:
        The `metrics` object of `teleop-drake run --json`: finite numbers, lists of
        them with one entry per task axis, bool and None.

    Raises:
        ValueError: If the recording has no finite sample.
    """
    recording = _FinitePart(recording)
    scenario = recording.scenario
    if isinstance(scenario, TrackingScenario):
        return _TrackingMetrics(recording)
    v_d = np.asarray(scenario.surgeon.velocity, dtype=float)
    pieces = _MakePieces(recording)
    pierced, surface = map(recording.FindSurface, (PUNCTURE, CONTACT))
    t_puncture = pieces.FirstCrossing(pierced, True)
    t_contact = pieces.FirstCrossing(surface, True)
    has_diverged = recording.termination == "diverged"

    excess = _Excess(pieces.v, v_d, _FirstNormal(recording.surfaces, v_d))
    num_pieces = len(excess)
    start_ends = [time for time in (t_puncture, t_contact) if time is not None]
    start_end = pieces.CountBefore(start_ends[0]) if start_ends else num_pieces

    puncture = None
    if pierced is not None and t_puncture is not None:
        v_x, F_x = pierced.Along(pieces.v), pierced.Along(pieces.F_e)
        i = pieces.CountBefore(t_puncture)
        t_next = pieces.FirstCrossing(surface, True, after=t_puncture)
        j = num_pieces if t_next is None else pieces.CountBefore(t_next)
        puncture = {
            "time": t_puncture,
            "velocity": _ValueBefore(v_x, i),
            "force": _ValueBefore(F_x, i),
            "velocity_overshoot": _Max(_Excess(pieces.v, v_d, pierced.normal_W), i, j),
        }

    collision = None
    if surface is not None and t_contact is not None:
        v_x, F_x = surface.Along(pieces.v), surface.Along(pieces.F_e)
        i = pieces.CountBefore(t_contact)
        t_release = pieces.FirstCrossing(surface, False, after=t_contact)
        j = num_pieces if t_release is None else pieces.CountBefore(t_release)
        collision = {
            "time": t_contact,
            "velocity": _ValueBefore(v_x, i),
            "initial_impact_force": _Max(F_x, i, j),
            "peak_force": _Max(F_x, i, num_pieces),
            "rebound_velocity": -_Max(-v_x, i, num_pieces),
            "settling_time": (
                None
                if has_diverged
                else _SettlingTime(
                    pieces, v_x, t_contact, SETTLING_RATIO * float(np.linalg.norm(v_d))
                )
            ),
        }

    control_forces = [_Trace(axis) for axis in np.moveaxis(pieces.F_c, 2, 0)]
    return {
        "start_velocity_overshoot": max(_Max(excess, 0, start_end), 0.0),
        "puncture": puncture,
        "collision": collision,
        "velocity_rms_error": pieces.RootMeanSquare(pieces.v - pieces.v_dd),
        "force_rms_error": pieces.RootMeanSquare(pieces.F_e - pieces.F_hd),
        "control_force_peak": [float(np.abs(F).max()) for F in control_forces],
        "control_force_variation": [
            float(np.abs(np.diff(F.ravel())).sum()) for F in control_forces
        ],
        "diverged": has_diverged,
        "diverged_at": float(recording.time[-1]) if has_diverged else None,
    }


def RunSummary(recording: Recording) -> dict[str, Any]:
    """Returns what `teleop-drake run --json` prints: the run, its metrics, its end.

    Args:
        recording: A run.

    Returns:
        scenario, controller (its kind), forward_delay, return_delay and duration (s,
        as the scenario asks for), metrics (see RunMetrics), final (position in m,
        velocity in m/s and environment_force in N of the last sample, n each),
        with network channels `channels` (by name, see PacketStatistics), and solver
        (see SolverStatistics). Only finite numbers, None, bool, str, and lists and
        dicts of these. A run of a TrackingScenario has no delays; diverged
        and diverged_at (s, or None) stand beside its metrics.

    Raises:
        ValueError: If the recording has no finite sample.
    """
    recording = _FinitePart(recording)
    scenario = recording.scenario
    particular: dict[str, Any]
    statistics: dict[str, Any] = {}
    if isinstance(scenario, TrackingScenario):
        has_diverged = recording.termination == "diverged"
        particular = {
            "diverged": has_diverged,
            "diverged_at": float(recording.time[-1]) if has_diverged else None,
        }
    else:
        particular = {
            "forward_delay": float(scenario.forward_channel.delay),
            "return_delay": float(scenario.return_channel.delay),
        }
        if recording.channels:
            statistics["channels"] = {
                name: dataclasses.asdict(channel)
                for name, channel in recording.channels.items()
            }
    return {
        "scenario": scenario.name,
        "controller": scenario.controller.kind,
        **particular,
        "duration": float(scenario.duration),
        "metrics": RunMetrics(recording),
        "final": {
            "position": recording["tool_position"][-1].tolist(),
            "velocity": recording["tool_velocity"][-1].tolist(),
            "environment_force": recording["environment_force"][-1].tolist(),
        },
        **statistics,
        "solver": dataclasses.asdict(recording.solver),
    }


def _FirstNormal(surfaces: tuple[Surface, ...], v_d: np.ndarray) -> np.ndarray:
    """Returns the normal of the surface that comes first, else where v_d points."""
    named = [FindSurface(surfaces, name) for name in (PUNCTURE, CONTACT)]
    for surface in (*named, *surfaces):
        if surface is not None:
            return surface.normal_W
    direction: np.ndarray = v_d / np.linalg.norm(v_d)
    return direction


def _Excess(v: np.ndarray, v_d: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Returns by how much v (M, 8, n) exceeds v_d along a normal (M, 8)."""
    along = float(v_d @ normal)
    excess: np.ndarray = (-1.0 if along < 0 else 1.0) * (v @ normal - along)
    return excess


def _RootMeanSquare(
    begin: np.ndarray, end: np.ndarray, error: np.ndarray
) -> list[float]:
    """Returns the rms over time of a signal (M, 8, n), per axis."""
    length = end - begin
    total = length.sum()
    share = length / total if total > 0 else np.ones(len(length))
    mean = np.einsum("m,j,mjn->n", share, _WEIGHTS, error**2)
    return [float(value) for value in np.sqrt(mean)]


def _TrackingMetrics(recording: Recording) -> dict[str, list[float]]:
    """Returns the metrics of a run of a TrackingScenario."""
    begin, end = _Split(recording.time, [])
    r, _ = _Motion(recording, begin, end)
    error = r - _Sample(recording, "desired_position", begin, end)
    unknown = _Sample(recording, "disturbance_estimate", begin, end) - _Sample(
        recording, "environment_force", begin, end
    )
    return {
        "max_error": [
            float(np.abs(_Trace(axis)).max()) for axis in np.moveaxis(error, 2, 0)
        ],
        "rms_error": _RootMeanSquare(begin, end, error),
        "disturbance_rms_error": _RootMeanSquare(begin, end, unknown),
    }


def _FinitePart(recording: Recording) -> Recording:
    """Returns the recording up to its first sample that is not finite."""
    is_finite = np.isfinite(recording.time)
    for samples in recording.signals.values():
        is_finite &= np.isfinite(samples).all(axis=1)
    if is_finite.all() and len(is_finite) > 0:
        return recording
    count = int(np.argmin(is_finite)) if len(is_finite) > 0 else 0
    if count == 0:
        raise ValueError("recording: no finite sample; allowed: at least one")
    return dataclasses.replace(
        recording,
        time=recording.time[:count],
        signals={name: x[:count] for name, x in recording.signals.items()},
    )


def _MakePieces(recording: Recording) -> _Pieces:
    time = recording.time
    n = recording["tool_position"].shape[1]
    surfaces = recording.surfaces

    echoes: list[float] = []
    if "velocity_command" in recording.signals:
        # Where the commands jump once they are delayed.
        jumps = np.append(time[0], time[1:][np.diff(time) == 0])
        jumps += recording.teleoperation.forward_channel.delay
        echoes = jumps[jumps < time[-1]].tolist()
    begin, end = _Split(time, echoes)
    p, v = _Motion(recording, begin, end)
    crossings = sorted(
        (crossing, i, is_inwards)
        for i, surface in enumerate(surfaces)
        for crossing, is_inwards in _Crossings(begin, end, surface.Depth(p))
    )
    if crossings:
        instants = [crossing for crossing, _, _ in crossings]
        begin, end = _Split(time, [*echoes, *instants])
        p, v = _Motion(recording, begin, end)

    F_e = _StackForce(surfaces, p, v)
    if F_e is None:
        F_e = _Sample(recording, "environment_force", begin, end)
    commands = _ReceivedCommands(recording, begin, end)
    return _Pieces(
        begin=begin,
        end=end,
        v=v,
        F_e=F_e,
        F_c=_Sample(recording, "control_force", begin, end),
        v_dd=commands[:, :, n:],
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
        return _Sample(recording, "forward_packet_received", begin, end)
    delay = recording.teleoperation.forward_channel.delay
    times = _NodeTimes(begin, end)
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


def _Split(time: np.ndarray, instants: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Returns the (begin, end) of the pieces between samples and further instants."""
    edges = np.sort(np.concatenate([time, instants]))
    is_piece = np.diff(edges) > _SHORTEST_PIECE * (edges[-1] - edges[0])
    if not is_piece.any():
        return edges[-1:], edges[-1:]
    return edges[:-1][is_piece], edges[1:][is_piece]


def _NodeTimes(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Returns the times (M, 8) of the nodes of the pieces."""
    times = ((1 - _NODES) * begin[:, None] + (1 + _NODES) * end[:, None]) / 2
    return np.asarray(times)


def _Intervals(time: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Returns the indices (M,) of the samples that each piece follows."""
    indices = np.searchsorted(time, (begin + end) / 2) - 1
    return np.asarray(np.clip(indices, 0, None))


def _Sample(
    recording: Recording, name: str, begin: np.ndarray, end: np.ndarray
) -> np.ndarray:
    """Returns a signal (M, 8, k) at the nodes of the pieces."""
    time, samples = recording.time, recording[name]
    if len(begin) == 1 and begin[0] == end[0]:
        return np.tile(samples[-1], (1, len(_NODES), 1))
    times = _NodeTimes(begin, end)
    values = recording.Interpolate(name, times.ravel()).reshape(*times.shape, -1)
    # At a jump Interpolate() returns the value before it.
    i = _Intervals(time, begin, end)
    starts_there = begin == time[i]
    values[starts_there, 0] = samples[i[starts_there]]
    return values


def _Motion(
    recording: Recording, begin: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns p_WT and v_WT (M, 8, n) at the nodes of the pieces."""
    if "tool_acceleration" not in recording.signals or begin[0] == end[0]:
        p = _Sample(recording, "tool_position", begin, end)
        return p, _Sample(recording, "tool_velocity", begin, end)
    time = recording.time
    i = _Intervals(time, begin, end)
    h = (time[i + 1] - time[i])[:, None, None]
    s = ((_NodeTimes(begin, end) - time[i, None]) / h[:, 0])[:, :, None]
    p0, p1 = (recording["tool_position"][k][:, None] for k in (i, i + 1))
    v0, v1 = (recording["tool_velocity"][k][:, None] for k in (i, i + 1))
    a0, a1 = (recording["tool_acceleration"][k][:, None] for k in (i, i + 1))
    # In a very short step the difference of the positions is but rounding errors;
    # then the velocities and accelerations alone decide.
    distance = p1 - p0
    expected = h * (v0 + v1) / 2 + h**2 * (a0 - a1) / 12
    is_noise = np.abs(distance - expected) < 64 * np.spacing(np.abs(p0) + np.abs(p1))
    distance = np.where(is_noise, expected, distance)
    e = distance - h * v0 - h**2 * a0 / 2
    f = h * (v1 - v0 - h * a0)
    g = h**2 * (a1 - a0)
    c3 = 10 * e - 4 * f + g / 2
    c4 = -15 * e + 7 * f - g
    c5 = 6 * e - 3 * f + g / 2
    p = p0 + s * (h * v0 + s * (h**2 * a0 / 2 + s * (c3 + s * (c4 + s * c5))))
    v = v0 + s * (h * a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)) / h)
    # Exactly, so that neighbours agree on which side of a border they meet.
    ends_there = end == time[i + 1]
    p[ends_there, -1] = p1[ends_there, 0]
    return p, v


def _Crossings(
    begin: np.ndarray, end: np.ndarray, y: np.ndarray
) -> list[tuple[float, bool]]:
    """Returns when a signal (M, 8) crosses 0, and whether upwards."""
    is_above = y >= 0
    i, j = np.nonzero(is_above[:, :-1] != is_above[:, 1:])
    c = _TO_CHEBYSHEV @ y[i].T
    s = _Bisect(c, _NODES[j], _NODES[j + 1], is_above[i, j], num_steps=55)
    times = ((1 - s) * begin[i] + (1 + s) * end[i]) / 2
    return list(zip(times.tolist(), is_above[i, j + 1].tolist(), strict=True))


def _Bisect(
    c: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    is_positive_at_low: np.ndarray,
    num_steps: int,
) -> np.ndarray:
    """Returns where Chebyshev series c (d, K) change their sign, each in its bracket.

    Args:
        c: Coefficients of K series.
        low: (K,) Lower ends of the brackets.
        high: (K,) Upper ends of the brackets.
        is_positive_at_low: (K,) Whether the series is >= 0 at the lower end.
        num_steps: How often the brackets are halved.
    """
    for _ in range(num_steps):
        middle = (low + high) / 2
        is_low = (chebval(middle, c, tensor=False) >= 0) == is_positive_at_low
        low = np.where(is_low, middle, low)
        high = np.where(is_low, high, middle)
    return high


def _Trace(y: np.ndarray) -> np.ndarray:
    """Returns values of a signal (M, 8) between which it is monotonic.

    Returns:
        (M, 15): the values at the nodes and, between two of them, the extreme that
        lies there (or the former value again).
    """
    slope = y @ _DERIVATIVE.T
    i, j = np.nonzero(slope[:, :-1] * slope[:, 1:] < 0)
    c = _TO_CHEBYSHEV @ y[i].T
    # An extreme is flat: 26 steps make its value as exact as the numbers are.
    s = _Bisect(chebder(c), _NODES[j], _NODES[j + 1], slope[i, j] >= 0, num_steps=26)
    values = np.repeat(y, 2, axis=1)[:, :-1]
    values[i, 2 * j + 1] = chebval(s, c, tensor=False)
    return values


def _Max(y: np.ndarray, first: int, last: int) -> float:
    """Returns the maximum of a signal (M, 8) over pieces first to last - 1."""
    if first >= last:
        return _ValueBefore(y, first)
    return float(_Trace(y[first:last]).max())


def _ValueBefore(y: np.ndarray, i: int) -> float:
    """Returns the value of a signal (M, 8) at the end of the piece before piece i."""
    return float(y[i - 1, -1]) if i > 0 else float(y[0, 0])


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
        for time, exceeds in _Crossings(begin, end, direction * v_x - threshold)
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

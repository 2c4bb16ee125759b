"""Measures of recordings for the claims, beyond the metrics.

Times are in s, from the start of the run; signals are in SI units.
"""

import dataclasses
import math
from operator import attrgetter
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.model.blocks.environments import CONTACT
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.thesis.runs import Run

_ConstantsOf = attrgetter("stiffness", "damping")


def LargestJump(run: Run) -> float:
    """Returns the largest jump of the control force in N."""
    recording = run.recording
    F_c = recording["control_force"]
    is_jump = np.diff(recording.time) == 0
    jumps = np.abs(np.diff(F_c, axis=0))[is_jump]
    return float(jumps.max(initial=0.0))


def ImpactForces(recording: TaskRecording) -> list[float]:
    """Returns the largest force in N from each contact to the next one or the end."""
    surface = recording.FindSurface(CONTACT)
    assert surface is not None
    F = surface.Along(recording["environment_force"])
    begins = np.searchsorted(recording.time, recording.EventTimes("contact"))
    forces: list[float] = np.maximum.reduceat(F, begins).tolist()
    return forces


def During(recording: TaskRecording, begin: float, end: float) -> np.ndarray:
    """Returns a mask of the samples between two times."""
    return (recording.time >= begin) & (recording.time <= end)


def Amplitude(recording: TaskRecording, begin: float, end: float) -> Array:
    """Returns the largest |v - v_d| per axis between two times."""
    v = recording["tool_velocity"][During(recording, begin, end)]
    v_d = np.asarray(recording.teleoperation.surgeon.velocity)
    return np.abs(v - v_d).max(axis=0, initial=0.0)


def FirstEvent(recording: TaskRecording, name: str) -> float:
    """Returns the time of the first event of a name; infinity without one."""
    return min(recording.EventTimes(name), default=math.inf)


def RiseTime(recording: TaskRecording) -> float:
    """Returns the time in s at which v_x first reaches 90 % of v_d."""
    v_d = float(np.asarray(recording.teleoperation.surgeon.velocity)[0])
    is_fast = recording["tool_velocity"][:, 0] >= 0.9 * v_d
    return float(recording.time[is_fast].min(initial=math.inf))


def CommandedPath(recording: TaskRecording) -> Array:
    """Returns the commanded path of the tool, in m (T, n).

    It is the integral of the velocity command that the slave of direct force or of the
    adaptive controller receives, from the start of the tool on.
    """
    scenario = recording.teleoperation
    v_dd = recording["forward_packet_received"][:, scenario.num_axes :]
    way = cumulative_trapezoid(v_dd, recording.time, axis=0, initial=0)
    return np.asarray(scenario.robot.start + way)


def PathError(recording: TaskRecording) -> Array:
    """Returns the largest position error before the contact, relative to the way.

    The error is the difference from CommandedPath(). The way is the distance from the
    start to the bone.
    """
    surface = recording.FindSurface(CONTACT)
    assert surface is not None
    before = recording.time <= FirstEvent(recording, "contact")
    error = recording["tool_position"] - CommandedPath(recording)
    way = -float(surface.Depth(recording.teleoperation.robot.start))
    return np.asarray(np.abs(error[before]).max(axis=0)) / way


def ForceRate(recording: TaskRecording) -> Array:
    """Returns dF_e/dt along x in N/s (N,), from the materials; jumps are left out.

    Args:
        recording: A run in layers that begin one behind another, with the signals
            environment_layer and tool_acceleration.
    """
    materials = [surface.material for surface in recording.surfaces]
    index = recording["environment_layer"][:, 0].astype(int)
    # The last row is for the layer -1, which is none.
    constants = np.array([*map(_ConstantsOf, materials), (0.0, 0.0)])
    k, d = constants[index].T
    v = recording["tool_velocity"][:, 0]
    a = recording["tool_acceleration"][:, 0]
    return np.asarray(k * v + d * a)


def BasisFunctions(recording: TaskRecording, count: int | None = None) -> Array:
    """Returns the networks' basis functions Phi (T, N) at the samples of a run.

    Args:
        count: The number of functions per axis of another lattice with the same
            bounds; None: the lattice of the run.
    """
    config = recording.scenario.controller.network
    if count is not None:
        config = dataclasses.replace(config, count=[count] * len(config.count))
    network = config.MakeNetwork()
    return np.array([network.evaluate(u) for u in recording["tool_position"]])


def Rms(recording: TaskRecording, values: Array, since: float = 0.0) -> Any:
    """Returns the rms over time (...) of a signal (T, ...), from `since` on."""
    kept = recording.time >= since
    time = recording.time[kept]
    mean = np.trapezoid(values[kept] ** 2, time, axis=0) / np.ptp(time)
    return np.sqrt(mean)


def Late(recording: TaskRecording, values: Array) -> Array:
    """Returns the rms per axis of a signal (T, n) over the last quarter of a run."""
    return np.asarray(Rms(recording, values, since=0.75 * recording.time[-1]))


def UnlearnedShare(recording: TaskRecording) -> float:
    """Returns the rms of dF_e/dt - W3 Phi divided by the rms of dF_e/dt, along x."""
    rate = ForceRate(recording)
    Phi = BasisFunctions(recording)
    W3_x = recording["weights_3"][:, : Phi.shape[1]]
    estimate = np.einsum("tk,tk->t", W3_x, Phi)
    return float(Rms(recording, rate - estimate) / Rms(recording, rate))


def FarShare(recording: TaskRecording) -> float:
    """Returns the influence of centres more than two widths away, as a share.

    It is their share in the sum of |w_i phi_i| over all samples; of both networks, the
    larger share.
    """
    Phi = BasisFunctions(recording)
    is_far = Phi < math.exp(-4.0)
    shares = []
    for name in ("weights_1", "weights_3"):
        weights = recording[name].reshape(len(Phi), -1, Phi.shape[1])
        parts = np.abs(weights).sum(axis=1) * Phi
        shares.append(float(parts[is_far].sum() / parts.sum()))
    return max(shares)

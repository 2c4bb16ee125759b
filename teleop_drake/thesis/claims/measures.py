"""Measures of recordings for the claims, beyond the metrics.

Times are in s, from the start of the run; signals are in SI units.
"""

import dataclasses
import math

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.blocks.environments import CONTACT
from teleop_drake.recording import Recording
from teleop_drake.thesis.runs import Run


def LargestJump(run: Run) -> float:
    """Returns the largest jump of the control force in N."""
    recording = run.recording
    F_c = recording["control_force"]
    is_jump = np.diff(recording.time) == 0
    jumps = np.abs(np.diff(F_c, axis=0))[is_jump]
    return float(jumps.max(initial=0.0))


def ImpactForces(recording: Recording) -> list[float]:
    """Returns the largest force of each contact that begins and ends, and the last."""
    surface = recording.FindSurface(CONTACT)
    assert surface is not None
    time = recording.time
    F = surface.Along(recording["environment_force"])
    touches = surface.Depth(recording["tool_position"]) >= 0
    begins = np.flatnonzero(np.diff(touches.astype(int)) == 1) + 1
    ends = [*begins[1:], len(time)]
    return [float(F[i:j].max()) for i, j in zip(begins, ends, strict=True)]


def During(recording: Recording, begin: float, end: float) -> np.ndarray:
    """Returns which samples lie between two times."""
    return (recording.time >= begin) & (recording.time <= end)


def Amplitude(recording: Recording, begin: float, end: float) -> Array:
    """Returns the largest |v - v_d| per axis between two times."""
    v = recording["tool_velocity"][During(recording, begin, end)]
    v_d = np.asarray(recording.teleoperation.surgeon.velocity)
    return np.abs(v - v_d).max(axis=0, initial=0.0)


def FirstEvent(recording: Recording, name: str) -> float:
    """Returns when something first happened, infinity if it did not."""
    return min(recording.EventTimes(name), default=math.inf)


def RiseTime(recording: Recording) -> float:
    """Returns when v_x first reaches 90 % of v_d, in s."""
    v_d = float(np.asarray(recording.teleoperation.surgeon.velocity)[0])
    reached = np.flatnonzero(recording["tool_velocity"][:, 0] >= 0.9 * v_d)
    return float(recording.time[reached[0]]) if len(reached) else math.inf


def PathError(recording: Recording) -> Array:
    """Returns the largest position error before the contact, as a share of the way.

    The position asked for is where v_d leads from the start on as it arrives at the
    slave; the way is that from the start to the bone.
    """
    scenario = recording.teleoperation
    surface = recording.FindSurface(CONTACT)
    assert surface is not None
    before = recording.time <= FirstEvent(recording, "contact")
    arrived = np.maximum(recording.time[before] - scenario.forward_channel.delay, 0.0)
    asked = scenario.robot.start + np.outer(arrived, scenario.surgeon.velocity)
    error = np.abs(recording["tool_position"][before] - asked).max(axis=0)
    return np.asarray(error) / -float(surface.Depth(scenario.robot.start))


def ForceRate(recording: Recording) -> Array:
    """Returns dF_e/dt along x in N/s (N,), from the materials; jumps are left out.

    Args:
        recording: A run in layers that begin one behind another, with the signals
            environment_layer and tool_acceleration.
    """
    materials = [surface.material for surface in recording.surfaces]
    index = recording["environment_layer"][:, 0].astype(int)
    k, d = (
        np.array([*(getattr(material, name) for material in materials), 0.0])[index]
        for name in ("stiffness", "damping")
    )
    v = recording["tool_velocity"][:, 0]
    a = recording["tool_acceleration"][:, 0]
    return np.asarray(k * v + d * a)


def BasisFunctions(recording: Recording, count: int | None = None) -> Array:
    """Returns the networks' basis functions Phi (T, N) at the samples of a run.

    Args:
        count: Per axis, of another lattice with the same bounds; None: the run's.
    """
    config = recording.scenario.controller.network
    if count is not None:
        config = dataclasses.replace(config, count=[count] * len(config.count))
    network = config.MakeNetwork()
    return np.array([network.evaluate(u) for u in recording["tool_position"]])


def Rms(recording: Recording, values: Array) -> float:
    """Returns the rms over time of a signal (T,)."""
    mean = np.trapezoid(values**2, recording.time) / np.ptp(recording.time)
    return math.sqrt(float(mean))


def Late(recording: Recording, values: Array) -> Array:
    """Returns the rms per axis of a signal (T, n) over the last quarter of a run."""
    kept = recording.time >= 0.75 * recording.time[-1]
    last = dataclasses.replace(recording, time=recording.time[kept])
    return np.array([Rms(last, values[kept, i]) for i in range(values.shape[1])])


def UnlearnedShare(recording: Recording) -> float:
    """Returns the rms of dF_e/dt - W3 Phi over that of dF_e/dt, along x."""
    rate = ForceRate(recording)
    Phi = BasisFunctions(recording)
    W3_x = recording["weights_3"][:, : Phi.shape[1]]
    estimate = np.einsum("tk,tk->t", W3_x, Phi)
    return Rms(recording, rate - estimate) / Rms(recording, rate)


def FarShare(recording: Recording) -> float:
    """Returns how much centres more than two widths away say, as a share of all.

    The larger of both networks' shares of the sum of |w_i phi_i|, as means over the
    samples.
    """
    Phi = BasisFunctions(recording)
    is_far = Phi < math.exp(-4.0)
    shares = []
    for name in ("weights_1", "weights_3"):
        parts = np.abs(recording[name].reshape(len(Phi), -1, Phi.shape[1]))
        parts = parts * Phi[:, np.newaxis, :]
        far = np.where(is_far[:, np.newaxis, :], parts, 0.0).sum()
        shares.append(float(far / parts.sum()))
    return max(shares)

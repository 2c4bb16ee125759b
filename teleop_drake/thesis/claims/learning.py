"""The weights that the networks of chapters 4 and 5 learn, and the best ones."""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import GainMatrix
from teleop_drake.model.scenario import Scenario
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.thesis.claims.measures import (
    BasisFunctions,
    CommandedPath,
    ForceRate,
)

INSIDE = np.stack(
    np.meshgrid(np.linspace(0.87, 1.03, 5), np.linspace(0.02, 0.08, 3)), axis=-1
).reshape(-1, 2)
"""Positions in m (15, 2) inside the rectangle that two_dof_learning goes round."""


def PathDistance(recording: TaskRecording) -> Array:
    """Returns the distance of the tool from its commanded path, in m (T,)."""
    error = recording["tool_position"] - CommandedPath(recording)
    return np.linalg.norm(error, axis=1)


def UnrepresentedShare(
    recording: TaskRecording, num_speeds: int = 1, count: int | None = None
) -> float:
    """Returns the rms share of dF_e/dt along x that the best constant weights leave.

    These weights minimize the squared error over the whole run, in hindsight. No rule
    of adaptation finds constant weights that leave less of this run.

    Args:
        num_speeds: With 1, the basis functions are those of the run, which depend on
            the position. With more, each of them is multiplied by as many Gaussians of
            v_x, which are equidistant over the speeds of the run and as wide as their
            spacing.
        count: The number of basis functions per axis; None: the number of the run.
    """
    rate = ForceRate(recording)
    Phi = BasisFunctions(recording, count)
    if num_speeds > 1:
        v = recording["tool_velocity"][:, :1]
        centres, spacing = np.linspace(v.min(), v.max(), num_speeds, retstep=True)
        speeds = np.exp(-(((v - centres) / spacing) ** 2))
        Phi = np.einsum("ti,tj->tij", Phi, speeds).reshape(len(v), -1)
    # The square root of twice the trapezoidal rule's weight of each sample.
    root = np.sqrt(np.convolve(np.diff(recording.time), [1.0, 1.0]))
    A = root[:, np.newaxis] * Phi
    b = root * rate
    weights = np.linalg.lstsq(A, b, rcond=1e-6)[0]
    return float(np.linalg.norm(b - A @ weights) / np.linalg.norm(b))


def WeightDrift(scenario: Scenario, points: ArrayLike) -> Array:
    """Returns the contribution of gravity to ds/dt at points, in m/s^2 (M, n).

    It is (I + Lambda D_e) J M^-1 tau_g. A law without gravity compensation leaves it to
    its first network.

    Args:
        points: Positions of the tool in m (M, n).

    Raises:
        ScenarioError: If the robot does not reach a point.
    """
    n = scenario.num_axes
    Lambda = GainMatrix(scenario.controller.Lambda, n)
    D_e = scenario.Facts().Told("environment_damping", "environment")
    falls = []
    for p_WT in np.asarray(points, dtype=float).tolist():
        # The acceleration of a robot at rest at the point, on which only gravity acts.
        robot = dataclasses.replace(scenario.robot, start=p_WT).MakeRobot()
        context = robot.CreateDefaultContext()
        for name in ("control_force", "environment_force"):
            robot.GetInputPort(name).FixValue(context, np.zeros(n))
        falls.append(robot.GetOutputPort("tool_acceleration").Eval(context))
    return np.array(falls) @ (np.eye(n) + Lambda @ D_e).T


def UnlearnedWeight(recording: TaskRecording, points: ArrayLike, drift: Array) -> float:
    """Returns the rms share of WeightDrift() that the first network has not learned.

    The weights of the network are taken at the end of the run.

    Args:
        points: Positions of the tool in m (M, n).
        drift: WeightDrift() of the run's scenario at these points (M, n).
    """
    scenario = recording.teleoperation
    network = scenario.controller.network.MakeNetwork()
    weights = recording["weights_1"][-1].reshape(scenario.num_axes, -1)
    learned = np.array([weights @ network.evaluate(p) for p in np.asarray(points)])
    return math.sqrt(float(((learned - drift) ** 2).sum() / (drift**2).sum()))

"""Where the joints of a plant have to be for its tool to be at a point."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.solvers import Solve
from pydrake.systems.framework import Context

from teleop_drake.validation import Refuse

Array = NDArray[np.float64]

TOOL = "tool"
"""Name of the frame whose origin is T, which touches the environment."""

_TOLERANCE = 1e-6
"""How near to the point in m the tool has to come for the point to be reached."""

_MINIMUM_CONDITION = 0.01
"""Least ratio of the smallest to the largest singular value of the tool's Jacobian.
Assumed; the two-link arm's own limit, |sin(q2)| >= 0.05, is about the same."""

_NUM_GUESSES = 12
"""The first is the posture. The others lie around it, because a posture may be
singular, stretched for example, where nothing says which way to bend."""


def ToolJacobian(plant: MultibodyPlant, context: Context, num_axes: int) -> Array:
    """Returns Jv_v_WT along the task axes (n, nv).

    Args:
        plant: A plant with a frame TOOL.
        context: Its context.
        num_axes: n.
    """
    world = plant.world_frame()
    J = plant.CalcJacobianTranslationalVelocity(
        context,
        JacobianWrtVariable.kV,
        plant.GetFrameByName(TOOL),
        np.zeros(3),
        world,
        world,
    )
    return np.asarray(J[:num_axes])


def SolveInverseKinematics(
    plant: MultibodyPlant, p_WT: ArrayLike, posture: ArrayLike
) -> Array:
    """Returns the q with the tool at a point that is nearest to a posture.

    Within the limits of the joints, by Drake's InverseKinematics, then by Newton's
    method to the last digits.

    Args:
        plant: A finalized plant with a frame TOOL whose qdot is its velocity.
        p_WT: Position of the tool along the first n axes of the world, m (n).
        posture: q to be near (nq).

    Raises:
        ScenarioError: If the tool does not come there, with how near it comes, or if
            the plant is singular there. The message calls the point `start`.
    """
    p, posture = np.array(p_WT, dtype=float), np.array(posture, dtype=float)
    context = plant.CreateDefaultContext()
    for guess in _Guesses(posture):
        q, is_solved = _Solve(plant, p, posture, guess, nearest=False)
        if not is_solved:
            continue
        q = _Polish(plant, context, p, q)
        if np.linalg.norm(_ToolPosition(plant, context, q)[: p.size] - p) < _TOLERANCE:
            break
    else:
        distance = min(
            float(np.linalg.norm(_ToolPosition(plant, context, q)[: p.size] - p))
            for guess in _Guesses(posture)
            for q, _ in [_Solve(plant, p, posture, guess, nearest=True)]
        )
        Refuse(
            "start",
            p,
            f"in reach of the tool, which comes no nearer than {distance:.3g} m",
        )
    plant.SetPositions(context, q)
    values = np.linalg.svd(ToolJacobian(plant, context, p.size), compute_uv=False)
    if len(values) < p.size or not values[-1] > _MINIMUM_CONDITION * values[0]:
        smallest = values[-1] if len(values) == p.size else 0.0
        Refuse(
            "start",
            p,
            "away from singular poses (here the smallest singular value of the tool's "
            f"{p.size} x {plant.num_velocities()} Jacobian is {smallest:.3g}, the "
            f"largest {values[0]:.3g}, and the ratio must be > {_MINIMUM_CONDITION:g})",
        )
    return q


def _Guesses(posture: Array) -> list[Array]:
    rng = np.random.default_rng(0)
    scales = np.linspace(0.0, 2.0, _NUM_GUESSES)
    return [posture + scale * rng.uniform(-1, 1, posture.shape) for scale in scales]


def _Solve(
    plant: MultibodyPlant, p: Array, posture: Array, guess: Array, *, nearest: bool
) -> tuple[Array, bool]:
    """Returns the solver's q, and whether it calls that a solution.

    Args:
        plant: The plant.
        p: The point (n).
        posture: What q is to be near.
        guess: Where to begin.
        nearest: Whether to come as near to the point as possible, instead of to it.
    """
    problem = InverseKinematics(plant)
    tool, world, origin = plant.GetFrameByName(TOOL), plant.world_frame(), np.zeros(3)
    point = np.append(p, np.zeros(3 - p.size))
    if nearest:
        C = np.diag([1.0] * p.size + [0.0] * (3 - p.size))
        problem.AddPositionCost(world, point, tool, origin, C)
    else:
        free = np.append(np.zeros(p.size), np.full(3 - p.size, np.inf))
        problem.AddPositionConstraint(tool, origin, world, point - free, point + free)
        problem.get_mutable_prog().AddQuadraticErrorCost(
            np.eye(posture.size), posture, problem.q()
        )
    problem.get_mutable_prog().SetInitialGuess(problem.q(), guess)
    result = Solve(problem.prog())
    return np.array(result.GetSolution(problem.q())), result.is_success()


def _ToolPosition(plant: MultibodyPlant, context: Context, q: Array) -> Array:
    plant.SetPositions(context, q)
    frame = plant.GetFrameByName(TOOL)
    return np.array(frame.CalcPoseInWorld(context).translation())


def _Polish(plant: MultibodyPlant, context: Context, p: Array, q: Array) -> Array:
    for _ in range(3):
        error = p - _ToolPosition(plant, context, q)[: p.size]
        q = q + np.linalg.pinv(ToolJacobian(plant, context, p.size)) @ error
    return q

"""Inverse kinematics: joint positions that put the tool at a point."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.math import RotationMatrix
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

_MOST_STEPS, _LONGEST_STEP, _SHORTEST_STEP = 60, 0.3, 1e-15
"""Of Newton's method where a rotation is asked for, and how far one goes, rad or m."""

_NUM_GUESSES = 12
"""The first is the posture. The others lie around it, because a posture may be
singular, stretched for example, where nothing says which way to bend."""


def ToolJacobian(plant: MultibodyPlant, context: Context, num_axes: int) -> Array:
    """Returns Jv_v_WT along the task axes (n, nv)."""
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


def ToolRotation(plant: MultibodyPlant, q: ArrayLike) -> Array:
    """Returns R_WT (3, 3)."""
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    pose = plant.GetFrameByName(TOOL).CalcPoseInWorld(context)
    return np.array(pose.rotation().matrix())


def SolveInverseKinematics(
    plant: MultibodyPlant,
    p_WT: ArrayLike,
    posture: ArrayLike,
    R_WT: Array | None = None,
) -> Array:
    """Returns the q with the tool at a point that is nearest to a posture.

    Within the limits of the joints, by Drake's InverseKinematics, then by Newton's
    method to the last digits. With a rotation, Newton's method goes on from there.

    Args:
        plant: A finalized plant with a frame TOOL whose qdot is its velocity.
        p_WT: Position of the tool along the first n axes of the world, m (n).
        posture: q to be near (nq).
        R_WT: Rotation that the tool has to have (3, 3); None: any.

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
        q = _Polish(plant, context, p, R_WT, q)
        if _IsThere(plant, context, p, R_WT, q):
            break
    else:
        distance = min(
            float(np.linalg.norm(_ToolPosition(plant, context, q)[: p.size] - p))
            for guess in _Guesses(posture)
            for q, _ in [_Solve(plant, p, posture, guess, nearest=True)]
        )
        if distance < _TOLERANCE:
            Refuse("start", p, "in reach of the tool as it is turned at the posture")
        Refuse(
            "start",
            p,
            f"in reach of the tool, which comes no nearer than {distance:.3g} m",
        )
    plant.SetPositions(context, q)
    J = _Jacobian(plant, context, p.size, R_WT)
    values = np.linalg.svd(J, compute_uv=False)
    if len(values) < len(J) or not values[-1] > _MINIMUM_CONDITION * values[0]:
        smallest = values[-1] if len(values) == len(J) else 0.0
        Refuse(
            "start",
            p,
            "away from singular poses (here the smallest singular value of the tool's "
            f"{len(J)} x {plant.num_velocities()} Jacobian is {smallest:.3g}, the "
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
        p: The point (n).
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


def _Jacobian(
    plant: MultibodyPlant, context: Context, num_axes: int, R_WT: Array | None
) -> Array:
    """Returns ToolJacobian(), and below it that of w_WT where a rotation is asked."""
    J = ToolJacobian(plant, context, num_axes)
    if R_WT is None:
        return J
    world = plant.world_frame()
    Jw = plant.CalcJacobianAngularVelocity(
        context, JacobianWrtVariable.kV, plant.GetFrameByName(TOOL), world, world
    )
    return np.vstack([J, Jw])


def _Error(
    plant: MultibodyPlant, context: Context, p: Array, R_WT: Array | None, q: Array
) -> Array:
    """Returns what is missing to the point in m, and to the rotation in rad."""
    error: Array = p - _ToolPosition(plant, context, q)[: p.size]
    if R_WT is None:
        return error
    frame = plant.GetFrameByName(TOOL)
    R = frame.CalcPoseInWorld(context).rotation().matrix()
    turn = RotationMatrix(R_WT @ R.T).ToAngleAxis()
    return np.append(error, turn.angle() * turn.axis())


def _IsThere(
    plant: MultibodyPlant, context: Context, p: Array, R_WT: Array | None, q: Array
) -> bool:
    error = _Error(plant, context, p, R_WT, q)
    lower, upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    is_within = bool(((lower <= q) & (q <= upper)).all()) or R_WT is None
    return is_within and bool(np.linalg.norm(error) < _TOLERANCE)


def _Polish(
    plant: MultibodyPlant, context: Context, p: Array, R_WT: Array | None, q: Array
) -> Array:
    for _ in range(3 if R_WT is None else _MOST_STEPS):
        error = _Error(plant, context, p, R_WT, q)
        step = np.linalg.pinv(_Jacobian(plant, context, p.size, R_WT)) @ error
        longest = float(np.abs(step).max())
        if R_WT is not None and longest > _LONGEST_STEP:
            step *= _LONGEST_STEP / longest
        q = q + step
        if longest < _SHORTEST_STEP:
            break
    return q

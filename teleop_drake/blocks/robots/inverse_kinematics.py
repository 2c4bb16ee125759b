"""Inverse kinematics: joint positions that put the tool at a point."""

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.solvers import Solve
from pydrake.systems.framework import Context

from teleop_drake.arrays import Array, ArrayLike
from teleop_drake.blocks.systems.tool_interface import SpatialJacobian
from teleop_drake.validation import Refuse

TOOL = "tool"
"""Name of the frame whose origin is T, which touches the environment."""

_TOLERANCE = 1e-6
"""How near to the point in m the tool has to come for the point to be reached."""

_MINIMUM_CONDITION = 0.01
"""Least ratio of the smallest to the largest singular value of the tool's Jacobian.
Assumed; the two-link arm's own limit, |sin(q2)| >= 0.05, is about the same."""

# Newton's method for a rotation: most steps, and how far one goes, rad or m.
_MOST_STEPS = 60
_LONGEST_STEP = 0.3
_SHORTEST_STEP = 1e-15

_NUM_GUESSES = 12
"""The first is the posture. The others lie around it, because a posture may be
singular, stretched for example, where nothing says which way to bend."""


def ToolJacobian(plant: MultibodyPlant, context: Context, num_axes: int) -> Array:
    """Returns Jv_v_WT along the task axes, and Jw_WT with six of them (n, nv)."""
    J = SpatialJacobian(plant, context, plant.GetFrameByName(TOOL))
    return np.concatenate([J[3:], J[:3]])[:num_axes]


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
    target = _Target(plant, np.array(p_WT, dtype=float), R_WT)
    p = target.p
    posture = np.array(posture, dtype=float)
    rng = np.random.default_rng(0)
    guesses = [
        posture + scale * rng.uniform(-1, 1, posture.shape)
        for scale in np.linspace(0.0, 2.0, _NUM_GUESSES)
    ]
    q = target.Nearest(posture, guesses)
    if q is None:
        target.RefuseUnreachable(guesses)
    J = target.Jacobian(q)
    values = np.linalg.svd(J, compute_uv=False)
    smallest = values[-1] if len(values) == len(J) else 0.0
    if not smallest > _MINIMUM_CONDITION * values[0]:
        allowed = (
            "away from singular poses (here the smallest singular value of the tool's "
            f"{len(J)} x {plant.num_velocities()} Jacobian is {smallest:.3g}, the "
            f"largest {values[0]:.3g}, and the ratio must be > {_MINIMUM_CONDITION:g})"
        )
        Refuse("start", p, allowed)
    return q


class _Target:
    """A point, and maybe a rotation, that the tool of a plant has to have."""

    def __init__(self, plant: MultibodyPlant, p: Array, R: Array | None):
        self.p = p
        self._plant = plant
        self._R = R
        self._context = plant.CreateDefaultContext()
        self._tool = plant.GetFrameByName(TOOL)

    def Nearest(self, posture: Array, guesses: Sequence[Array]) -> Array | None:
        """Returns the q with the tool at the target that is nearest to a posture.

        Returns:
            That of the first guess from which there is one; None if there is none.
        """
        for guess in guesses:
            q, is_solved = self.Solve(posture, guess)
            if not is_solved:
                continue
            q = self.Polish(q)
            if self.IsReached(q):
                return q
        return None

    def RefuseUnreachable(self, guesses: Sequence[Array]) -> NoReturn:
        """Refuses the point, and tells how near the tool comes."""
        found = [self.Solve(None, guess)[0] for guess in guesses]
        distances = [np.linalg.norm(self.Error(q)[: self.p.size]) for q in found]
        distance = min(distances)
        allowed = f"in reach of the tool, which comes no nearer than {distance:.3g} m"
        if distance < _TOLERANCE:
            allowed = "in reach of the tool as it is turned at the posture"
        Refuse("start", self.p, allowed)

    def Solve(self, posture: Array | None, guess: Array) -> tuple[Array, bool]:
        """Returns the solver's q with the tool at the point, near a posture.

        Without a posture it is the q with the tool as near to the point as possible.
        Also told is whether the solver calls it a solution.
        """
        # Few robots need it, and it imports all of Drake's planning.
        from pydrake.multibody.inverse_kinematics import InverseKinematics

        problem = InverseKinematics(self._plant)
        program = problem.get_mutable_prog()
        world = self._plant.world_frame()
        n = self.p.size
        origin = np.zeros(3)
        point = np.append(self.p, np.zeros(3 - n))
        if posture is None:
            C = np.diag([1.0] * n + [0.0] * (3 - n))
            problem.AddPositionCost(world, point, self._tool, origin, C)
        else:
            free = np.append(np.zeros(n), np.full(3 - n, np.inf))
            problem.AddPositionConstraint(
                self._tool, origin, world, point - free, point + free
            )
            program.AddQuadraticErrorCost(np.eye(posture.size), posture, problem.q())
        program.SetInitialGuess(problem.q(), guess)
        result = Solve(program)
        return np.array(result.GetSolution(problem.q())), result.is_success()

    def Jacobian(self, q: Array) -> Array:
        """Returns ToolJacobian(), and below it that of w_WT if a rotation is asked."""
        self._plant.SetPositions(self._context, q)
        J = SpatialJacobian(self._plant, self._context, self._tool)
        Jv = J[3 : 3 + self.p.size]
        return Jv if self._R is None else np.vstack([Jv, J[:3]])

    def Error(self, q: Array) -> Array:
        """Returns what is missing to the point in m, and to the rotation in rad."""
        self._plant.SetPositions(self._context, q)
        pose = self._tool.CalcPoseInWorld(self._context)
        error: Array = self.p - pose.translation()[: self.p.size]
        if self._R is None:
            return error
        turn = RotationMatrix(self._R @ pose.rotation().matrix().T).ToAngleAxis()
        return np.append(error, turn.angle() * turn.axis())

    def IsReached(self, q: Array) -> bool:
        """Returns whether the tool is there, and the joints are within their limits."""
        lower = self._plant.GetPositionLowerLimits()
        upper = self._plant.GetPositionUpperLimits()
        # Without a rotation the solver has seen to the limits.
        is_within = self._R is None or bool(((lower <= q) & (q <= upper)).all())
        return is_within and bool(np.linalg.norm(self.Error(q)) < _TOLERANCE)

    def Polish(self, q: Array) -> Array:
        """Returns q after some steps of Newton's method."""
        num_steps = 3 if self._R is None else _MOST_STEPS
        for _ in range(num_steps):
            step = np.linalg.pinv(self.Jacobian(q)) @ self.Error(q)
            longest = float(np.abs(step).max())
            if self._R is not None and longest > _LONGEST_STEP:
                step *= _LONGEST_STEP / longest
            q = q + step
            if longest < _SHORTEST_STEP:
                break
        return q

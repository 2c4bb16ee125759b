"""Inverse kinematics: joint positions that put the tool at a point."""

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.solvers import Solve
from pydrake.systems.framework import Context

from teleop_drake.loops.engine.plant_tree import SpatialJacobian
from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.model.laws.task_space import rotation_vector

TOOL = "tool"
"""Name of the frame whose origin is T, which touches the environment."""

_TOLERANCE = 1e-6
"""Largest distance in m of the tool from a point that counts as reached."""

_FIXED = 1e-9
"""Largest motion in m of the tool per rad or m of the joints that counts as none."""

_MINIMUM_CONDITION = 0.01
"""Smallest allowed ratio of the smallest to the largest singular value of the tool's
Jacobian. Assumed; the limit of the two-link arm, |sin(q2)| >= 0.05, is about the
same."""

# Newton's method: largest number of steps, longest step, and step at which it ends, rad
# or m.
_MOST_STEPS = 60
_LONGEST_STEP = 0.3
_SHORTEST_STEP = 1e-13

_NUM_GUESSES = 12
"""Number of initial guesses. The first is the posture, and the others lie around it. If
the posture is singular, for example stretched, it does not determine in which direction
the joints bend."""


def ToolJacobian(plant: MultibodyPlant, context: Context, num_axes: int) -> Array:
    """Returns Jv_v_WT along the task axes, with Jw_WT below it for n = 6 (n, nv)."""
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
    """Returns the q nearest to a posture with the tool at a point.

    Drake's InverseKinematics finds it within the limits of the joints. Newton's method
    then refines it to the last digits. If a rotation is required, Newton's method also
    turns the tool, beginning from the q for the point.

    Args:
        plant: A finalized plant with a frame TOOL, whose velocities are qdot.
        p_WT: Position of the tool along the first n axes of the world, m (n).
        posture: The q to which the result is near (nq).
        R_WT: Required rotation of the tool (3, 3); None: any.

    Raises:
        ScenarioError: If the tool cannot reach the point; the message has the smallest
            distance of the tool from it. Also if the plant is singular there. The
            message calls the point `start`.
    """
    posture = np.array(posture, dtype=float)
    target = _Target(plant, np.array(p_WT, dtype=float), R_WT, posture)
    rng = np.random.default_rng(0)
    guesses = [
        posture + scale * rng.uniform(-1, 1, posture.shape)
        for scale in np.linspace(0.0, 2.0, _NUM_GUESSES)
    ]
    target.RefuseFixed(guesses)
    found = (target.Solve(guess) for guess in guesses)
    q = next((q for q in found if q is not None), None)
    if q is None:
        target.RefuseUnreachable(guesses)
    target.RefuseSingular(q)
    return q


class _Target:
    """A position, and optionally a rotation, that the tool of a plant has to reach."""

    def __init__(
        self, plant: MultibodyPlant, p: Array, R: Array | None, posture: Array
    ):
        self._plant = plant
        self._p = p
        self._R = R
        self._posture = posture
        self._context = plant.CreateDefaultContext()
        self._tool = plant.GetFrameByName(TOOL)

    def At(self, q: Array) -> tuple[Array, Array]:
        """Returns the error of the tool's pose at q, and the tool's Jacobian.

        The error is in m. If a rotation is required, the rotation vector from the
        tool's rotation to the required one follows, in rad. The Jacobian has the rows
        of Jv_v_WT along the task axes, and then those of Jw_WT if a rotation is
        required.
        """
        self._plant.SetPositions(self._context, q)
        n = self._p.size
        pose = self._tool.CalcPoseInWorld(self._context)
        J = SpatialJacobian(self._plant, self._context, self._tool)
        Jv = J[3 : 3 + n]
        error: Array = self._p - pose.translation()[:n]
        if self._R is None:
            return error, Jv
        turn = rotation_vector(self._R @ pose.rotation().matrix().T)
        return np.append(error, turn), np.vstack([Jv, J[:3]])

    def Solve(self, guess: Array) -> Array | None:
        """Returns the q nearest to the posture with the tool at the target.

        None: no such q is found from this guess.
        """
        q, is_solved = self._NearPoint(guess, must_reach=True)
        if not is_solved:
            return None
        for _ in range(_MOST_STEPS):
            error, J = self.At(q)
            step = np.linalg.pinv(J) @ error
            longest = float(np.abs(step).max())
            q = q + step * (_LONGEST_STEP / max(longest, _LONGEST_STEP))
            if longest < _SHORTEST_STEP:
                break
        lower = self._plant.GetPositionLowerLimits()
        upper = self._plant.GetPositionUpperLimits()
        # Without a rotation, the solver has enforced the limits.
        is_within = self._R is None or ((lower <= q) & (q <= upper)).all()
        is_there = np.linalg.norm(self.At(q)[0]) < _TOLERANCE
        return q if is_within and is_there else None

    def _NearPoint(self, guess: Array, *, must_reach: bool) -> tuple[Array, bool]:
        """Returns the q that the solver finds, and whether it reports success.

        Args:
            guess: The initial guess of q (nq).
            must_reach: Whether the tool has to be at the point; q is then nearest to
                the posture. Otherwise the tool is as near to the point as possible.
        """
        # Few robots need it, and it imports all of Drake's planning.
        from pydrake.multibody.inverse_kinematics import InverseKinematics

        problem = InverseKinematics(self._plant)
        program = problem.get_mutable_prog()
        world = self._plant.world_frame()
        origin = np.zeros(3)
        is_free = np.arange(3) >= self._p.size
        point = np.append(self._p, origin)[:3]
        if must_reach:
            slack = np.where(is_free, np.inf, 0.0)
            problem.AddPositionConstraint(
                self._tool, origin, world, point - slack, point + slack
            )
            program.AddQuadraticErrorCost(
                np.eye(guess.size), self._posture, problem.q()
            )
        else:
            weights = np.diag(np.where(is_free, 0.0, 1.0))
            problem.AddPositionCost(world, point, self._tool, origin, weights)
        program.SetInitialGuess(problem.q(), guess)
        result = Solve(program)
        return np.array(result.GetSolution(problem.q())), result.is_success()

    def RefuseFixed(self, guesses: Sequence[Array]) -> None:
        """Refuses a tool that no joint moves along one of the task axes."""
        n = self._p.size
        rows = [self.At(guess)[1][:n] for guess in guesses]
        reach = np.abs(rows).max(axis=(0, 2), initial=0.0)
        fixed = [axis for axis, r in zip("xyz", reach, strict=False) if r < _FIXED]
        if not fixed:
            return
        allowed = "of a tool that moves: the tool does not move with any joint"
        if len(fixed) < n:
            others = ", ".join(axis for axis in "xyz"[:n] if axis not in fixed)
            allowed = (
                f"along axes in which a joint moves the tool, here {others} only; "
                "`base` of an arm turns it"
            )
        Refuse("start", self._p, allowed)

    def RefuseUnreachable(self, guesses: Sequence[Array]) -> NoReturn:
        """Refuses the point; the message has the smallest distance of the tool."""
        found = [self._NearPoint(guess, must_reach=False)[0] for guess in guesses]
        n = self._p.size
        distance = min(np.linalg.norm(self.At(q)[0][:n]) for q in found)
        allowed = f"in reach of the tool, which comes no nearer than {distance:.3g} m"
        if distance < _TOLERANCE:
            allowed = "in reach of the tool as it is turned at the posture"
        Refuse("start", self._p, allowed)

    def RefuseSingular(self, q: Array) -> None:
        """Refuses a q near a singular pose of the tool's Jacobian."""
        J = self.At(q)[1]
        values = np.linalg.svd(J, compute_uv=False)
        smallest = values[-1] if len(values) == len(J) else 0.0
        if smallest > _MINIMUM_CONDITION * values[0]:
            return
        Refuse(
            "start",
            self._p,
            "away from singular poses (here the smallest singular value of the tool's "
            f"{len(J)} x {J.shape[1]} Jacobian is {smallest:.3g}, the largest "
            f"{values[0]:.3g}, and the ratio must be > {_MINIMUM_CONDITION:g})",
        )

"""Operators whose velocity command is a function of time, planned beforehand."""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from teleop_drake.loops.delays.base import SHORTEST_TIME
from teleop_drake.loops.framework.arrays import Array, ArrayLike, Interval
from teleop_drake.loops.framework.validation import (
    CheckVector,
    Config,
    Number,
    Range,
    Refuse,
)
from teleop_drake.loops.kernel import Term, Transition
from teleop_drake.model.blocks.environments import Surface
from teleop_drake.model.blocks.operators.base import ModalOperator, OperatorConfig
from teleop_drake.model.kinds import NumberNames
from teleop_drake.model.laws.piecewise_polynomial import (
    differentiate_pieces,
    evaluate_pieces,
    largest_norm,
    linear_pieces,
    minimum_jerk_pieces,
)

MAX_FREQUENCY = 1000.0
"""Highest frequency of a sine in rad/s."""

# Least number of solver steps in a period of a sine.
_STEPS_PER_PERIOD = 20

# The shortest distance between two waypoints, as a share of the longest one.
_SHORTEST_WAY = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A velocity as a function of time, and the steps that it requires of a solver.

    Attributes:
        velocity: The kernel term of v_d in m/s (n); see kernel.
        parameters: The parameters of the term.
        jump_times: The times at which v_d is not smooth, s; short steps follow.
        ends: The times at which steps have to end, each entry as (first, period) in s;
            an infinite period means once.
        longest_step: The longest step that the solver may take, s.
        notes: What a recording should tell of it, such as what was read from a file.
    """

    velocity: Term
    parameters: Mapping[str, Any]
    jump_times: Sequence[float] = ()
    ends: Sequence[Interval] = ()
    longest_step: float = math.inf
    notes: Sequence[str] = ()


def PlanOfPieces(
    breaks: Array,
    coefficients: Array,
    bends: Sequence[float] = (),
    ends: Sequence[Interval] | None = None,
    longest_step: float = math.inf,
    notes: Sequence[str] = (),
) -> Plan:
    """Returns the plan of a velocity that is a piecewise polynomial of time.

        v_d(t) = sum_i coefficients[k, i] (t - breaks[k])^i
                                             for breaks[k] <= t < breaks[k + 1]
               = 0                           before and after

    Args:
        breaks: (K + 1,) in s, ascending; the last one may be infinite.
        coefficients: (K, d + 1, n) in m/s, m/s^2 and so on.
        bends: The times at which v_d is not smooth, s; short steps follow.
        ends: The times at which steps have to end; see Plan. None: at the bends.
        longest_step: The longest step that the solver may take, s.
        notes: What a recording should tell of it.

    Raises:
        ScenarioError: If a value is not allowed.
    """
    if not ((breaks[1:] > breaks[:-1]).all() and np.isfinite(coefficients).all()):
        Refuse("breaks", breaks, "ascending, with finite coefficients")
    if ends is None:
        ends = [(time, math.inf) for time in bends]
    return Plan(
        velocity=(evaluate_pieces, "time", "breaks", "coefficients"),
        parameters={"breaks": breaks, "coefficients": coefficients},
        jump_times=bends,
        ends=ends,
        longest_step=longest_step,
        notes=notes,
    )


class PlannedOperator(ModalOperator):
    """Commands a velocity that depends on time only.

    Ports, state, modes, initial value and feedthrough are those of ModalOperator.

    It reacts neither to forces nor to the tool's motion before contact.

    Args:
        plan: The velocity.
        num_axes: n.
        contact_force: Force after contact in N (n); None: contact is never perceived.
        contact_surface: The surface at which contact is perceived; None: never.
        stop_time: The time of the stop in s; None: never.
    """

    def __init__(
        self,
        plan: Plan,
        num_axes: int,
        *,
        contact_force: ArrayLike | None = None,
        contact_surface: Surface | None = None,
        stop_time: float | None = None,
    ):
        ends = {
            f"end_{i}": Transition(mode="mode", offset=first, period=period)
            for i, (first, period) in enumerate(plan.ends)
        }
        ModalOperator.__init__(
            self,
            num_axes,
            plan.velocity,
            plan.parameters,
            transitions=ends,
            contact_force=contact_force,
            contact_surface=contact_surface,
            stop_time=stop_time,
        )
        self.jump_times = [*plan.jump_times, *self.jump_times]
        self.longest_step = plan.longest_step
        self._plan = plan

    def RunNotes(self, time: Array, signals: Mapping[str, Array]) -> list[str]:
        """Returns the notes of the plan, and whether a run has missed all of it."""
        breaks = self._plan.parameters.get("breaks")
        notes = [f"{self.get_name()}: {note}" for note in self._plan.notes]
        if breaks is None or (breaks[0] < time[-1] and breaks[-1] > time[0]):
            return notes
        missed = (
            f"{self.get_name()}: nothing of its velocity, from {breaks[0]:g} to "
            f"{breaks[-1]:g} s, falls into the run, {time[0]:g} to {time[-1]:g} s"
        )
        return [*notes, missed]


class ConstantVelocityOperator(PlannedOperator):
    """Commands a velocity until contact is felt, then a constant force (section 2.5).

        mode 0, velocity: v_d = velocity, F_h = force of the haptic device
        mode 1, force:    v_d = 0,        F_h = contact_force
        mode 2, stopped:  v_d = 0,        F_h = 0 if contact was perceived, otherwise
                                          the force of the haptic device, which brakes
                                          the tool

    Ports, state, initial value and feedthrough are those of ModalOperator.

    It does not react to forces and does not model fatigue. The force remains when the
    tool bounces off.

    | parameter | name          | unit |
    |-----------|---------------|------|
    | 0         | velocity      | m/s  |
    | 1         | contact_force | N    |

    Args:
        velocity: v_d in m/s (n).
        contact_force: Force after contact in N (n); None: contact is never perceived.
        contact_surface: The surface at which contact is perceived; None: never.
        stop_time: The time of the stop in s; None: never.

    Raises:
        ValueError: If a size or value is not allowed.
    """

    has_constant_command = True

    numeric_parameters: ClassVar = {
        "velocity": Range("m/s"),
        "contact_force": Range("N"),
    }

    def __init__(
        self,
        velocity: ArrayLike,
        *,
        contact_force: ArrayLike | None = None,
        contact_surface: Surface | None = None,
        stop_time: float | None = None,
    ):
        v_d = np.array(velocity, dtype=float)
        CheckVector("velocity", v_d, v_d.size, "m/s")
        PlannedOperator.__init__(
            self,
            Plan(velocity="velocity", parameters={"velocity": v_d}),
            v_d.size,
            contact_force=contact_force,
            contact_surface=contact_surface,
            stop_time=stop_time,
        )


@Config
class ConstantVelocityConfig(OperatorConfig):
    """v_d = velocity until contact is perceived (thesis section 2.5)."""

    kind = "constant_velocity"

    def MakeOperator(
        self, *, start: ArrayLike, contact_surface: Surface | None = None
    ) -> ConstantVelocityOperator:
        """Makes the block; see OperatorConfig.MakeOperator."""
        return ConstantVelocityOperator(
            velocity=self.velocity, **self.Modes(contact_surface)
        )

    def Numbers(self) -> NumberNames:
        """Returns the names of fields in the Contexts of blocks; see KindConfig."""
        names = (
            ["velocity"]
            if self.contact_force is None
            else ["velocity", "contact_force"]
        )
        return {name: (name,) for name in names}


class PlannedConfig(OperatorConfig):
    """Base of the operators whose velocity is a function of time."""

    @abstractmethod
    def MakePlan(self) -> Plan:
        """Returns the velocity as a function of time.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """

    def MakeOperator(
        self, *, start: ArrayLike, contact_surface: Surface | None = None
    ) -> PlannedOperator:
        """Makes the block; see OperatorConfig.MakeOperator."""
        n = np.size(self.velocity)
        return PlannedOperator(
            plan=self.MakePlan(), num_axes=n, **self.Modes(contact_surface)
        )

    def LongestStep(self) -> float:
        """Returns the longest step in s that the solver may take, or infinity."""
        return self.MakePlan().longest_step


@Config
class TrapezoidConfig(PlannedConfig):
    """v_d = s(t) velocity, where s rises from 0 to 1, stays, and falls back to 0."""

    kind = "trapezoid"

    # Duration of the rise, and of the fall, s, >= SHORTEST_TIME. Assumed.
    rise_time: float = Number(0.5, "s", minimum=SHORTEST_TIME)
    # Time for which v_d stays at `velocity`, s, >= 0; null: v_d does not fall.
    cruise_time: float | None = Number(None, "s", minimum=0)

    def MakePlan(self) -> Plan:
        """Returns the plan with straight lines between the corners."""
        rise = self.rise_time
        fall = rise + (math.inf if self.cruise_time is None else self.cruise_time)
        times = np.array([0.0, rise, fall, fall + rise])
        corners = np.outer([0.0, 1.0, 1.0, 0.0], self.velocity)
        # A cruise time of 0 or infinity leaves corners at equal times.
        is_later = np.append(True, times[1:] > times[:-1])
        breaks, coefficients = linear_pieces(times[is_later], corners[is_later])
        bends = breaks[1:][np.isfinite(breaks[1:])].tolist()
        return PlanOfPieces(breaks, coefficients, bends)


@Config
class SineConfig(PlannedConfig):
    """v_d = velocity sin(frequency t): to and fro, from rest."""

    kind = "sine"

    # Angular frequency, rad/s, > 0 to MAX_FREQUENCY. Assumed.
    frequency: float = Number(1.0, "rad/s", above=0, maximum=MAX_FREQUENCY)

    def MakePlan(self) -> Plan:
        """Returns the plan of the sine."""
        v_d = np.asarray(self.velocity, dtype=float)
        w = float(self.frequency)
        return Plan(
            velocity=(swinging_velocity, "time", "velocity", "frequency"),
            parameters={"velocity": v_d, "frequency": w},
            longest_step=2 * math.pi / w / _STEPS_PER_PERIOD,
        )


def swinging_velocity(time: float, velocity: Array, frequency: float) -> Array:
    """Returns velocity sin(frequency t) in m/s (n)."""
    swinging: Array = velocity * np.sin(frequency * time)
    return swinging


@Config
class MinimumJerkConfig(PlannedConfig):
    """v_d is the velocity of a minimum-jerk path (Flash and Hogan 1985).

    The path leads through waypoints. It begins and ends at rest and does not stop in
    between. The duration of each piece is proportional to its length, and the largest
    speed is |velocity|. The direction of `velocity` has no effect if there are
    waypoints. Without waypoints the path leads along it.
    """

    kind = "minimum_jerk"

    # Positions relative to the start, m, n entries each; consecutive waypoints differ.
    # Empty: one waypoint, the displacement of `velocity` in `reach_time`. With six axes
    # the last three entries are a rotation vector, rad; all turn about one axis.
    waypoints: list[list[float]] = field(default_factory=list)
    # Sets the waypoint if none is given, s, > 0; see above. Assumed.
    reach_time: float = Number(1.0, "s", above=0)

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field; see OperatorConfig.Check."""
        super().Check(path, num_axes)
        for i, point in enumerate(self.waypoints):
            CheckVector(f"{path}.waypoints.{i}", point, num_axes, "m")
        # SciPy's polynomials fail if the lengths of the pieces differ too much.
        points = np.array([[0.0] * num_axes, *self.waypoints])
        ways = np.abs(np.diff(points, axis=0)).max(axis=1)
        for i, way in enumerate(ways):
            if not way > _SHORTEST_WAY * ways.max():
                name = "waypoint before" if i else "start"
                Refuse(
                    f"{path}.waypoints.{i}",
                    self.waypoints[i],
                    f"another point than the {name}, farther than {_SHORTEST_WAY:g} of "
                    "the longest way from it",
                )
        # v_d is the derivative of the rotation vector. It is the angular velocity only
        # if all rotations are about one axis.
        turns = np.array([point[3:] for point in self.waypoints])
        if turns.size and np.linalg.matrix_rank(turns) > 1:
            Refuse(f"{path}.waypoints", self.waypoints, "turned about one axis")

    def MakePlan(self) -> Plan:
        """Returns the plan of the path's velocity."""
        breaks, position = self.Path()
        return PlanOfPieces(breaks, differentiate_pieces(position), [float(breaks[-1])])

    def Path(self) -> tuple[Array, Array]:
        """Returns the path p_d - start: breaks (K + 1) in s, coefficients (K, 6, n)."""
        velocity = np.asarray(self.velocity, dtype=float)
        speed = float(np.linalg.norm(velocity))
        ends: list[ArrayLike] = [*self.waypoints] or [velocity * self.reach_time]
        points = np.array([0 * velocity, *ends])
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        times = np.concatenate([[0.0], np.cumsum(lengths)]) / speed
        breaks, position = minimum_jerk_pieces(times, points)
        # The shape of the path does not depend on its speed. Scaling time makes the
        # largest speed |velocity|.
        stretch = largest_norm(breaks, differentiate_pieces(position)) / speed
        powers = stretch ** -np.arange(6.0)
        return breaks * stretch, position * powers[np.newaxis, :, np.newaxis]

"""Operators who command what was planned beforehand, whatever they feel."""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from teleop_drake.arrays import Array, ArrayLike, Interval
from teleop_drake.blocks.channels.base import SHORTEST_TIME
from teleop_drake.blocks.environments import Surface
from teleop_drake.blocks.operators.base import ModalOperator, OperatorConfig
from teleop_drake.kernel import Term, Transition
from teleop_drake.numerics.piecewise_polynomial import (
    differentiate_pieces,
    evaluate_pieces,
    largest_norm,
    linear_pieces,
    minimum_jerk_pieces,
)
from teleop_drake.validation import CheckVector, Config, Number, Refuse

MAX_FREQUENCY = 1000.0
"""Highest frequency of a sine in rad/s."""

# Steps of the solver in a period, at least.
_STEPS_PER_PERIOD = 20

# The shortest way between two waypoints, as a share of the longest one.
_SHORTEST_WAY = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A velocity as a function of time, and what a solver has to know of it.

    Attributes:
        velocity: Term of v_d in m/s (n); see kernel.
        parameters: Of the term.
        jump_times: When v_d is not smooth, s; short steps follow.
        ends: Where steps end: (first, period) each, in s; an infinite period: once.
        longest_step: No step may be longer, s.
    """

    velocity: Term
    parameters: Mapping[str, Any]
    jump_times: Sequence[float] = ()
    ends: Sequence[Interval] = ()
    longest_step: float = math.inf


def PlanOfPieces(
    breaks: Array,
    coefficients: Array,
    bends: Sequence[float] = (),
    ends: Sequence[Interval] | None = None,
    longest_step: float = math.inf,
) -> Plan:
    """Returns the plan of a velocity that is a polynomial of time, piece after piece.

        v_d(t) = sum_i coefficients[k, i] (t - breaks[k])^i
                                             for breaks[k] <= t < breaks[k + 1]
               = 0                           before and after

    Args:
        breaks: (K + 1,) in s, ascending; the last one may be infinite.
        coefficients: (K, d + 1, n) in m/s, m/s^2 and so on.
        bends: When v_d is not smooth, s; short steps follow.
        ends: Where steps end; see Plan. None: at the bends.
        longest_step: No step may be longer, s.

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
    )


class PlannedOperator(ModalOperator):
    """Commands a velocity that is a function of time alone.

    Ports, state, modes, initial value and feedthrough are those of ModalOperator.

    It does not react to forces, and does not know whether the tool follows.

    Args:
        plan: The velocity.
        num_axes: n.
        contact_force: Force after contact in N (n); None: never switches.
        contact_surface: Where contact is perceived; None: never.
        stop_time: When the stop is commanded in s; None: never.
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


class ConstantVelocityOperator(PlannedOperator):
    """Commands a velocity until contact is felt, then a constant force (section 2.5).

        mode 0, velocity: v_d = velocity, F_h = force of the haptic device
        mode 1, force:    v_d = 0,        F_h = contact_force
        mode 2, stopped:  v_d = 0,        F_h = 0 if the mode was 1, otherwise the
                                          haptic device brakes the tool

    Ports, state, initial value and feedthrough are those of ModalOperator.

    It does not react to forces, get tired, or let go when the tool bounces off.

    | parameter | name          | unit |
    |-----------|---------------|------|
    | 0         | velocity      | m/s  |
    | 1         | contact_force | N    |

    Args:
        velocity: v_d in m/s (n).
        contact_force: Force after contact in N (n); None: never switches.
        contact_surface: Where contact is perceived; None: never.
        stop_time: When the stop is commanded in s; None: never.

    Raises:
        ValueError: If a size or value is not allowed.
    """

    has_constant_command = True

    numeric_parameters: ClassVar = {
        "velocity": "m/s",
        "contact_force": "N",
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


class PlannedConfig(OperatorConfig):
    """Base of the operators whose velocity is a function of time."""

    @abstractmethod
    def MakePlan(self) -> Plan:
        """Returns the velocity.

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
        """Returns the longest step in s that the solver may take, infinity if any."""
        return self.MakePlan().longest_step


@Config
class TrapezoidConfig(PlannedConfig):
    """v_d = s(t) velocity, where s rises from 0 to 1, stays, and falls back to 0."""

    kind = "trapezoid"

    # How long v_d rises, and falls, s, >= SHORTEST_TIME. Assumed.
    rise_time: float = Number(0.5, "s", minimum=SHORTEST_TIME)
    # How long it stays at `velocity`, s, >= 0; null: from then on.
    cruise_time: float | None = Number(None, "s", minimum=0)

    def MakePlan(self) -> Plan:
        """Returns straight lines between the corners."""
        rise = self.rise_time
        fall = rise + (math.inf if self.cruise_time is None else self.cruise_time)
        times = np.array([0.0, rise, fall, fall + rise])
        corners = np.outer([0.0, 1.0, 1.0, 0.0], self.velocity)
        # It may not stay at all, or for ever.
        is_later = np.append(True, times[1:] > times[:-1])
        breaks, coefficients = linear_pieces(times[is_later], corners[is_later])
        bends = breaks[1:][np.isfinite(breaks[1:])].tolist()
        return PlanOfPieces(breaks, coefficients, bends)


@Config
class SineConfig(PlannedConfig):
    """v_d = velocity sin(frequency t): to and fro, from rest."""

    kind = "sine"

    # rad/s, > 0 to MAX_FREQUENCY. Assumed.
    frequency: float = Number(1.0, "rad/s", above=0, maximum=MAX_FREQUENCY)

    def MakePlan(self) -> Plan:
        """Returns the sine."""
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
    """v_d is that of the path of least jerk through waypoints (Flash and Hogan 1985).

    The path begins and ends at rest and does not stop in between. Each of its pieces
    has a time in proportion to its length, and all of them together are such that the
    fastest speed is |velocity|. Of `velocity` the direction has no effect, except
    where there are no waypoints: then the path leads along it.
    """

    kind = "minimum_jerk"

    # Where to, m from the start, n entries each, one after another different; empty:
    # where `velocity` would have come after `reach_time`. With six axes the last three
    # are a rotation vector, rad, all of them about one axis.
    waypoints: list[list[float]] = field(default_factory=list)
    # Used without waypoints, s, > 0. Assumed.
    reach_time: float = Number(1.0, "s", above=0)

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field; see OperatorConfig.Check."""
        super().Check(path, num_axes)
        for i, point in enumerate(self.waypoints):
            CheckVector(f"{path}.waypoints.{i}", point, num_axes, "m")
        # SciPy has no polynomials for pieces of all too different lengths.
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
        # The rate of a rotation vector is the angular velocity about a fixed axis.
        turns = np.array([point[3:] for point in self.waypoints])
        if turns.size and np.linalg.matrix_rank(turns) > 1:
            Refuse(f"{path}.waypoints", self.waypoints, "turned about one axis")

    def MakePlan(self) -> Plan:
        """Returns the derivative of the path."""
        breaks, position = self.Path()
        return PlanOfPieces(breaks, differentiate_pieces(position), [float(breaks[-1])])

    def Path(self) -> tuple[Array, Array]:
        """Returns breaks (K + 1) in s and coefficients (K, 6, n) of p_d - start."""
        velocity = np.asarray(self.velocity, dtype=float)
        speed = float(np.linalg.norm(velocity))
        ends: list[ArrayLike] = [*self.waypoints] or [velocity * self.reach_time]
        points = np.array([0 * velocity, *ends])
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        times = np.concatenate([[0.0], np.cumsum(lengths)]) / speed
        breaks, position = minimum_jerk_pieces(times, points)
        # The path does not depend on how fast it is passed: time is stretched.
        stretch = largest_norm(breaks, differentiate_pieces(position)) / speed
        powers = stretch ** -np.arange(6.0)
        return breaks * stretch, position * powers[np.newaxis, :, np.newaxis]

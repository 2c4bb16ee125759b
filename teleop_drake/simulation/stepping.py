"""Ends and longest lengths of the steps of a run.

The blocks say what there is to know, each by a member that it has or has not:

| member          | of             | says                                 |
|-----------------|----------------|--------------------------------------|
| longest_step    | a delay, an operator | no step may be longer, s       |
| delays          | a delay        | what is under way                    |
| NextJumpTime()  | a channel, a sensor | when its output jumps next, s   |
| jump_times      | an operator    | when its outputs jump or are not smooth, s |
| contact_surface | an operator    | where it perceives contact           |
| Surfaces()      | an environment | where its force jumps or bends       |
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.analysis import IntegratorBase
from pydrake.systems.framework import Context, Diagram, System

from teleop_drake.blocks.environments.surface import Surface, SurfacesOf
from teleop_drake.contexts import ContextsIn
from teleop_drake.kernel import KernelBlock
from teleop_drake.kernel.delay_line import DelayLine
from teleop_drake.kernel.ticks import Ticks
from teleop_drake.numerics.instants import SAME

# A step across a boundary as short as twice this many s is not bisected any further.
_EVENT_WINDOW = 2e-7

# After a jump or a non-smooth point the first steps are this share of the longest one,
# and then each is at most that share of the time since. A delayed signal is a
# polynomial through the steps of its sender: behind a jump there are none but the new
# ones, and they set its error, which error control does not see. Steps grow even more
# slowly after a crossing of a boundary, because Drake's error norm is absolute and
# hardly sees a tool that bounces by micrometres. Of some thirty settings these were
# chosen, which keep one_dof within 1e-5 of its signals' ranges at 46 of 50 delays from
# 0.02 to 0.4 s.
_FIRST_STEP = 1 / 8
_STEP_GROWTH = 0.04
_STEP_GROWTH_AFTER_CROSSING = 0.02


def LongestStep(diagram: System, context: Context, *, of_delays: bool = True) -> float:
    """Returns the longest step in s that a diagram's systems allow, or infinity.

    Args:
        context: The Context of the diagram, whose delays count.
        of_delays: Whether blocks that delay something are considered.
    """
    return min(
        LongestStepOf(system, own)
        for system, own in ContextsIn(diagram, context).items()
        if of_delays or not getattr(system, "delays", ())
    )


def LongestStepOf(system: System, context: Context) -> float:
    """Returns the longest step in s that one system allows, or infinity.

    Args:
        context: The Context of the system.
    """
    if isinstance(system, KernelBlock):
        return system.LongestStep(context)
    return getattr(system, "longest_step", math.inf)


class _Motion(NamedTuple):
    """Something that moves towards a surface: its depth in m, and its rates."""

    depth: float
    velocity: float
    acceleration: float


class _Boundaries:
    """Surfaces that something may cross."""

    def __init__(self, surfaces: Sequence[Surface]):
        # What is infinitely far away is never crossed.
        surfaces = [x for x in surfaces if np.isfinite(x.point_W).all()]
        self._normals = np.array([x.normal_W for x in surfaces])
        self._points = np.array([x.Along(x.point_W) for x in surfaces])

    def Motions(self, p: np.ndarray, v: np.ndarray, a: np.ndarray) -> list[_Motion]:
        """Returns how a point moves relative to each surface."""
        if not self._points.size:
            return []
        moves = np.stack((p, v, a)) @ self._normals.T
        moves[0] -= self._points
        return [_Motion(*motion) for motion in moves.T.tolist()]


class Stepping:
    """Says at the end of each step where the next ones should end.

    The simulator runs by itself except near a jump. There it stops, so that both
    sides can be recorded. It is led up to a boundary by short steps, because finding
    the crossing by bisection would cost a hundred times more.

    It belongs to one run, and keeps no Context: that would keep the Simulator alive.

    Attributes:
        longest_step: Of the run, in s.
        step_limit: Of the steps to come, in s.

    Args:
        diagram: What is simulated.
        longest_step: Of the run, in s.
        start: When the run begins, in s.
    """

    def __init__(self, diagram: System, longest_step: float, start: float):
        systems = list(SystemsIn(diagram)) or [diagram]

        def With(member: str) -> Iterator[Any]:
            return (system for system in systems if hasattr(system, member))

        self._jumping = list(With("NextJumpTime"))
        self._has_delay_lines = any(
            isinstance(line, DelayLine)
            for system in systems
            for line in getattr(system, "delays", ())
        )
        self._environments = [
            (x, _Boundaries(SurfacesOf(x) or ())) for x in systems if _IsEnvironment(x)
        ]
        self._operators = [
            (x, _Boundaries([x.contact_surface]))
            for x in With("contact_surface")
            if x.contact_surface is not None
        ]
        self._jump_times = {time for x in With("jump_times") for time in x.jump_times}
        self._discrete_updates: list[Ticks] = []
        has_guards = any(x.has_guards for x in With("has_guards"))
        if self._has_delay_lines or has_guards:
            self._discrete_updates = _DiscreteUpdates(systems)
        accelerating = [x for x in systems if x.HasOutputPort("tool_acceleration")]
        feeling = [x for x in systems if x.HasInputPort("felt_velocity")]
        self._accelerating = next(iter(accelerating), None)
        self._felt = next(iter(feeling), None)
        self.longest_step = longest_step
        self.step_limit = longest_step
        self._motions: list[_Motion] = []
        self._last_jump = start
        self._crossing_time = -math.inf
        self._next_jump = math.inf
        self._stop = 0.0
        self._rejected_step = math.inf

    def Reject(self, step: float, integrator: IntegratorBase) -> None:
        """Makes the next step short; those after it grow again.

        Args:
            step: The longest that it may be, in s.
        """
        self._rejected_step = self.step_limit = step
        integrator.set_maximum_step_size(step)

    def EndStep(self, root_context: Context, integrator: IntegratorBase) -> bool:
        """Takes note of the end of a step, and limits the next ones.

        Returns:
            Whether AdvanceTo() has to end here.
        """
        time = root_context.get_time()
        before = self._motions
        self._motions = self._FindMotions(root_context)
        for last, motion in zip(before, self._motions, strict=False):
            if (last.depth < 0) != (motion.depth < 0):
                self._crossing_time = time
        is_at_jump = self.IsAtJump(time)
        self._LimitStep(time, is_at_jump, integrator)
        return (
            is_at_jump
            or self._ApproachTime() < math.inf
            or self._FindNextJump(root_context) < self._stop
        )

    def IsAtJump(self, time: float) -> bool:
        """Returns whether an event that makes signals jump is pending at a time.

        Args:
            time: Now, in s.
        """
        # It may be pending an instant before its time; see ticks.
        is_next = abs(time - self._next_jump) <= SAME
        is_crossing = time == self._crossing_time
        is_known = is_next or is_crossing or time in self._jump_times
        return is_known or self.IsAtDiscreteUpdate(time)

    def IsAtDiscreteUpdate(self, time: float) -> bool:
        """Returns whether a delay or a guard may see a discrete update at a time.

        Args:
            time: Now, in s.
        """
        return any(ticks.At(time) is not None for ticks in self._discrete_updates)

    def NextStop(self, root_context: Context) -> float:
        """Returns where the simulator should stop next, in s; infinity: nowhere."""
        self._next_jump = self._FindNextJump(root_context)
        self._stop = min(
            self._next_jump, root_context.get_time() + self._ApproachTime()
        )
        return self._stop

    def _LimitStep(
        self, time: float, is_at_jump: bool, integrator: IntegratorBase
    ) -> None:
        """Makes steps after a jump or a failure short, and then longer and longer."""
        if is_at_jump:
            self._last_jump = time
        step = self.longest_step
        if self._has_delay_lines:
            step = min(
                _STEP_GROWTH * (time - self._last_jump),
                _STEP_GROWTH_AFTER_CROSSING * (time - self._crossing_time),
                step,
            )
            step = max(step, _FIRST_STEP * self.longest_step)
        if self._rejected_step < step:
            self._rejected_step *= 2
            step = min(step, self._rejected_step)
        if step != self.step_limit:
            self.step_limit = step
            integrator.set_maximum_step_size(step)

    def _FindNextJump(self, root_context: Context) -> float:
        return min(
            (
                system.NextJumpTime(system.GetMyContextFromRoot(root_context))
                for system in self._jumping
            ),
            default=math.inf,
        )

    def _FindMotions(self, root_context: Context) -> list[_Motion]:
        """Returns what moves towards which boundaries.

        Only the steps towards a boundary depend on velocity and acceleration, so they
        may be off.
        """
        motions = []
        for environment, boundaries in self._environments:
            p, v = (
                _Input(environment, name, root_context)
                for name in ("tool_position", "tool_velocity")
            )
            a = np.zeros_like(p)
            if self._accelerating is not None:
                context = self._accelerating.GetMyContextFromRoot(root_context)
                a = self._accelerating.GetOutputPort("tool_acceleration").Eval(context)
            motions += boundaries.Motions(p, v, a)
        for operator, boundaries in self._operators:
            context = operator.GetMyContextFromRoot(root_context)
            if operator.GetOutputPort("mode").Eval(context).item(0) != 0:
                continue
            p = _Input(operator, "felt_position", root_context)
            v = np.zeros_like(p)
            if self._felt is not None:
                v = _Input(self._felt, "felt_velocity", root_context)
            motions += boundaries.Motions(p, v, np.zeros_like(p))
        return motions

    def _ApproachTime(self) -> float:
        """Returns the length of a step towards a boundary ahead, infinity if none is.

        It covers most of the way, or a little more than the whole if that is short
        enough for Drake to accept the step as the location of the crossing.
        """
        horizon = 1.5 * self.longest_step
        shortest = math.inf
        for depth, v, a in self._motions:
            reach = (abs(v) + abs(a) * horizon / 2) * horizon
            if abs(depth) > reach:
                continue
            time = _TimeToCross(-depth, v, a)
            if time >= horizon:
                continue
            # What the acceleration's change does to the time is of third order.
            margin = 0.1 * time * (time / horizon) ** 2
            if margin > _EVENT_WINDOW:
                time -= margin
            else:
                time += _EVENT_WINDOW
            shortest = min(shortest, time)
        return shortest


def SystemsIn(diagram: System) -> Iterator[System]:
    """Yields the systems in a diagram and in those inside; none in a leaf system."""
    for system in diagram.GetSystems() if isinstance(diagram, Diagram) else ():
        yield system
        if isinstance(system, Diagram):
            yield from SystemsIn(system)


def NotesOnSamples(diagram: System, context: Context) -> list[str]:
    """Returns whether samples come too densely for the delays of a run in Drake.

    A delay is a polynomial through the ends of steps. A signal that bends at each
    sample is interpolated across the bends where no step ends between two samples.

    Args:
        context: The Context of the diagram, whose delays count.
    """
    first_steps = []
    periods = []
    for system, own in ContextsIn(diagram, context).items():
        if isinstance(system, KernelBlock):
            lines = [x for x in system.delays if isinstance(x, DelayLine)]
            first_steps += [_FIRST_STEP * line.LongestStep(own) for line in lines]
            periods += [ticks.period for ticks in system.ticks]
    if min(periods, default=math.inf) > min(first_steps, default=0.0):
        return []
    return [
        f"Drake's Simulator takes no step between samples that are {min(periods):g} s "
        "apart, so a delay smooths the bends of its signal there, whatever the "
        "accuracy: metrics may differ by some tenths of a per cent, where samples are "
        "quantised by several per cent, from those of the compiled engine, which "
        "converges."
    ]


def _DiscreteUpdates(systems: Sequence[System]) -> list[Ticks]:
    """Returns when systems have periodic discrete updates.

    A block of this package knows its own. Of any other one Drake reports the period, if
    it has one alone.
    """
    ticks: set[Ticks] = set()
    for system in systems:
        if hasattr(system, "discrete_ticks"):
            ticks.update(system.discrete_ticks)
        elif not isinstance(system, Diagram):
            found = system.GetUniquePeriodicDiscreteUpdateAttribute()
            if found is not None:
                ticks.add(Ticks(found.period_sec(), found.offset_sec()))
    return list(ticks)


def _IsEnvironment(system: System) -> bool:
    has_ports = system.HasInputPort("tool_position")
    return bool(has_ports and system.HasOutputPort("environment_force"))


def _Input(system: System, name: str, root_context: Context) -> np.ndarray:
    context = system.GetMyContextFromRoot(root_context)
    return system.GetInputPort(name).Eval(context)


def _TimeToCross(gap: float, v: float, a: float) -> float:
    """Returns the smallest t > 0 with gap = v t + a t^2 / 2, or infinity."""
    if not math.isfinite(gap) or gap == 0:
        return math.inf
    discriminant = v * v + 2 * a * gap
    if discriminant < 0:
        return math.inf
    # Both roots in the form that does not cancel.
    q = v + math.copysign(math.sqrt(discriminant), v)
    roots = [2 * gap / q] if q != 0 else []
    if a != 0:
        roots.append(q / a)
    return min((root for root in roots if root > 0), default=math.inf)

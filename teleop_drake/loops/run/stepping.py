"""Ends and longest lengths of the steps of a run.

The blocks announce what limits a step through optional attributes:

| attribute       | of                   | meaning                                    |
|-----------------|----------------------|--------------------------------------------|
| longest_step    | a delay, an operator | no step may be longer, s                   |
| delays          | a delay              | the signals that are under way             |
| NextJumpTime()  | a channel, a sensor  | when its output jumps next, s              |
| jump_times      | an operator          | when its outputs jump or are not smooth, s |
| Guards()        | a block with events  | an event happens where one becomes positive |
| Surfaces()      | an environment without guards | where its force jumps or bends    |
| contact_surface | an operator without guards    | where it perceives contact        |
"""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.systems.analysis import IntegratorBase
from pydrake.systems.framework import Context, Diagram, InputPort, System

from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.kernel import KernelBlock
from teleop_drake.loops.kernel.delay_line import DelayLine
from teleop_drake.loops.kernel.events import Ticks
from teleop_drake.loops.numerics.instants import SAME
from teleop_drake.loops.numerics.jumps import Jump
from teleop_drake.loops.run.source_jumps import SourceJumps

if TYPE_CHECKING:
    from teleop_drake.loops.framework.surface import Surface

# A step across a boundary as short as twice this many s is not bisected any further.
_EVENT_WINDOW = 2e-7

# After a jump or a non-smooth point, the first steps are _FIRST_STEP times the longest
# one. Later steps are at most _STEP_GROWTH times the time since then. A delayed signal
# is a polynomial through the ends of its sender's steps. After a jump only the new
# steps determine it, with an error that error control does not detect. Steps grow more
# slowly after a crossing of a boundary, because Drake's error norm is absolute and
# hardly detects a tool that bounces by micrometres. The values were chosen from some
# thirty settings. They keep one_dof within 1e-5 of its signals' ranges at 46 of 50
# delays from 0.02 to 0.4 s.
_FIRST_STEP = 1 / 8
_STEP_GROWTH = 0.04
_STEP_GROWTH_AFTER_CROSSING = 0.02


class Stepping:
    """The rules for the ends and the longest lengths of a run's steps.

    The simulator stops at each jump, so that both sides can be recorded. Before an
    event its steps become short, because Drake would otherwise find the event by
    bisection, with many more steps.

    The object belongs to one run. It keeps no Context, which would keep the Simulator
    alive.

    Attributes:
        longest_step: The longest step of the run, s.
        step_limit: The longest length of the next steps, s.

    Args:
        diagram: The simulated System.
        longest_step: The longest step of the run, s.
        root_context: The Context in which the run begins; None: there is no run yet.
    """

    def __init__(
        self, diagram: System, longest_step: float, root_context: Context | None = None
    ):
        # A Diagram itself is left out: its parts announce the same limits.
        systems = SystemsIn(diagram)[1:] or [diagram]
        self._jumping: list[Any] = [x for x in systems if hasattr(x, "NextJumpTime")]
        self._delay_lines = [
            (system, line)
            for system in systems
            for line in getattr(system, "delays", ())
            if isinstance(line, DelayLine)
        ]
        for _, line in self._delay_lines:
            line.repeating.add(self)
        self._jump_times = {
            time for system in systems for time in getattr(system, "jump_times", ())
        }
        self._guarded: list[Any] = [
            system for system in systems if getattr(system, "has_guards", False)
        ]
        self._discrete_updates: list[Ticks] = []
        if self._delay_lines or self._guarded:
            self._discrete_updates = _DiscreteUpdates(systems)
        self._surfaces = [
            surface
            for system in systems
            if system not in self._guarded
            for surface in _SurfacesSeenBy(system)
        ]
        # The last two instants, with the values of all guards at each.
        self._guards: list[tuple[float, np.ndarray]] = []
        self.longest_step = longest_step
        self.step_limit = longest_step
        self._sources: SourceJumps | None = None
        self._last_jump = 0.0
        if root_context is not None:
            self._last_jump = root_context.get_time()
            if self._delay_lines and longest_step < math.inf:
                self._sources = SourceJumps(systems, root_context, longest_step)
        self._crossing_time = -math.inf
        self._next_jump = math.inf
        self._stop = 0.0
        self._rejected_step = math.inf

    def BeginModes(self, root_context: Context) -> None:
        """Makes the transitions that are due at the start, before samples are taken."""
        for block in self._guarded:
            context = block.GetMyMutableContextFromRoot(root_context)
            values = block.AllocateDiscreteVariables()
            values.SetFrom(context.get_discrete_state())
            if block.ChangeModes(context, values):
                context.SetDiscreteState(values)

    def Reject(self, step: float, integrator: IntegratorBase) -> None:
        """Limits the length of the next step, after which steps grow again.

        Args:
            step: The limit, s.
        """
        self._rejected_step = self.step_limit = step
        integrator.set_maximum_step_size(step)

    def StoreSent(self, root_context: Context) -> None:
        """Stores the present signals in the delays; see DelayLine."""
        for system, line in self._delay_lines:
            line.Store(system.GetMyMutableContextFromRoot(root_context))

    def SourceJump(self, time: float) -> Jump | None:
        """Returns the jump of a source that begins at a time in s, if there is one."""
        jump = None if self._sources is None else self._sources.Next(time)
        return jump if jump is not None and jump.before <= time else None

    def Cross(self, jump: Jump, root_context: Context) -> None:
        """Passes a jump of a source, so that delays store both sides of it."""
        self.StoreSent(root_context)
        root_context.SetTime(jump.after)
        for system, line in self._delay_lines:
            line.StoreJump(system.GetMyMutableContextFromRoot(root_context))
        self._last_jump = jump.after

    def EndStep(self, root_context: Context, integrator: IntegratorBase) -> bool:
        """Evaluates guards and jumps at the end of a step, and limits the next steps.

        Returns:
            Whether AdvanceTo() has to end here.
        """
        time = root_context.get_time()
        self._NoteGuards(time, self._GuardsIn(root_context))
        is_at_jump = self.IsAtJump(time)
        self._LimitStep(time, is_at_jump, integrator)
        return (
            is_at_jump
            or self._ApproachTime() < math.inf
            or self._FindNextJump(root_context) < self._stop
            or self._NextSourceJump(time) < self._stop
        )

    def IsAtJump(self, time: float) -> bool:
        """Returns whether an event that makes signals jump is pending at a time.

        Args:
            time: The present time, s.
        """
        # An event may be pending an instant before its time; see kernel.events.Ticks.
        is_next = abs(time - self._next_jump) <= SAME
        is_crossing = time == self._crossing_time
        is_known = is_next or is_crossing or time in self._jump_times
        is_known = is_known or self.SourceJump(time) is not None
        return is_known or self.IsAtDiscreteUpdate(time)

    def IsAtDiscreteUpdate(self, time: float) -> bool:
        """Returns whether a delay or a guard may see a discrete update at a time.

        Args:
            time: The present time, s.
        """
        return any(ticks.At(time) is not None for ticks in self._discrete_updates)

    def NextStop(self, root_context: Context) -> float:
        """Returns the time at which the simulator should stop next, s, or infinity."""
        time = root_context.get_time()
        self._next_jump = self._FindNextJump(root_context)
        self._stop = min(self._next_jump, time + self._ApproachTime())
        self._stop = min(self._stop, self._NextSourceJump(time))
        # Drake's periodic events, which end the steps of a diagram without continuous
        # states, begin at time 0.
        if self._delay_lines and time < 0:
            self._stop = min(self._stop, time + self.longest_step)
        return self._stop

    def _LimitStep(
        self, time: float, is_at_jump: bool, integrator: IntegratorBase
    ) -> None:
        """Shortens the steps after a jump or a failure, and lets them grow again."""
        if is_at_jump:
            self._last_jump = time
            self._guards = self._guards[-1:]
        step = self.longest_step
        if self._delay_lines:
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

    def _NextSourceJump(self, time: float) -> float:
        """Returns when the next jump of a source begins, s; infinity: not near."""
        jump = None if self._sources is None else self._sources.Next(time)
        return math.inf if jump is None else jump.before

    def _FindNextJump(self, root_context: Context) -> float:
        return min(
            (
                system.NextJumpTime(system.GetMyContextFromRoot(root_context))
                for system in self._jumping
            ),
            default=math.inf,
        )

    def _GuardsIn(self, root_context: Context) -> np.ndarray:
        """Returns the values of all guards; an event happens where one is positive."""
        values: list[float] = []
        for block in self._guarded:
            values += block.Guards(block.GetMyContextFromRoot(root_context))
        for position, surface in self._surfaces:
            context = position.get_system().GetMyContextFromRoot(root_context)
            depth = float(surface.Depth(position.Eval(context)))
            values += [depth, -depth]
        return np.array(values)

    def _NoteGuards(self, time: float, values: np.ndarray) -> None:
        """Stores the values of all guards at the end of a step; detects crossings."""
        if self._guards:
            last_time, last = self._guards[-1]
            if np.any((last < 0) & (values >= 0)):
                self._crossing_time = time
            if last_time == time:
                self._guards.pop()
        self._guards = [*self._guards[-1:], (time, values)]

    def _ApproachTime(self) -> float:
        """Returns the length in s of a step towards the next event, or infinity.

        The time to the event is extrapolated linearly from the guards in the last step.
        The step covers 90 % of it or, if Drake accepts the rest as the location of the
        event, slightly more than all of it.
        """
        if len(self._guards) < 2:
            return math.inf
        (before, first), (now, last) = self._guards
        with np.errstate(invalid="ignore"):  # A guard may be infinite.
            rates = (last - first) / (now - before)
        is_coming = (last < 0) & (rates > 0) & np.isfinite(rates)
        times = -last[is_coming] / rates[is_coming]
        time = float(times.min(initial=math.inf))
        if time >= 1.5 * self.longest_step:
            return math.inf
        if 0.1 * time > _EVENT_WINDOW:
            return 0.9 * time
        return time + _EVENT_WINDOW


def SystemsIn(system: System) -> list[System]:
    """Returns a system and all systems in it, in the order of evaluation of rates."""
    parts = system.GetSystems() if isinstance(system, Diagram) else []
    return [system, *(inner for part in parts for inner in SystemsIn(part))]


def NotesOnSamples(diagram: System, context: Context) -> list[str]:
    """Returns a note if samples are too dense for the delays of a run in Drake.

    A delayed signal is a polynomial through the ends of steps. If no step ends between
    two samples, it does not follow a signal that bends at each sample.

    Args:
        context: The Context of the diagram, which has the lengths of delays.
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
    """Returns the instants of the periodic discrete updates of systems.

    A block of this package reports its own instants. For any other block, Drake reports
    the period, if there is only one.
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


def _SurfacesSeenBy(system: Any) -> "Iterator[tuple[InputPort, Surface]]":
    """Yields the position inputs of an environment or operator, each with a surface."""
    if any(hasattr(part, "Surfaces") for part in SystemsIn(system)):
        from teleop_drake.loops.framework.surface import SurfacesOf

        for surface in SurfacesOf(system) or ():
            yield system.GetInputPort("tool_position"), surface
    contact = getattr(system, "contact_surface", None)
    if contact is not None:
        yield system.GetInputPort("felt_position"), contact

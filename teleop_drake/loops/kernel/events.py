"""Drake's events of blocks: periodic updates, and the transitions of a kernel.

All periodic updates declared here use the values before their instant. With Drake's own
periodic events, this would depend on rounding: their times are computed in floating
point, and 15 * 0.02 is less than 3 * 0.1. If two blocks sample every 20 and 100 ms, the
second one would read the value either before or after the first one's update.
"""

import inspect
import math
import warnings
import weakref
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    DiscreteValues,
    EventStatus,
    LeafSystem,
    State,
    UnrestrictedUpdateEvent,
    WitnessFunction,
    WitnessFunctionDirection,
)

from teleop_drake.loops.kernel.kernel import Kernel, Term, Transition
from teleop_drake.loops.kernel.terms import ContextReader, ValueIn
from teleop_drake.loops.numerics.instants import same_within

# Longer than any simulation: an event with this period happens once.
_ONCE = 1e12


def Weakly(function: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a function that calls another one through a weak reference.

    Drake stores the functions of a witness or a cache entry where Python's garbage
    collector does not find them. With strong references to methods of a system, neither
    the system nor its Diagram would ever be collected. Drake calls the functions only
    during the lifetime of the system.

    Args:
        function: A method of the system, or a function that the system refers to.
    """
    is_method = inspect.ismethod(function)
    reference = (weakref.WeakMethod if is_method else weakref.ref)(function)

    def Call(*arguments: Any) -> Any:
        alive = reference()
        assert alive is not None
        return alive(*arguments)

    return Call


@dataclass(frozen=True)
class Ticks:
    """The instants offset + k period in s, k = 0, 1, ...

    There is one instant if the period is infinite.
    """

    period: float
    offset: float = 0.0

    def At(self, time: float) -> int | None:
        """Returns the number of the tick at a time in s, None if there is none."""
        k = self._Nearest(time)
        is_at_tick = abs(self.TimeOf(k) - time) <= same_within(time)
        return k if is_at_tick else None

    def After(self, time: float) -> float:
        """Returns the time in s of the first tick after a time in s."""
        k = self._Nearest(time)
        is_after = self.TimeOf(k) > time + same_within(time)
        return self.TimeOf(k if is_after else k + 1)

    def From(self, time: float) -> int:
        """Returns the number of the first tick at a time in s, or after it."""
        k = self._Nearest(time)
        return k if self.TimeOf(k) >= time - same_within(time) else k + 1

    def TimeOf(self, k: int) -> float:
        """Returns the time of a tick in s, rounded as Drake rounds it."""
        return self.offset + k * self.period if k else self.offset

    def Declare(self, block: LeafSystem) -> None:
        """Declares events at which a step of the solver ends."""
        period = min(self.period, _ONCE)
        block.DeclarePeriodicPublishEvent(period, self.offset, EndStep)

    def _Nearest(self, time: float) -> int:
        """Returns the number of the tick that is nearest to a time, in s."""
        return max(round((time - self.offset) / self.period), 0)


@dataclass(frozen=True)
class ListedTicks:
    """Instants that are listed, in s, ascending."""

    times: Sequence[float]

    def At(self, time: float) -> int | None:
        """Returns the number of the tick at a time in s, None if there is none."""
        k = self.From(time)
        is_at_tick = k < len(self.times) and self.times[k] <= time + same_within(time)
        return k if is_at_tick else None

    def From(self, time: float) -> int:
        """Returns the number of the first tick at a time in s, or after it."""
        return bisect_left(self.times, time - same_within(time))

    def TimeOf(self, k: int) -> float:
        """Returns the time of a tick in s, infinity if it is not listed."""
        return self.times[k] if k < len(self.times) else math.inf

    def Declare(self, block: LeafSystem) -> None:
        """Declares events at which a step of the solver ends."""
        for time in self.times:
            block.DeclarePeriodicPublishEvent(_ONCE, time, EndStep)


def EndStep(context: Context) -> EventStatus:
    """Does nothing; the solver ends a step at the instant of its event."""
    return EventStatus.DidNothing()


def DeclareTicks(
    block: LeafSystem,
    ticks: Ticks | ListedTicks,
    update: Callable[[Context, State], None] | None,
) -> None:
    """Declares an unrestricted update at each tick.

    A step of the solver ends at each tick. The update is executed at the end of the
    first step that ends at the tick to within rounding. Such a step may end at another
    block's tick; the updates of both blocks are then executed together.

    Args:
        block: The block that is updated. It stores the number of the last tick in an
            abstract state.
        update: A method of the block, or a function to which the block holds a
            reference, with the arguments of Drake's callback. None: steps end at the
            ticks, and nothing is updated.
    """
    ticks.Declare(block)
    if update is None:
        return
    last = block.DeclareAbstractState(AbstractValue.Make(-1))
    weak_update = Weakly(update)

    def Update(context: Context, state: State) -> EventStatus:
        k = ticks.At(context.get_time())
        if k is None or k == context.get_abstract_state(last).get_value():
            return EventStatus.DidNothing()
        state.get_mutable_abstract_state(last).set_value(k)
        weak_update(context, state)
        return EventStatus.Succeeded()

    block.DeclarePerStepUnrestrictedUpdateEvent(Update)


class EventBlock(LeafSystem):
    """A block with the events of its kernel's transitions.

    | in a transition      | in Drake                                                |
    |----------------------|---------------------------------------------------------|
    | guard                | a witness function, if the Context has an accuracy; and |
    |                      | a discrete update at the end of a step where the guard  |
    |                      | is at least 0, as after a jump                          |
    | period               | an update at each tick, see DeclareTicks()              |
    | period, mode "mode"  | no update: a step of the solver ends at each tick       |

    Attributes:
        has_guards: Whether a transition has a guard.
        transitions: The functions that evaluate the guard (None: periodic) and the new
            mode of each transition in a Context, by its name in the kernel.
        ticks: The instants of periodic unrestricted updates.
        discrete_ticks: The instants of periodic discrete updates.
    """

    has_guards = False
    ticks: Sequence[Ticks] = ()
    discrete_ticks: Sequence[Ticks] = ()
    transitions: Mapping[str, tuple[ValueIn | None, ValueIn]] = MappingProxyType({})
    # The witness functions of the guards, and the functions to which Drake has weak
    # references only.
    _kernel_witnesses: Sequence[WitnessFunction] = ()
    _kernel_callbacks: Sequence[Callable[..., Any]] = ()
    _has_warned = False

    def _DeclareEvents(self, kernel: Kernel) -> None:
        """Declares the events of a kernel; the block has its inputs and its state."""

        def Read(term: Term, place: str) -> ValueIn:
            return ContextReader(self, kernel, place).Read(term)

        for name, transition in kernel.transitions.items():
            place = f"transitions.{name}"
            assert transition.mode is not None
            mode = Read(transition.mode, f"{place}.mode")
            guard = None
            if transition.guard is None:
                self._DeclarePeriodic(transition, mode)
            else:
                guard = Read(transition.guard, f"{place}.guard")
                self._DeclareGuard(name, guard, mode)
            self.transitions = {**self.transitions, name: (guard, mode)}
        self.has_guards = bool(self._kernel_witnesses)
        if self.has_guards:
            self.DeclarePerStepDiscreteUpdateEvent(Weakly(self._CheckGuards))
        if kernel.initial_mode is not None:
            initial = Read(kernel.initial_mode, "initial_mode")

            def Initialize(context: Context, state: State) -> None:
                state.get_mutable_discrete_state(0).SetFromVector(initial(context))

            self.DeclareInitializationUnrestrictedUpdateEvent(self._Keep(Initialize))

    def Guards(self, context: Context) -> list[float]:
        """Returns the values of the transitions' guards, in their order."""
        return [
            float(guard(context)[0])
            for guard, _ in self.transitions.values()
            if guard is not None
        ]

    def DoGetWitnessFunctions(self, context: Context) -> list[WitnessFunction]:
        """Returns the guards of the transitions, if events are to be located."""
        if context.get_accuracy() is None:
            return []
        return list(self._kernel_witnesses)

    def _Keep(self, function: Callable[..., Any]) -> Callable[..., Any]:
        self._kernel_callbacks = (*self._kernel_callbacks, function)
        return Weakly(function)

    def _DeclarePeriodic(self, transition: Transition, mode: ValueIn) -> None:
        """Declares a periodic transition; one that changes no mode only ends steps."""
        ticks = Ticks(transition.period, transition.offset)
        if transition.mode == "mode":
            DeclareTicks(self, ticks, None)
            return
        change = partial(_Change, mode)
        weak_change = self._Keep(change)
        if transition.is_discrete:
            self.discrete_ticks = (*self.discrete_ticks, ticks)
            self.DeclarePeriodicDiscreteUpdateEvent(
                ticks.period, ticks.offset, weak_change
            )
            return
        DeclareTicks(self, ticks, change)
        if ticks.period < math.inf:
            self.ticks = (*self.ticks, ticks)

    def _DeclareGuard(self, name: str, guard: ValueIn, mode: ValueIn) -> None:
        """Adds a transition's guard to the witness functions."""

        def Calc(context: Context) -> float:
            return float(guard(context)[0])

        witness = self.MakeWitnessFunction(
            name,
            WitnessFunctionDirection.kNegativeThenNonNegative,
            self._Keep(Calc),
            UnrestrictedUpdateEvent(self._Keep(partial(_Change, mode))),
        )
        self._kernel_witnesses = (*self._kernel_witnesses, witness)

    def _CheckGuards(self, context: Context, values: DiscreteValues) -> EventStatus:
        """Changes the mode at the end of a step where guards are at least 0."""
        if context.get_accuracy() is None and not self._has_warned:
            self._has_warned = True
            self._WarnOfAccuracy()
        is_due = self.ChangeModes(context, values)
        return EventStatus.Succeeded() if is_due else EventStatus.DidNothing()

    def ChangeModes(self, context: Context, values: DiscreteValues) -> bool:
        """Makes the transitions whose guards are at least 0; returns if there are any.

        Args:
            context: The Context of the block.
            values: The values that are changed.
        """
        due = [
            mode
            for guard, mode in self.transitions.values()
            if guard is not None and guard(context)[0] >= 0
        ]
        for mode in due:
            _Change(mode, context, values)
        return bool(due)

    def _WarnOfAccuracy(self) -> None:
        """Warns that a Simulator steps across the events of the block."""
        name = self.GetSystemPathname().removeprefix("::")
        warnings.warn(
            f"{name}: no event is located, because the Context has no accuracy, and "
            "the run is off by some per cent after a contact. Call "
            "simulator.get_mutable_context().SetAccuracy(1e-4) before the run, or use "
            "the Simulator of teleop_drake.MakeSimulator(diagram, config), which also "
            "limits the steps.",
            stacklevel=2,
        )


def _Change(mode: ValueIn, context: Context, *others: Any) -> None:
    """Sets the elements of the mode in which the new mode differs from the old one.

    Args:
        mode: The new mode.
        others: The further arguments of Drake's callback. The last one is the State or
            the DiscreteValues to change; a witness function's event may precede it.
    """
    target = others[-1]
    if isinstance(target, State):
        target = target.get_mutable_discrete_state()
    values = target.get_mutable_vector(0)
    before = context.get_discrete_state_vector().value()
    after = mode(context)
    for i in np.flatnonzero(after != before).tolist():
        values.SetAtIndex(i, after[i])

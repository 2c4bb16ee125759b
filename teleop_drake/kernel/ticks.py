"""Periodic updates of blocks. At one instant, all see what was there before them.

Drake computes when a periodic event happens in floating point, and 15 * 0.02 is less
than 3 * 0.1: of two blocks that sample every 20 and 100 ms, the second one would see
what the first one has just made, or not, as the rounding has it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from teleop_drake.kernel.callbacks import Weakly
from teleop_drake.numerics.instants import same_within

# Longer than any simulation: an event with this period happens once.
_ONCE = 1e12


@dataclass(frozen=True)
class Ticks:
    """The instants offset + k period in s, k = 0, 1, ...; an infinite period: once."""

    period: float
    offset: float = 0.0

    def At(self, time: float) -> int | None:
        """Returns the number of the tick at a time (s), None if there is none."""
        k = self._Nearest(time)
        is_at_tick = abs(self._TimeOf(k) - time) <= same_within(time)
        return k if is_at_tick else None

    def After(self, time: float) -> float:
        """Returns when the first tick after a time (s) is, s."""
        k = self._Nearest(time)
        is_after = self._TimeOf(k) > time + same_within(time)
        return self._TimeOf(k if is_after else k + 1)

    def _Nearest(self, time: float) -> int:
        """Returns the number of the tick that is nearest to a time, in s."""
        return max(round((time - self.offset) / self.period), 0)

    def _TimeOf(self, k: int) -> float:
        """Returns when a tick is, s: with the rounding of Drake's."""
        return self.offset + k * self.period


def EndStep(context: Context) -> EventStatus:
    """Does nothing: it is an event for a step of the solver to end at."""
    return EventStatus.DidNothing()


def DeclareTicks(
    block: LeafSystem, ticks: Ticks, update: Callable[[Context, State], None] | None
) -> None:
    """Declares an unrestricted update at each tick.

    A step of the solver ends at each. The update is made at the end of the first step
    that ends at the tick but for rounding, such as a step that ends at another block's
    tick: together with that one's update.

    Args:
        block: What is updated. The number of the last tick is an abstract state of it.
        update: A method of the block, or a function that it keeps, as Drake calls it;
            None: steps end there.
    """
    if update is not None and ticks.period == math.inf:
        block.DeclarePeriodicUnrestrictedUpdateEvent(
            _ONCE, ticks.offset, Weakly(update)
        )
        return
    period = min(ticks.period, _ONCE)
    block.DeclarePeriodicPublishEvent(period, ticks.offset, EndStep)
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

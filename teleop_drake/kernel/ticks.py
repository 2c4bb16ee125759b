"""Periodic updates of blocks, all of which use the values before their instant.

Drake computes the times of periodic events in floating point, and 15 * 0.02 is less
than 3 * 0.1. If two blocks sample every 20 and 100 ms, rounding would therefore decide
whether the second one reads the value before or after the first one's update.
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
    """The instants offset + k period in s, k = 0, 1, ...; one if period is infinite."""

    period: float
    offset: float = 0.0

    def At(self, time: float) -> int | None:
        """Returns the number of the tick at a time in s, None if there is none."""
        k = self._Nearest(time)
        is_at_tick = abs(self._TimeOf(k) - time) <= same_within(time)
        return k if is_at_tick else None

    def After(self, time: float) -> float:
        """Returns the time in s of the first tick after a time in s."""
        k = self._Nearest(time)
        is_after = self._TimeOf(k) > time + same_within(time)
        return self._TimeOf(k if is_after else k + 1)

    def _Nearest(self, time: float) -> int:
        """Returns the number of the tick that is nearest to a time, in s."""
        return max(round((time - self.offset) / self.period), 0)

    def _TimeOf(self, k: int) -> float:
        """Returns the time of a tick in s, rounded as Drake rounds it."""
        return self.offset + k * self.period


def EndStep(context: Context) -> EventStatus:
    """Does nothing. Its event makes a step of the solver end there."""
    return EventStatus.DidNothing()


def DeclareTicks(
    block: LeafSystem, ticks: Ticks, update: Callable[[Context, State], None] | None
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

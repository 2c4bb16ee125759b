"""Delays of continuous signals in Drake, made from the Delays of a kernel."""

import math
import warnings
import weakref
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    DiscreteValues,
    EventStatus,
    State,
)

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.kernel.events import DeclareTicks, Ticks, Weakly
from teleop_drake.loops.kernel.kernel import Delay
from teleop_drake.loops.numerics.bisection import halve
from teleop_drake.loops.numerics.sample_history import NUM_KEPT, SampleHistory

# Drake stretches a step by up to one per cent to end it on an event.
_STRETCH = 0.011

# The keys of a delay that varies are multiples of this number of seconds, so that both
# sides of a jump have equal keys although t - T(t) is rounded. Keys are exact for times
# up to some hours.
_KEY_STEP = 2.0**-36

CLOSE = 2 * _KEY_STEP
"""Times of samples that differ by less than this, in s, count as equal."""

# In s; dense enough for the motion of hands and haptic devices.
_DEFAULT_SAMPLE_INTERVAL = 0.01


@dataclass(frozen=True)
class SentSignal:
    """The input signal of a delay line up to some time.

    Attributes:
        history: The samples of the signal.
        shift: The key of each sample minus the time when it was taken, s.
    """

    history: SampleHistory
    shift: float

    @property
    def times(self) -> Array:
        """The times when the samples were taken, s; two equal times mark a jump."""
        return np.array(self.history.times) - self.shift

    def At(self, time: float, *, is_after: bool) -> Array:
        """Returns the signal at a time in s, after or before a jump at that time."""
        key = time + self.shift
        begin = bisect_left(self.history.times, key - CLOSE)
        end = bisect_right(self.history.times, key + CLOSE)
        if begin == end:
            return self.history.eval(key)
        value: Array = self.history.values[end - 1 if is_after else begin]
        return value


class DelayLine:
    """Stores the samples of a block's signal and delivers the signal after a delay.

    The state has two parts. An abstract value holds the samples taken at the
    integrator's own steps. A discrete state (1 + size) describes the last step whose
    events made the signal jump: the key of that step, -infinity if there was none, and
    the value after the events. The samples are joined by eight-point polynomials which
    never reach across a jump and avoid non-smooth points, so a smooth signal is delayed
    with an error of O(step^8).

    An input that jumps because of an event (of an unrestricted update) is recorded on
    both sides of the jump, and the output jumps exactly a delay later. At that very
    instant the output keeps the value before the jump until the step that ends there is
    complete: a step that ends at NextJumpTime() is integrated on one side of the jump.
    Drake executes all discrete updates of an instant together, and the delay line's own
    update is one of them. A jump made by another one is therefore recorded at that
    instant only if the delay line's update is executed once more. The Simulator of
    MakeSimulator() does so if a block has periodic discrete updates of one period.
    Otherwise the jump is recorded at the end of the next step, with a warning.

    A sample is stored by the first events of the step that follows it. If an input, a
    state or a parameter of the Context is changed before these events, the sample has
    the value after the change. Store() takes the sample beforehand, so that the change
    is a jump. In Drake's own Simulator, AdvancePendingEvents() before the change does.

    The samples are stored under ascending keys, which are times in s: the time of
    arrival if the delay is constant, else the time when the sample was taken. The
    delayed instants of a jump compare equal.

    The delay line does not extrapolate, so no step can be longer than the shortest
    delay.

    A constant delay is a numeric parameter of the block. It may differ from one run to
    the next, and must not change within a run.

    Attributes:
        signal: The input port.
        tickets: The prerequisites of the output.
        repeating: The Simulators, or parts of them, that execute the updates of an
            instant until no signal changes any more.
        stores_bends: Whether SetSent() stores the arrivals of bends.

    Args:
        block: The block, which has declared its inputs and its parameters.
        delay: The delay in the block's kernel.
        parameter: The name of the block's parameter that is the constant delay; not
            used if the delay varies.
    """

    stores_bends = True

    def __init__(self, block: Any, delay: Delay, parameter: str):
        self._block = block
        self._delay = delay
        self._parameter = parameter
        self.signal = block.GetInputPort(delay.signal)
        size = self.signal.size()
        self._jump = block.DeclareDiscreteState([-math.inf, *np.zeros(size)])
        history = AbstractValue.Make(SampleHistory())
        self._history = block.DeclareAbstractState(history)
        self.tickets = {
            block.time_ticket(),
            block.abstract_state_ticket(self._history),
            block.all_parameters_ticket(),
        }
        shortest = delay.shortest if callable(delay.time) else delay.time
        if isinstance(shortest, str):
            shortest = math.inf
        interval = _SampleInterval(delay.max_sample_interval, shortest)
        if interval < math.inf:
            DeclareTicks(block, Ticks(interval), None)
        block.DeclarePerStepUnrestrictedUpdateEvent(Weakly(self._RecordBeforeEvents))
        block.DeclarePerStepDiscreteUpdateEvent(Weakly(self._RecordAfterEvents))
        self.repeating: weakref.WeakSet[Any] = weakref.WeakSet()
        self._has_warned = False

    def IsUnderWay(self, context: Context) -> bool:
        """Returns whether a sample has been stored."""
        return bool(self._GetHistory(context).times)

    def LongestStep(self, context: Context) -> float:
        """Returns the shortest delay in s, which no step of the solver may exceed."""
        time = self._DelayIn(context)
        return self._delay.shortest if callable(time) else time

    def _DelayIn(self, context: Context) -> float | Callable[[float], float]:
        """Returns the constant delay of a Context in s, or the function T(t)."""
        if callable(self._delay.time):
            return self._delay.time
        assert not isinstance(self._delay.time, str)
        values = self._block.kernel_parameters.In(context).values
        return values.get(self._parameter, self._delay.time)

    def NextJumpTime(self, context: Context) -> float:
        """Returns when the output jumps next, s; infinity if no jump is under way."""
        history = self._GetHistory(context)
        if not history.times:
            return self._FetchTime(self._Keys(context)[0])
        jump = min(history.jumps_after(history.now), default=math.inf)
        if jump == math.inf and self._HasJumped(context, history):
            jump = history.times[-1]
        return self._FetchTime(jump)

    def Eval(self, context: Context) -> Array:
        """Returns the delayed signal.

        Raises:
            RuntimeError: If the signal is not known yet, because a step is too long.
        """
        history = self._GetHistory(context)
        times = history.times
        _, key = self._Keys(context)
        i = bisect_left(times, key)
        if i < len(times) and key == times[i]:
            # A jump at this very instant counts only after the step has ended here.
            if key <= history.now:
                return history.values[bisect_right(times, key) - 1]
            if i > 0:
                return history.values[i]
        if i == 0:
            return np.array(self._delay.initial_value)
        if i == len(times) and key > times[-1] + _STRETCH * self.LongestStep(context):
            raise RuntimeError(
                f"{type(self._block).__name__} {self._block.get_name()!r}: evaluated "
                f"{key - history.now:.6g} s after the last step; allowed: at most "
                f"the delay, {self.LongestStep(context):.6g} s, which the integrator's "
                "longest step must not exceed"
            )
        return history.eval(key)

    def _Keys(self, context: Context) -> tuple[float, float]:
        """Returns the keys of the sample that is taken now and of that delivered now.

        They are the keys at the time of the Context; see _KeysAt().
        """
        return _KeysAt(context.get_time(), self._DelayIn(context))

    def _FetchTime(self, key: float) -> float:
        """Returns when the sample with a key is delivered, s; infinity: never."""
        delay = self._delay.time
        end = self._delay.end
        if not callable(delay) or key == math.inf:
            return key
        # The solution t of t - T(t) = key: an interval that contains it, and bisection.
        early = key
        late = min(key + delay(key), end)
        while late - delay(late) < key:
            if late == end:
                return math.inf
            early = late
            late = min(late + delay(late), end)
        return halve(lambda time: time - delay(time) < key, early, late)[1]

    def _GetHistory(self, context: Context) -> SampleHistory:
        return context.get_abstract_state(self._history).get_value()

    def _HasJumped(self, context: Context, history: SampleHistory) -> bool:
        """Returns whether the events of the last step made the signal jump."""
        key: float = context.get_discrete_state(self._jump).GetAtIndex(0)
        return history.times[-1:] == (key,)

    def _RecordBeforeEvents(self, context: Context, state: State) -> None:
        """Adds a sample to the history, and the jump at the end of the last step."""
        longer = self._HistoryNow(context)
        if longer is not self._GetHistory(context):
            state.get_mutable_abstract_state(self._history).set_value(longer)

    def Store(self, context: Context) -> None:
        """Stores the signal at the time of a Context, if its events are still ahead."""
        history = self._HistoryNow(context)
        if history is not self._GetHistory(context):
            # A jump that is delivered at this very instant is still ahead, too.
            before = math.nextafter(history.now, -math.inf)
            context.SetAbstractState(self._history, replace(history, now=before))

    def StoreJump(self, context: Context) -> None:
        """Stores that the signal has jumped since Store(), if it has."""
        history = self._GetHistory(context)
        value = self.signal.Eval(context)
        if history.times and value.tolist() != history.values[-1].tolist():
            context.SetDiscreteState(self._jump, [history.times[-1], *value])

    def _HistoryNow(self, context: Context) -> SampleHistory:
        """Returns the history with a sample at the time of the Context.

        Raises:
            ScenarioError: If the delay was changed while a signal is under way.
        """
        history = self._GetHistory(context)
        key, now = self._Keys(context)
        if self.is_constant and history.times:
            delay = history.times[-1] - history.now
            if abs(key - now - delay) > CLOSE:
                allowed = f"{delay:g} s while a signal is under way"
                name = f"{self._block.get_name()}.{self._parameter}"
                Refuse(name, round(key - now, 12), allowed)
        if now <= history.now:
            return history
        if history.times and key <= history.times[-1]:
            # Two steps so close that their keys are rounded to one.
            return replace(history, now=now)
        append = partial(
            SampleHistory.append, now=now, spacing=self.LongestStep(context) / 1024
        )
        if self._HasJumped(context, history):
            jump = context.get_discrete_state(self._jump).value()[1:]
            history = append(history, history.times[-1], jump)
        return append(history, key, self.signal.Eval(context))

    @property
    def is_constant(self) -> bool:
        """Whether the delay does not vary in a run."""
        return self._delay.is_constant

    def Sent(self, context: Context) -> SentSignal:
        """Returns the input signal up to the time of a Context."""
        delay = self._DelayIn(context)
        shift = 0.0 if callable(delay) else delay
        return SentSignal(self._HistoryNow(context), shift)

    def JumpsAhead(self, context: Context) -> list[float]:
        """Returns the times in s, from a Context's on, when jumps and bends arrive."""
        _, now = self._Keys(context)
        keys = self._HistoryNow(context).jumps_after(now - CLOSE)
        return [self._FetchTime(key) for key in keys]

    def SetSent(
        self, context: Context, times: Array, values: Array, bends: Sequence[float]
    ) -> None:
        """Sets the input signal before the time of a Context.

        Args:
            times: The times of the samples, s, ascending (k); two equal times mark a
                jump. Samples from the time of the Context on are left out.
            values: The samples (k, size).
            bends: The times in s when a jump or a bend arrives, so that a step has to
                end.
        """
        delay = self._DelayIn(context)
        end = context.get_time()
        # Leave out a sample that repeats the one before.
        is_new = np.append(True, np.diff(times) > CLOSE)
        is_new[1:] |= (values[1:] != values[:-1]).any(axis=1)
        is_kept = is_new & (times < end - CLOSE)
        if not is_kept.any():
            return
        keys = [_KeysAt(time, delay) for time in times[is_kept].tolist()]
        taken = [key for key, _ in keys]
        _, now = keys[-1]
        # Keep the samples ahead, and some before them for the polynomials.
        first = max(0, bisect_left(taken, now) - NUM_KEPT)
        history = SampleHistory(
            times=tuple(taken[first:]),
            values=tuple(values[is_kept][first:]),
            now=now,
            bends=tuple(_KeysAt(max(x, end), delay)[1] for x in bends),
        )
        context.SetAbstractState(self._history, history)

    def _RecordAfterEvents(
        self, context: Context, values: DiscreteValues
    ) -> EventStatus:
        """Stores the signal's value after the events if these made it jump."""
        history = self._GetHistory(context)
        value = self.signal.Eval(context)
        if value.tolist() != history.values[-1].tolist():
            jump = [history.times[-1], *value]
        elif self._HasJumped(context, history):
            jump = [-math.inf, *value]
        else:
            # An unchanged state spares Drake a new evaluation of the diagram.
            return EventStatus.DidNothing()
        values.set_value(self._jump, jump)
        return EventStatus.Succeeded()

    def BeginStep(self, context: Context) -> None:
        """Warns if an update at the start of a step made an unrecorded jump."""
        if self.repeating or self._has_warned:
            return
        history = self._GetHistory(context)
        is_recorded = history.now == self._Keys(context)[1]
        if not is_recorded or self._HasJumped(context, history):
            return
        if self.signal.Eval(context).tolist() == history.values[-1].tolist():
            return
        self._has_warned = True
        name = self._block.GetSystemPathname().removeprefix("::")
        warnings.warn(
            f"{name}: its signal jumps by a discrete update, as a held one does, and "
            "Drake's own Simulator delays the jump as a ramp of one step. Use the "
            "Simulator of teleop_drake.MakeSimulator(diagram, config).",
            stacklevel=2,
        )


def _SampleInterval(max_sample_interval: float | None, shortest: float) -> float:
    if max_sample_interval is None:
        return min(shortest, _DEFAULT_SAMPLE_INTERVAL)
    if not (0 < max_sample_interval <= shortest or max_sample_interval == math.inf):
        allowed = f"more than 0, at most the delay, {shortest} s, or infinity"
        Refuse("max_sample_interval", max_sample_interval, allowed)
    return max_sample_interval


def _KeysAt(
    time: float, delay: float | Callable[[float], float]
) -> tuple[float, float]:
    """Returns the keys of the sample taken and of the sample delivered at a time in s.

    Keys of a delay that varies are rounded to multiples of _KEY_STEP.
    """
    if not callable(delay):
        return time + delay, time
    taken, delivered = (
        round(t / _KEY_STEP) * _KEY_STEP for t in (time, time - delay(time))
    )
    return taken, delivered

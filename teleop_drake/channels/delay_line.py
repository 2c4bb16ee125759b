"""What the continuous delays have in common: a signal under way."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    EventStatus,
    LeafSystem,
    State,
)

from teleop_drake.kernel.ticks import DoNothing
from teleop_drake.numerics.sample_history import SampleHistory
from teleop_drake.validation import CheckNumber, Refuse

# Drake stretches a step by up to one per cent to end it on an event.
_STRETCH = 0.011

# Dense enough for what hands and haptic devices do.
_DEFAULT_SAMPLE_INTERVAL = 0.01


class DelayLine(LeafSystem):
    """Base of the systems that keep a signal under way and deliver it later.

    The samples are kept under keys, times in s that ascend: StoreKey() of the time
    when they are taken. At any time the signal with the FetchKey() of that time is
    delivered. A subclass defines both, and the inverse FetchTime(). The delayed
    instants of a jump compare equal: FetchKey(FetchTime(key)) == key.

    | port | name           | size | unit      |
    |------|----------------|------|-----------|
    | in   | signal         | size | any       |
    | out  | delayed_signal | size | of signal |

    State: the samples taken at the integrator's own steps (one abstract value), and of
    the last step whose events made the signal jump the key and the value after them
    (discrete, 1 + size; the key is -infinity if there was none). The samples are joined
    by eight-point polynomials which never reach across a jump and avoid non-smooth
    points, so a smooth signal is delayed with an error of O(step^8).

    Initial value: `initial_value` is delivered until the first sample arrives.

    Direct feedthrough: none.

    It does not extrapolate, so no step can be longer than the delay.

    Args:
        size: Width of the signal, >= 1.
        initial_value: What is delivered at first (size); zeros if None.
        shortest_delay: Least time under way in s, > 0.
        max_sample_interval: Longest time between two samples in s, in
            (0, shortest_delay]; infinity: the steps are as they come. None takes
            0.01 s, or the delay if that is less.

    Raises:
        ValueError: If a parameter is outside its range.
    """

    def __init__(
        self,
        *,
        size: int,
        initial_value: Sequence[float] | None,
        shortest_delay: float,
        max_sample_interval: float | None,
    ):
        LeafSystem.__init__(self)
        CheckChannel(delay=shortest_delay, size=size, initial_value=initial_value)
        if max_sample_interval is None:
            max_sample_interval = min(shortest_delay, _DEFAULT_SAMPLE_INTERVAL)
        if not (0 < max_sample_interval <= shortest_delay) and (
            max_sample_interval != math.inf
        ):
            allowed = f"more than 0, at most the delay, {shortest_delay} s, or infinity"
            Refuse("max_sample_interval", max_sample_interval, allowed)
        self._shortest_delay = float(shortest_delay)
        self._initial_value = (
            [0.0] * size if initial_value is None else [float(x) for x in initial_value]
        )
        self._spacing = shortest_delay / 1024
        self._signal = self.DeclareVectorInputPort("signal", size)
        self._jump = self.DeclareDiscreteState([-math.inf, *np.zeros(size)])
        self._history = self.DeclareAbstractState(AbstractValue.Make(SampleHistory()))
        self.DeclareVectorOutputPort(
            "delayed_signal",
            size,
            self._CalcDelayedSignal,
            prerequisites_of_calc={
                self.time_ticket(),
                self.abstract_state_ticket(self._history),
            },
        )
        if max_sample_interval < math.inf:
            self.DeclarePeriodicPublishEvent(max_sample_interval, 0.0, DoNothing)
        self.DeclarePerStepUnrestrictedUpdateEvent(self._RecordBeforeEvents)
        self.DeclarePerStepDiscreteUpdateEvent(self._RecordAfterEvents)

    @property
    def longest_step(self) -> float:
        """The least time under way in s: no step of the solver may be longer."""
        return self._shortest_delay

    def StoreKey(self, time: float) -> float:
        """Returns the key under which the sample taken at a time is kept.

        Args:
            time: In s.
        """
        raise NotImplementedError  # Every subclass has its own.

    def FetchKey(self, time: float) -> float:
        """Returns the key of the sample that is delivered at a time.

        Args:
            time: In s.
        """
        raise NotImplementedError  # Every subclass has its own.

    def FetchTime(self, key: float) -> float:
        """Returns when the sample with a key is delivered, s; infinity: never.

        Args:
            key: As from StoreKey().
        """
        raise NotImplementedError  # Every subclass has its own.

    def NextJumpTime(self, context: Context) -> float:
        """Returns when the output will jump next (s), infinity if no jump is known.

        A step that ends at this very time is not disturbed by the jump.

        Args:
            context: The Context of this block.
        """
        history = self._GetHistory(context)
        if not history.times:
            return self.FetchTime(self.StoreKey(context.get_time()))
        for jump in history.jumps:
            if jump > history.now:
                return self.FetchTime(jump)
        if self._HasJumped(context, history):
            return self.FetchTime(history.times[-1])
        return math.inf

    def _GetHistory(self, context: Context) -> SampleHistory:
        history: SampleHistory = context.get_abstract_state(self._history).get_value()
        return history

    def _HasJumped(self, context: Context, history: SampleHistory) -> bool:
        """Returns whether the events of the last step made the signal jump."""
        key: float = context.get_discrete_state_vector().GetAtIndex(0)
        return key == history.times[-1]

    def _RecordBeforeEvents(self, context: Context, state: State) -> None:
        time = context.get_time()
        history = self._GetHistory(context)
        jump = None
        if history.times and self._HasJumped(context, history):
            jump = context.get_discrete_state_vector().value()[1:]
        longer = history.record(
            self.StoreKey(time),
            self._signal.Eval(context),
            jump=jump,
            now=self.FetchKey(time),
            spacing=self._spacing,
        )
        if longer is not history:
            state.get_mutable_abstract_state(self._history).set_value(longer)

    def _RecordAfterEvents(
        self, context: Context, values: DiscreteValues
    ) -> EventStatus:
        history = self._GetHistory(context)
        value = self._signal.Eval(context)
        if value.tolist() != history.values[-1].tolist():
            jump = [history.times[-1], *value]
        elif self._HasJumped(context, history):
            jump = [-math.inf, *value]
        else:
            # The surroundings need not be evaluated again.
            return EventStatus.DidNothing()
        values.set_value(self._jump, jump)
        return EventStatus.Succeeded()

    def _CalcDelayedSignal(self, context: Context, output: BasicVector) -> None:
        key = self.FetchKey(context.get_time())
        history = self._GetHistory(context)
        value = self._Deliver(history, key)
        output.SetFromVector(self._initial_value if value is None else value)

    def _Deliver(
        self, history: SampleHistory, key: float
    ) -> NDArray[np.float64] | None:
        """Returns the signal that has a key, None before the first sample."""
        times = history.times
        i = bisect_left(times, key)
        if 0 < i < len(times) and key < times[i]:  # The usual case, for speed.
            return history.eval_interval(i - 1, key)
        if not times or key < times[0]:
            return None
        if key > times[-1] + _STRETCH * self._shortest_delay:
            raise RuntimeError(
                f"{type(self).__name__} {self.get_name()!r}: evaluated "
                f"{key - history.now:.6g} s after the last step; allowed: at most "
                f"the delay, {self._shortest_delay:.6g} s, which the integrator's "
                "longest step must not exceed"
            )
        if i == len(times):
            return history.eval(key)
        # A jump at this very instant has happened once the step has ended here.
        if key <= history.now:
            i = bisect_right(times, key) - 1
        elif i == 0:
            return None
        value: NDArray[np.float64] = history.values[i]
        return value


def CheckChannel(
    *, delay: float, size: int, initial_value: Sequence[float] | None
) -> None:
    """Refuses parameters that no kind of channel can have.

    Args:
        delay: Delay in s, finite and >= 0.
        size: Width of the signal, >= 1.
        initial_value: None or a vector of that size.

    Raises:
        ScenarioError: If one of them is refused.
    """
    CheckNumber("delay", delay, "s", minimum=0)
    CheckNumber("size", size, minimum=1)
    if initial_value is not None and len(initial_value) != size:
        Refuse("initial_value", initial_value, f"{size} numbers or null")

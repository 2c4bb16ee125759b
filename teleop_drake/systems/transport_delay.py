"""Exact transport delay of a vector signal."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    EventStatus,
    LeafSystem,
    State,
)

from teleop_drake.laws.interpolation import (
    Newton,
    evaluate_newton,
    interval_polynomials,
)

# Drake stretches a step by up to one per cent to end it on an event.
_STRETCH = 0.011


# Dense enough for what hands and haptic devices do.
_DEFAULT_SAMPLE_INTERVAL = 0.01

# How many samples stay in the history after they were delivered.
_NUM_KEPT = 32


@dataclass(frozen=True)
class _History:
    """The samples that are still under way, keyed by their time of ARRIVAL.

    Immutable, so that a copy of the state is the object itself: a Context may be
    cloned at every step for the price of a reference.
    """

    times: tuple[float, ...] = ()
    values: tuple[tuple[float, ...], ...] = ()
    # When the last step ended and its sample departed.
    now: float = -math.inf
    # What Eval() has worked out so far: a function of the samples, not a state.
    polynomials: dict[int, list[Newton]] = field(default_factory=dict, compare=False)

    def __deepcopy__(self, memo: dict[int, Any]) -> "_History":
        return self

    def Append(
        self, time: float, value: tuple[float, ...], *, now: float, spacing: float
    ) -> "_History":
        """Adds a sample, drops what has been delivered and what is redundant."""
        keep = len(self.times)
        if (
            keep >= 2
            and self.times[-2] < self.times[-1] < time
            and time - self.times[-2] < spacing
        ):
            keep -= 1  # The sample between the two adds nothing but length.
        first = 0
        # The samples just before the oldest one in use serve its stencil.
        while first + _NUM_KEPT < keep and self.times[first + _NUM_KEPT] < now:
            first += 1
        return _History(
            (*self.times[first:keep], time), (*self.values[first:keep], value), now
        )

    def Eval(self, time: float) -> list[float]:
        """Interpolates at a time between (or just behind) the arrivals."""
        if len(self.times) == 1:
            return list(self.values[0])
        i = min(max(bisect_left(self.times, time) - 1, 0), len(self.times) - 2)
        if self.times[i] == self.times[i + 1]:
            return list(self.values[i + 1])  # Just behind a jump.
        polynomials = self.polynomials.get(i)
        if polynomials is None:
            polynomials = interval_polynomials(self.times, self.values, i)
            self.polynomials[i] = polynomials
        return [evaluate_newton(polynomial, time) for polynomial in polynomials]


class TransportDelay(LeafSystem):
    """Delays a vector signal by an exact, constant time.

        delayed_signal(t) = signal(t - delay)    for t > t0 + delay
                          = initial_value        before

    where t0 is the time at which the simulation starts. The delay need not be a
    multiple of anything. This is the block T of Fig. 2.1.

    | port | name           | size | unit      |
    |------|----------------|------|-----------|
    | in   | signal         | size | any       |
    | out  | delayed_signal | size | of signal |

    State: the samples taken at the integrator's own steps during the last `delay`
    seconds (one abstract value), and the last value seen after the events of a step
    (discrete, size). The samples are joined by eight-point polynomials which never
    reach across a jump and avoid kinks, so a smooth signal is delayed with an error
    of O(step^8).

    Jumps: an input that jumps because of an event (of an unrestricted update) is
    recorded on both sides of the jump, and the output jumps exactly `delay` later.
    At that very instant the output keeps the value before the jump until the step
    that ends there is complete: a step that ends at NextJumpTime() is integrated
    on one side of the jump. A jump made by a discrete update is recorded at the end
    of the step which follows it.

    Initial value: `initial_value` is delivered until the first sample arrives.

    Direct feedthrough: none, unless delay is 0. Then the block is a pass-through
    with neither state nor events.

    Steps: a periodic event that does nothing ends a step at least once per
    `max_sample_interval`, also in a diagram that has nothing to integrate.

    It does not extrapolate, so no step can be longer than the delay. It does not
    report derivatives and cannot vary its delay.

    Args:
        delay: Delay in s, >= 0.
        size: Width of the signal, >= 1.
        initial_value: What is delivered at first (size); zeros if None.
        max_sample_interval: Longest time between two samples in s, in (0, delay];
            None takes 0.01 s, or the delay if that is less.

    Raises:
        ValueError: If a parameter is outside its range.
    """

    def __init__(
        self,
        *,
        delay: float,
        size: int,
        initial_value: Sequence[float] | None = None,
        max_sample_interval: float | None = None,
    ):
        LeafSystem.__init__(self)
        check_channel(delay=delay, size=size, initial_value=initial_value)
        self._delay = float(delay)
        self._initial_value = (
            [0.0] * size if initial_value is None else [float(x) for x in initial_value]
        )
        self._spacing = delay / 1024
        self._signal = self.DeclareVectorInputPort("signal", size)
        if delay == 0:
            self.DeclareVectorOutputPort(
                "delayed_signal",
                size,
                self._CopySignal,
                prerequisites_of_calc={self._signal.ticket()},
            )
            return
        if max_sample_interval is None:
            max_sample_interval = min(delay, _DEFAULT_SAMPLE_INTERVAL)
        if not 0 < max_sample_interval <= delay:
            raise ValueError(
                f"max_sample_interval: {max_sample_interval}; allowed: more than 0, at "
                f"most the delay, {delay} s"
            )
        self._latest = self.DeclareDiscreteState(size)
        self._history = self.DeclareAbstractState(AbstractValue.Make(_History()))
        self.DeclareVectorOutputPort(
            "delayed_signal",
            size,
            self._CalcDelayedSignal,
            prerequisites_of_calc={
                self.time_ticket(),
                self.abstract_state_ticket(self._history),
            },
        )
        self.DeclarePeriodicPublishEvent(
            max_sample_interval, 0.0, lambda context: EventStatus.DidNothing()
        )
        self.DeclarePerStepUnrestrictedUpdateEvent(self._RecordBeforeEvents)
        self.DeclarePerStepDiscreteUpdateEvent(self._RecordAfterEvents)

    @property
    def delay(self) -> float:
        """The delay in s."""
        return self._delay

    def NextJumpTime(self, context: Context) -> float:
        """Returns when the output will jump next (s), infinity if no jump is known.

        A step that ends at this very time is not disturbed by the jump.

        Args:
            context: The Context of this block.
        """
        if self._delay == 0:
            return math.inf
        history = self._GetHistory(context)
        if not history.times:
            return context.get_time() + self._delay
        jumps = [history.times[0], *self._PendingJump(context, history)]
        jumps += [
            a
            for a, b in zip(history.times[1:], history.times[:-1], strict=True)
            if a == b
        ]
        return min((jump for jump in jumps if jump > history.now), default=math.inf)

    def _GetHistory(self, context: Context) -> _History:
        return context.get_abstract_state(self._history).get_value()

    def _PendingJump(self, context: Context, history: _History) -> list[float]:
        latest = context.get_discrete_state(self._latest).CopyToVector()
        jumped = tuple(latest.tolist()) != history.values[-1]
        return [history.times[-1]] if jumped else []

    def _RecordBeforeEvents(self, context: Context, state: State) -> None:
        time = context.get_time()
        arrival = time + self._delay
        history = self._GetHistory(context)
        if time <= history.now:
            return
        if history.times and arrival <= history.times[-1]:
            # Two steps so close that their arrivals are rounded to one.
            state.get_mutable_abstract_state(self._history).set_value(
                replace(history, now=time)
            )
            return
        for jump in self._PendingJump(context, history) if history.times else []:
            latest = context.get_discrete_state(self._latest).CopyToVector()
            history = history.Append(
                jump, tuple(latest.tolist()), now=time, spacing=self._spacing
            )
        value = tuple(self._signal.Eval(context).tolist())
        state.get_mutable_abstract_state(self._history).set_value(
            history.Append(arrival, value, now=time, spacing=self._spacing)
        )

    def _RecordAfterEvents(self, context: Context, values: DiscreteValues) -> None:
        values.set_value(self._latest, self._signal.Eval(context))

    def _CopySignal(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._signal.Eval(context))

    def _CalcDelayedSignal(self, context: Context, output: BasicVector) -> None:
        time = context.get_time()
        history = self._GetHistory(context)
        times = history.times
        if not times or time < times[0]:
            output.SetFromVector(self._initial_value)
            return
        if time > times[-1] + _STRETCH * self._delay:
            raise RuntimeError(
                f"TransportDelay {self.get_name()!r}: evaluated "
                f"{time - history.now:.6g} s after the last step; allowed: at most "
                f"the delay, {self._delay:.6g} s"
            )
        i = bisect_left(times, time)
        if i < len(times) and times[i] == time:
            # A jump at this very instant has happened once the step has ended here.
            if time <= history.now:
                i = bisect_right(times, time) - 1
            elif i == 0:
                output.SetFromVector(self._initial_value)
                return
            output.SetFromVector(history.values[i])
        else:
            output.SetFromVector(history.Eval(time))


def check_channel(
    *, delay: float, size: int, initial_value: Sequence[float] | None
) -> None:
    """Raises ValueError on parameters that no kind of channel can have.

    Args:
        delay: Delay in s, finite and >= 0.
        size: Width of the signal, >= 1.
        initial_value: None or a vector of that size.
    """
    if not (math.isfinite(delay) and delay >= 0):
        raise ValueError(f"delay: {delay}; allowed: a finite number >= 0 (s)")
    if size < 1:
        raise ValueError(f"size: {size}; allowed: an integer >= 1")
    if initial_value is not None and len(initial_value) != size:
        raise ValueError(
            f"initial_value: {len(initial_value)} elements; allowed: {size}"
        )

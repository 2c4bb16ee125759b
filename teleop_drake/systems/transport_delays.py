"""Exact transport delays of the members of an ensemble, side by side."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    EventStatus,
    LeafSystem,
    State,
)

from teleop_drake.laws.sample_history import SampleHistory
from teleop_drake.systems.delay_line import check_channel, deliver


class TransportDelays(LeafSystem):
    """Delays each element of a vector signal by its own exact, constant time.

        delayed_signal_i(t) = signal_i(t - delays_i)    for t > t0 + delays_i
                            = initial_value_i           before

    It is to the elements with one delay what a TransportDelay is to its signal, at
    the price of one system.

    | port | name           | size | unit      |
    |------|----------------|------|-----------|
    | in   | signal         | size | any       |
    | out  | delayed_signal | size | of signal |

    State: for each different delay the samples under way (together one abstract
    value), and of the last step whose events made its elements jump the key
    (discrete, one for each different delay; -infinity if there was none) and all
    values after them (size).

    Initial value: `initial_value` is delivered until the first sample arrives.

    Direct feedthrough: none.

    It samples where the integrator's steps end, and does not extrapolate: no step can
    be longer than the shortest delay.

    Args:
        delays: Delay of each element in s, > 0.
        initial_value: What each element delivers at first.

    Raises:
        ValueError: If a delay is outside its range or the sizes differ.
    """

    def __init__(self, *, delays: Sequence[float], initial_value: Sequence[float]):
        LeafSystem.__init__(self)
        size = len(delays)
        if size < 1:
            raise ValueError("delays: []; allowed: at least one")
        for delay in delays:
            check_channel(delay=delay, size=size, initial_value=initial_value)
            if delay == 0:
                raise ValueError("delays: 0; allowed: finite numbers > 0 (s)")
        self._delays = sorted(set(map(float, delays)))
        # Of the elements with each delay.
        self._places = [
            np.flatnonzero(np.asarray(delays) == delay) for delay in self._delays
        ]
        initial_values = np.array(initial_value, dtype=float)
        self._initial_values = [initial_values[places] for places in self._places]
        # Where each element stands in those of one delay after another.
        self._order = np.argsort(np.concatenate(self._places))
        self._signal = self.DeclareVectorInputPort("signal", size)
        num_delays = len(self._delays)
        self.DeclareDiscreteState([*np.full(num_delays, -math.inf), *np.zeros(size)])
        lines = self.DeclareAbstractState(
            AbstractValue.Make(_Lines((SampleHistory(),) * num_delays))
        )
        self._lines = int(lines)  # pydrake takes an int faster.
        self.DeclareVectorOutputPort(
            "delayed_signal",
            size,
            self._CalcDelayedSignal,
            prerequisites_of_calc={
                self.time_ticket(),
                self.abstract_state_ticket(lines),
            },
        )
        self.DeclarePerStepUnrestrictedUpdateEvent(self._RecordBeforeEvents)
        self.DeclarePerStepDiscreteUpdateEvent(self._RecordAfterEvents)

    def NextJumpTime(self, context: Context) -> float:
        """Returns when the output will jump next (s), infinity if no jump is known.

        A step that ends at this very time is not disturbed by the jump.

        Args:
            context: The Context of this block.
        """
        jump_keys = self._GetJumps(context)[: len(self._delays)]
        next_jump = math.inf
        for delay, history, jump_key in zip(
            self._delays, self._GetHistories(context), jump_keys, strict=True
        ):
            if not history.times:
                next_jump = min(next_jump, context.get_time() + delay)
                continue
            for jump in history.jumps:
                if jump > history.now:
                    next_jump = min(next_jump, jump)
                    break
            else:
                if jump_key == history.times[-1]:
                    next_jump = min(next_jump, jump_key)
        return next_jump

    def _GetHistories(self, context: Context) -> tuple[SampleHistory, ...]:
        lines: _Lines = context.get_abstract_state(self._lines).get_value()
        return lines.histories

    def _GetJumps(self, context: Context) -> np.ndarray:
        return context.get_discrete_state_vector().value()

    def _RecordBeforeEvents(self, context: Context, state: State) -> None:
        now = context.get_time()
        signal = self._signal.Eval(context)
        jumps = self._GetJumps(context)
        keys, values = np.split(jumps, [len(self._delays)])
        histories = []
        for delay, places, history, jump_key in zip(
            self._delays,
            self._places,
            self._GetHistories(context),
            keys.tolist(),
            strict=True,
        ):
            has_jumped = bool(history.times) and jump_key == history.times[-1]
            histories.append(
                history.Record(
                    now + delay,
                    signal[places],
                    jump=values[places] if has_jumped else None,
                    now=now,
                    spacing=delay / 1024,
                )
            )
        state.get_mutable_abstract_state(self._lines).set_value(
            _Lines(tuple(histories))
        )

    def _RecordAfterEvents(
        self, context: Context, values: DiscreteValues
    ) -> EventStatus:
        signal = self._signal.Eval(context)
        keys = []
        for places, history in zip(
            self._places, self._GetHistories(context), strict=True
        ):
            has_jumped = (signal[places] != history.values[-1]).any()
            keys.append(history.times[-1] if has_jumped else -math.inf)
        if (
            max(keys) == -math.inf
            and (self._GetJumps(context)[: len(keys)] == -math.inf).all()
        ):
            # The surroundings need not be evaluated again.
            return EventStatus.DidNothing()
        values.set_value(0, [*keys, *signal])
        return EventStatus.Succeeded()

    def _CalcDelayedSignal(self, context: Context, output: BasicVector) -> None:
        now = context.get_time()
        values = []
        for delay, initial_value, history in zip(
            self._delays,
            self._initial_values,
            self._GetHistories(context),
            strict=True,
        ):
            value = deliver(history, now, delay, self)
            values.append(initial_value if value is None else value)
        output.SetFromVector(np.concatenate(values)[self._order])


@dataclass(frozen=True)
class _Lines:
    """The histories, as immutable as they are."""

    histories: tuple[SampleHistory, ...]

    def __deepcopy__(self, memo: dict[int, Any]) -> "_Lines":
        return self

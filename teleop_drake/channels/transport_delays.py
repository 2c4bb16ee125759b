"""Exact transport delays of the members of an ensemble, side by side."""

import math
from bisect import bisect_left
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

from teleop_drake.channels.delay_line import check_channel, deliver
from teleop_drake.numerics.compiled import compiled
from teleop_drake.numerics.interpolation import (
    NUM_STENCIL_POINTS,
    evaluate_newton_within,
)
from teleop_drake.numerics.sample_history import SampleHistory


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
        # The elements as sorted by their delays: where those of each delay are, and
        # where each element is.
        ends = np.cumsum([len(places) for places in self._places]).tolist()
        self._columns = [slice(*x) for x in zip([0, *ends[:-1]], ends, strict=True)]
        self._order = np.argsort(np.concatenate(self._places))
        self._evaluate = compiled(evaluate_newton_within)
        self._signal = self.DeclareVectorInputPort("signal", size)
        num_delays = len(self._delays)
        self.DeclareDiscreteState([*np.full(num_delays, -math.inf), *np.zeros(size)])
        lines = self.DeclareAbstractState(
            AbstractValue.Make(
                _Lines(
                    (SampleHistory(),) * num_delays,
                    np.zeros((2, NUM_STENCIL_POINTS, size)),
                    np.full((2, num_delays), math.nan),
                )
            )
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
            self._delays, self._GetLines(context).histories, jump_keys, strict=True
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

    def _GetLines(self, context: Context) -> "_Lines":
        lines: _Lines = context.get_abstract_state(self._lines).get_value()
        return lines

    def _GetJumps(self, context: Context) -> np.ndarray:
        return context.get_discrete_state_vector().value()

    def _RecordBeforeEvents(self, context: Context, state: State) -> None:
        now = context.get_time()
        signal = self._signal.Eval(context)
        jumps = self._GetJumps(context)
        keys, values = jumps[: len(self._delays)], jumps[len(self._delays) :]
        lines = self._GetLines(context)
        histories = []
        for delay, places, history, jump_key in zip(
            self._delays,
            self._places,
            lines.histories,
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
        # Of what is known only the polynomials at this time do not change.
        begins, ends = lines.spans
        spans = np.where((begins < now) & (now < ends), lines.spans, math.nan)
        state.get_mutable_abstract_state(self._lines).set_value(
            _Lines(tuple(histories), lines.polynomials.copy(), spans)
        )

    def _RecordAfterEvents(
        self, context: Context, values: DiscreteValues
    ) -> EventStatus:
        signal = self._signal.Eval(context)
        histories = self._GetLines(context).histories
        last = np.concatenate([history.values[-1] for history in histories])
        has_jumped = signal != last[self._order]
        last_keys = self._GetJumps(context)[: len(histories)]
        if not has_jumped.any() and (last_keys == -math.inf).all():
            # The surroundings need not be evaluated again.
            return EventStatus.DidNothing()
        keys = [
            history.times[-1] if has_jumped[places].any() else -math.inf
            for places, history in zip(self._places, histories, strict=True)
        ]
        values.set_value(0, [*keys, *signal])
        return EventStatus.Succeeded()

    def _CalcDelayedSignal(self, context: Context, output: BasicVector) -> None:
        now = context.get_time()
        lines = self._GetLines(context)
        values, unknown = self._evaluate(lines.polynomials, lines.spans, now)
        if len(unknown) > 0:
            for i in unknown.tolist():
                self._CalcSegment(lines, i, now)
            values, _ = self._evaluate(lines.polynomials, lines.spans, now)
        output.SetFromVector(values[self._order])

    def _CalcSegment(self, lines: "_Lines", i: int, now: float) -> None:
        """Works out what the elements with the i-th delay deliver about now."""
        history, columns = lines.histories[i], self._columns[i]
        times = history.times
        j = bisect_left(times, now)
        if 0 < j < len(times) and now < times[j]:
            lines.polynomials[:, :, columns] = history.Polynomial(j - 1).table
            lines.spans[0, i] = math.nextafter(times[j - 1], math.inf)
            lines.spans[1, i] = math.nextafter(times[j], -math.inf)
            return
        # Before the first sample, or at a sample, where there may be a jump.
        value = deliver(history, now, self._delays[i], self)
        lines.polynomials[:, :, columns] = 0
        lines.polynomials[1, 0, columns] = (
            self._initial_values[i] if value is None else value
        )
        lines.spans[:, i] = now


@dataclass(frozen=True, eq=False)
class _Lines:
    """The histories, as immutable as they are.

    Attributes:
        histories: One for each delay.
        polynomials: Of the elements, sorted by their delays, as newton_polynomial()
            returns them: what has been worked out so far.
        spans: (2, M) first and last times at which those with each delay are valid.
    """

    histories: tuple[SampleHistory, ...]
    polynomials: np.ndarray
    spans: np.ndarray

    def __deepcopy__(self, memo: dict[int, Any]) -> "_Lines":
        return self

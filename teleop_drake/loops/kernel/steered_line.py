"""Delays of continuous signals in Drake whose time is a signal."""

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, EventStatus, State

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import ScenarioError, Show
from teleop_drake.loops.kernel.delay_line import CLOSE, DelayLine
from teleop_drake.loops.kernel.kernel import Delay
from teleop_drake.loops.numerics.sample_history import SampleHistory

# An output that is closer than this to a jump, in s or in lengths of the conveyor, has
# reached it.
_NEAR = 1e-8

# The share of the way to a jump that a step covers. It covers all of it if the way
# takes less than _LAST_STEP, s.
_APPROACH = 0.9
_LAST_STEP = 1e-5

# The time for which the samples on a conveyor are stored, s.
_EVER = 1e6


class _Delivered(NamedTuple):
    """What the output was at the end of the last step.

    Attributes:
        sent: When it was sent, s; behind a jump that it has reached.
        place: The place from which it came, see _Track.
        time: The time of the end of the step, s; -infinity before the first one.
        slope: The change of `place` per time.
    """

    sent: float
    place: float
    time: float
    slope: float


_NOTHING = _Delivered(0.0, 0.0, -math.inf, 1.0)


class _Track(NamedTuple):
    """The samples of a history by their places.

    The place of a sample is its position on the conveyor or, without one, its time.

    Attributes:
        history: The history.
        places: The place of each sample (k).
        begins: The indices of the first sample, and of the first one after each jump.
    """

    history: SampleHistory
    places: Array
    begins: list[int]

    def Piece(self, sent: float) -> int:
        """Returns the number of the piece from which a value was sent; -1: before."""
        times = [self.history.times[i] for i in self.begins]
        return bisect_left(times, sent) - 1


def RefusalOfDelay(
    path: str, value: float, longest: float, time: float
) -> ScenarioError:
    """Returns the error of a delay that is a signal outside of its range.

    Args:
        path: The name of the delay's block.
        value: The delay in s.
        longest: The longest delay that is allowed, s.
        time: The time in s at which the signal has this value.
    """
    return ScenarioError(
        f"{path}.delay = {Show(float(value))} at {time:.6g} s: must be 0 to "
        f"{longest:g} s, the maximum_delay"
    )


class SteeredLine(DelayLine):
    """A DelayLine whose time is a signal T(t), or the position of a conveyor.

    The output at the time t was sent at s(t). If s is within the present step, it is
    interpolated between the last sample and the present value of the signal: the output
    then depends on the input directly.

    It is not known when a jump of the signal arrives. The output stays on its piece of
    the signal between two jumps until a step has ended where s reaches one of them;
    NextJumpTime() predicts this instant from the slope of t - T, or from the speed of
    the conveyor. A discrete state (4) holds a _Delivered.

    The samples are stored for the longest delay.
    """

    stores_bends = False

    def __init__(self, block: Any, delay: Delay, parameter: str):
        super().__init__(block, delay, parameter)
        assert isinstance(delay.time, str)
        self._control = block.GetInputPort(delay.time)
        self._delivered = block.DeclareDiscreteState([*_NOTHING])
        self.tickets |= {
            self.signal.ticket(),
            self._control.ticket(),
            block.discrete_state_ticket(self._delivered),
        }
        self._longest = min(delay.longest, _EVER)
        self._near = _NEAR * (delay.length or 1.0)
        # That of the last history that was asked for.
        self._last_track: _Track | None = None

    def _DelayIn(self, context: Context) -> float | Callable[[float], float]:
        """Returns the longest delay: the samples before are not needed."""
        return lambda _: self._longest

    def LongestStep(self, context: Context) -> float:
        """Returns the longest time between two samples in s."""
        interval = self._delay.max_sample_interval
        assert interval is not None
        return interval

    def NextJumpTime(self, context: Context) -> float:
        """Returns when a step should end on the way to the output's next jump, s."""
        last = self._Last(context)
        place = self._Place(context)
        slope = self._Slope(context, place, last)
        low, high = self._Ends(context, last.sent)
        gap = high - place if slope > 0 else place - low
        if not self._near < gap < math.inf or slope == 0:
            return math.inf
        length = gap / abs(slope)
        if length > _LAST_STEP:
            length *= _APPROACH
        return float(context.get_time() + length)

    def JumpsAhead(self, context: Context) -> list[float]:
        """Returns no times: jumps are found when they arrive."""
        return []

    def SetSent(
        self, context: Context, times: Array, values: Array, bends: Sequence[float]
    ) -> None:
        """Sets the input signal before the time of a Context, see DelayLine."""
        super().SetSent(context, times, values, [])
        context.SetDiscreteState(self._delivered, [*_NOTHING])

    def Eval(self, context: Context) -> Array:
        """Returns the delayed signal."""
        history = self._GetHistory(context)
        if self._delay.length == 0 and self._Control(context) <= CLOSE:
            value: Array = self.signal.Eval(context)
            return value
        if not history.times:
            return np.array(self._delay.initial_value)
        place = self._Place(context)
        if place > self._TrackOf(history).places[-1]:
            history = self._HistoryNow(context)
        track = self._TrackOf(history)
        piece = track.Piece(self._Last(context).sent)
        if piece < 0:
            return np.array(self._delay.initial_value)
        begin, end = [*track.begins, len(history.times)][piece : piece + 2]
        sent = self._Sent(place, track, end)
        if sent <= history.times[begin]:
            return history.values[begin]
        return history.eval(min(sent, history.times[end - 1]))

    def _Control(self, context: Context) -> float:
        return float(self._control.Eval(context)[0])

    def _Place(self, context: Context) -> float:
        """Returns the place from which the present output comes, see _Track."""
        if self._delay.length > 0:
            return self._Control(context) - self._delay.length
        return float(context.get_time() - max(self._Control(context), 0.0))

    def _TrackOf(self, history: SampleHistory) -> _Track:
        """Returns the samples of a history by their places."""
        last = self._last_track
        if last is None or last.history is not history:
            times = history.times
            places = times
            if self._delay.length > 0:
                places = tuple(float(value[-1]) for value in history.values)
            begins = [
                i + 1 for i, (t, after) in enumerate(pairwise(times)) if t == after
            ]
            last = self._last_track = _Track(history, np.array(places), [0, *begins])
        return last

    def _Sent(self, place: float, track: _Track, end: int | None = None) -> float:
        """Returns the last time when a sample had a place, s; -infinity: never.

        Args:
            end: The index after the last sample that counts; None: all.
        """
        if self._delay.length == 0:
            return place
        from scipy.optimize import brentq  # Imported here because it takes time.

        times = track.history.times
        before = np.flatnonzero(track.places[:end] <= place)
        if before.size == 0:
            return -math.inf
        i = int(before[-1])
        if i + 1 >= (end or len(times)) or times[i] == times[i + 1]:
            return times[i]
        line = track.history.polynomial(i).eval

        def Above(time: float) -> float:
            return float(line(time)[-1]) - place

        if Above(times[i]) >= 0:
            return times[i]
        return float(brentq(Above, times[i], times[i + 1], xtol=1e-14))

    def _Last(self, context: Context) -> _Delivered:
        """Returns the output at the end of the last step; at first, the present one."""
        last = _Delivered(*context.get_discrete_state(self._delivered).value())
        history = self._GetHistory(context)
        if last.time > -math.inf:
            return last
        place = self._Place(context)
        sent = -math.inf
        if history.times:
            sent = self._Sent(place - 3 * self._near, self._TrackOf(history))
        return _Delivered(sent, place, context.get_time(), 1.0)

    def _Slope(self, context: Context, place: float, last: _Delivered) -> float:
        """Returns the change of the output's place per time, since the last step."""
        time = context.get_time()
        if time - last.time > CLOSE:
            return float((place - last.place) / (time - last.time))
        return last.slope

    def _Ends(self, context: Context, sent: float) -> tuple[float, float]:
        """Returns the places at which the output leaves the piece of a value.

        They are infinite if there is no jump. The start counts as a jump.
        """
        history = self._GetHistory(context)
        if not history.times:
            now = self._Control(context)
            return -math.inf, now if self._delay.length > 0 else context.get_time()
        track = self._TrackOf(history)
        piece = track.Piece(sent)
        low = track.places[track.begins[piece]] if piece >= 0 else -math.inf
        ahead = track.places[track.begins[piece + 1 :]]
        if self._HasJumped(context, history) and sent < history.times[-1]:
            ahead = np.append(ahead, track.places[-1])
        return float(low), float(ahead.min(initial=math.inf))

    def _RecordBeforeEvents(self, context: Context, state: State) -> None:
        time = self._Control(context)
        if self._delay.length == 0 and not -CLOSE < time < self._delay.longest + CLOSE:
            name = self._block.GetSystemPathname().removeprefix("::")
            now = context.get_time()
            raise RefusalOfDelay(name, time, self._delay.longest, now)
        super()._RecordBeforeEvents(context, state)

    def _RecordAfterEvents(
        self, context: Context, values: DiscreteValues
    ) -> EventStatus:
        # Two steps may be so close that their samples are one, which is no jump.
        value = self.signal.Eval(context)
        stored = self._GetHistory(context).values[-1]
        if np.any(abs(value - stored) > 1e-9 * (abs(value) + abs(stored))):
            super()._RecordAfterEvents(context, values)
        last = self._Last(context)
        place = self._Place(context)
        slope = self._Slope(context, place, last)
        track = self._TrackOf(self._GetHistory(context))
        sent = self._Sent(place + math.copysign(2 * self._near, slope), track)
        values.set_value(self._delivered, [sent, place, context.get_time(), slope])
        return EventStatus.Succeeded()

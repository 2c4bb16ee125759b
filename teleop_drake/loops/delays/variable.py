"""Exact delays that vary with time but not at random.

T(t) = delay + drift t + amplitude sin(frequency t + phase) + trace(t)
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from teleop_drake.loops.delays.base import SHORTEST_TIME, ChannelBlock, CheckedInterval
from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.validation import (
    CheckNumber,
    FixedFields,
    Number,
    Refuse,
    RefuseGiven,
)
from teleop_drake.loops.kernel.linear_part import LinearPart


@dataclass(kw_only=True)
class Sinusoid(FixedFields):
    """A periodic part of the delay, amplitude sin(frequency t + phase)."""

    # s, >= 0.
    amplitude: float = Number(0.0, "s", minimum=0)
    # rad/s, >= 0.
    frequency: float = Number(1.0, "rad/s", minimum=0)
    # rad, -1000 to 1000; a larger phase would leave too few significant digits.
    phase: float = Number(0.0, "rad", minimum=-1000, maximum=1000)


def _Slopes(times: Array, delays: Array) -> Array:
    """Returns the slopes between entries; infinite where the delay jumps."""
    steps = np.diff(times)
    rises = np.diff(delays)
    jumps = np.where(rises != 0, math.inf, 0.0)
    return np.divide(rises, steps, out=jumps, where=steps > 0)


class DelayProfile:
    """A delay that varies with time but not at random.

        T(t) = delay + drift t + amplitude sin(frequency t + phase) + trace(t)

    Calling it returns T(t) in s. The trace is interpolated linearly; its times count
    from its first entry.

    Attributes:
        delay: The constant part in s.
        duration: The time until which T is defined, in s.
        minimum: A lower bound of T in s, the sum of the minima of its parts.
        max_slope: An upper bound of dT/dt, the sum of the maxima of its parts.
        nonsmooth_times: The times at which the slope of T may jump: those of the trace,
            in s.

    Args:
        delay: Constant part in s, >= 0.
        drift: Change per time, s/s.
        sinusoid: Periodic part.
        trace: Measured (times, delays) in s, at least two of each; the times do not
            descend and the delays are not negative. The last delay is held to the end.
            None: no such part.
        duration: The time until which T is needed, in s, > 0; None: the length of the
            trace, or infinity without a trace.

    Raises:
        ValueError: If a parameter is outside its range, or T may be negative.
    """

    def __init__(
        self,
        *,
        delay: float,
        drift: float = 0.0,
        sinusoid: Sinusoid | None = None,
        trace: tuple[ArrayLike, ArrayLike] | None = None,
        duration: float | None = None,
    ):
        self._sinusoid = sinusoid = sinusoid or Sinusoid()
        CheckNumber("delay", delay, "s", minimum=0)
        CheckNumber("drift", drift, "s/s")
        sinusoid.CheckNumbers("sinusoid")
        self.delay = float(delay)
        self._drift = float(drift)
        # The times of the trace count from its first entry.
        parts = ([0.0, math.inf], [0.0, 0.0]) if trace is None else trace
        self._times, self._delays = (np.array(part, dtype=float) for part in parts)
        self._times -= self._times[0]
        self.duration = float(self._times[-1] if duration is None else duration)
        if not self.duration > 0:
            Refuse("duration", duration, "a number > 0 (s)")
        # Before 0, a trace has its first delay.
        bends = np.unique(self._times[1:] if trace is None else self._times)
        self.nonsmooth_times: list[float] = bends[bends < self.duration].tolist()
        # The bounds of T and of its slope are the sums of the bounds of their parts.
        self.minimum = self.delay - sinusoid.amplitude + float(self._delays.min())
        if self._drift < 0:
            self.minimum += self._drift * self.duration
        slopes = _Slopes(self._times, self._delays)
        # The largest slope of each part; behind the trace, whose last delay is held, it
        # is 0.
        self._slopes = {
            "drift": self._drift,
            "sinusoid.amplitude": sinusoid.amplitude * sinusoid.frequency,
            "trace": float(slopes.max(initial=0.0)),
        }
        self.max_slope = sum(self._slopes.values())
        if self.minimum < 0:
            self._RefuseMinimum("negative")

    def _RefuseMinimum(self, what: str) -> NoReturn:
        Refuse(
            "delay",
            self.delay,
            f"such that the delay, down to {self.minimum:.6g} s, is never {what}",
        )

    def CheckContinuous(self, trace_name: str = "trace") -> None:
        """Checks that T delays a signal continuously and preserves its order.

        Args:
            trace_name: Name of the trace in a message.

        Raises:
            ValueError: If T may be less than SHORTEST_TIME, or dT/dt may reach 1.
        """
        if self.minimum < SHORTEST_TIME:
            self._RefuseMinimum(f"less than {SHORTEST_TIME:g} s")
        if self.max_slope >= 1:
            name = max(self._slopes, key=self._slopes.__getitem__)
            value = {
                "drift": self._drift,
                "sinusoid.amplitude": self._sinusoid.amplitude,
                "trace": trace_name,
            }
            Refuse(
                name,
                value[name],
                f"such that dT/dt, up to {self.max_slope:.6g}, is less than 1; where "
                "packets overtake each other, kind must be network",
            )

    def __call__(self, t: Any) -> Any:
        """Returns T(t) in s.

        Args:
            t: A time in s, or an array of times (N,), at most `duration`. Before 0, the
                trace has its first value.

        Raises:
            ValueError: If a time is beyond the duration, or before 0 where a drift
                makes the delay shorter than `minimum`.
        """
        if np.any(t > self.duration * (1 + 1e-9)):
            Refuse("t", t, f"at most {self.duration:g} s, the duration of the delay")
        if self._drift > 0 and np.any(t < 0):
            Refuse(
                "t", t, "at least 0 s, because a delay with a drift > 0 begins there"
            )
        result = self.delay + self._drift * t
        if self._sinusoid.amplitude:
            phase = self._sinusoid.frequency * t + self._sinusoid.phase
            result = result + self._sinusoid.amplitude * np.sin(phase)
        if self._delays.any():
            result = result + np.interp(t, self._times, self._delays)
        return result


class VariableDelay(ChannelBlock):
    """Delays a vector signal by a varying time, continuously and without packets.

        delayed_signal(t) = signal(t - T(t))    for t - T(t) > t0
                          = initial_value       before

    where t0 is the time at which the simulation starts. T(t) is a function of time, the
    `profile`, or a signal, the input `delay`. This is a variable time delay: T belongs
    to the time of arrival. See VariableTransportDelay for what travels on a conveyor or
    in a pipe.

    | port | name           | size | unit      |
    |------|----------------|------|-----------|
    | in   | signal         | size | any       |
    | in   | delay          | 1    | s         |
    | out  | delayed_signal | size | of signal |

    The input `delay` exists without a profile only.

    A profile has dT/dt < 1, so that no part of the signal is delivered twice or in the
    wrong order. A signal T may have any slope, and may jump by an event: the output
    then goes backwards through the signal, or omits a part of it. T may depend on the
    state, and on the outputs of other delays but not on this one's. If it is < 0 or
    > maximum_delay at the end of a step, the run is refused.

    State and treatment of jumps: those of DelayLine or, without a profile, SteeredLine.

    Initial value: `initial_value` is delivered until the first sample arrives.

    Direct feedthrough: none with a profile; else from both inputs, because T may be 0.

    Steps: with a profile, no step can be longer than the smallest delay. A signal T may
    be shorter than a step, which is then repeated until it agrees with its own output.
    In Drake's Simulator, such an output is interpolated within the step, and no step is
    longer than max_sample_interval.

    Args:
        profile: T(t) in s, at least SHORTEST_TIME and of slope < 1. None: T is the
            input `delay`.
        size: Width of the signal, >= 1.
        initial_value: The output before the first sample arrives (size); zeros if None.
        max_sample_interval: Longest time between two samples in s, at most the
            smallest delay; infinity: one sample for each step of the integrator. None:
            0.01 s, or the smallest delay if that is less. Without a profile, > 0 and
            finite.
        maximum_delay: The longest T in s, > 0, for which samples are stored; required
            without a profile, and not allowed with one.

    Raises:
        ValueError: If a parameter is outside its range.
    """

    def __init__(
        self,
        profile: DelayProfile | None = None,
        size: int = 1,
        initial_value: Sequence[float] | None = None,
        *,
        max_sample_interval: float | None = None,
        maximum_delay: float | None = None,
    ):
        if profile is None:
            CheckNumber("maximum_delay", maximum_delay, "s", above=0)
            ChannelBlock.__init__(
                self, delay=0.0, size=size, initial_value=initial_value
            )
            self._linear_part = LinearPart(delay=maximum_delay)
            self.DeclareDelay(
                time="delay",
                longest=maximum_delay,
                max_sample_interval=CheckedInterval(max_sample_interval),
            )
            return
        RefuseGiven("left out with a profile", maximum_delay=maximum_delay)
        self._linear_part = LinearPart()
        profile.CheckContinuous()
        ChannelBlock.__init__(
            self, delay=profile.minimum, size=size, initial_value=initial_value
        )
        self.DeclareDelay(
            time=profile,
            shortest=profile.minimum,
            nonsmooth_times=profile.nonsmooth_times,
            end=profile.duration,
            max_sample_interval=max_sample_interval,
        )

    def ForLinearModel(self, estimates: Array | None) -> LinearPart:
        """Returns the delay as a linear part; with a profile there is none."""
        return self._linear_part

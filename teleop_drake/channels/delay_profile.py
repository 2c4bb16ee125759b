"""A delay that varies with time but not at random.

T(t) = delay + drift t + amplitude sin(frequency t + phase) + trace(t)
"""

import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.validation import CheckNumber, FixedFields, Number, Refuse


@dataclass(kw_only=True)
class Sinusoid(FixedFields):
    """A periodic part of the delay, amplitude sin(frequency t + phase)."""

    # s, >= 0.
    amplitude: float = Number(0.0, "s", minimum=0)
    # rad/s, >= 0.
    frequency: float = Number(1.0, "rad/s", minimum=0)
    # rad.
    phase: float = Number(0.0, "rad")


class DelayProfile:
    """A delay that varies with time but not at random.

        T(t) = delay + drift t + amplitude sin(frequency t + phase) + trace(t)

    Calling it returns T(t) in s. The trace is interpolated linearly; its own time
    counts from its first entry.

    Args:
        delay: Constant part in s, >= 0.
        drift: Change per time, s/s.
        sinusoid: Periodic part.
        trace: (times, delays) in s, measured, at least two of each; the times ascend
            and the delays are not negative. None: no such part.
        duration: Until when T is needed, in s, > 0; None: the whole trace, or forever
            without one.

    Raises:
        ValueError: If a parameter is outside its range, the trace does not cover the
            duration, or T might be negative.
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
        sinusoid = sinusoid or Sinusoid()
        CheckNumber("delay", delay, "s", minimum=0)
        CheckNumber("drift", drift, "s/s")
        sinusoid.CheckNumbers("sinusoid")
        self._delay = float(delay)
        self._drift = float(drift)
        self._amplitude = float(sinusoid.amplitude)
        self._frequency = float(sinusoid.frequency)
        self._phase = float(sinusoid.phase)
        self._times: list[float] = []
        self._delays: list[float] = []
        if trace is not None:
            times, delays = (np.array(part, dtype=float) for part in trace)
            _CheckTrace(times, delays)
            times -= times[0]
            if duration is not None and times[-1] < duration:
                Refuse(
                    "trace",
                    float(times[-1]),
                    f"at least as long as the duration, {duration:g} s",
                )
            self._times, self._delays = times.tolist(), delays.tolist()
            if duration is None:
                duration = self._times[-1]
        self._duration = math.inf if duration is None else float(duration)
        if not self._duration > 0:
            Refuse("duration", duration, "a number > 0 (s)")
        self._minimum = self._delay - self._amplitude + min(self._delays, default=0.0)
        if self._drift < 0:
            self._minimum += self._drift * self._duration
        slopes = np.diff(self._delays) / np.diff(self._times)
        self._slopes = {
            "drift": self._drift,
            "sinusoid.amplitude": self._amplitude * self._frequency,
            "trace": float(slopes.max()) if slopes.size else 0.0,
        }
        self._max_slope = sum(self._slopes.values())
        if self._minimum < 0:
            self._RefuseMinimum("negative")

    def _RefuseMinimum(self, what: str) -> NoReturn:
        Refuse(
            "delay",
            self._delay,
            f"such that the delay, down to {self._minimum:.6g} s, is never {what}",
        )

    @property
    def delay(self) -> float:
        """The constant part in s."""
        return self._delay

    @property
    def duration(self) -> float:
        """Until when T is defined, in s."""
        return self._duration

    @property
    def minimum(self) -> float:
        """A lower bound of T in s, the sum of the minima of its parts."""
        return self._minimum

    @property
    def max_slope(self) -> float:
        """An upper bound of dT/dt, the sum of the maxima of its parts."""
        return self._max_slope

    @property
    def nonsmooth_times(self) -> list[float]:
        """Where the slope of T may jump: the times of the trace, in s."""
        return self._times[1:-1]

    def CheckContinuous(self, least: float, trace_name: str = "trace") -> None:
        """Checks that a signal can be delayed by T continuously and in order.

        Args:
            least: Least delay in s that is allowed.
            trace_name: What to call the trace in a message.

        Raises:
            ValueError: If T might be less, or rise as fast as time goes by.
        """
        if self._minimum < least:
            self._RefuseMinimum(f"less than {least:g} s")
        if self._max_slope >= 1:
            name = max(self._slopes, key=lambda key: self._slopes[key])
            value = {
                "drift": self._drift,
                "sinusoid.amplitude": self._amplitude,
                "trace": trace_name,
            }
            Refuse(
                name,
                value[name],
                f"such that dT/dt, up to {self._max_slope:.6g}, is less than 1; where "
                "packets overtake each other, kind must be network",
            )

    def __call__(self, t: float) -> float:
        """Returns T(t) in s.

        Args:
            t: Time in s, 0 to `duration`.

        Raises:
            ValueError: If t lies beyond the duration.
        """
        if t > self._duration * (1 + 1e-9):
            Refuse("t", t, f"at most {self._duration:g} s, the duration of the delay")
        result = self._delay + self._drift * t
        if self._amplitude:
            result += self._amplitude * math.sin(self._frequency * t + self._phase)
        if self._times:
            times, delays = self._times, self._delays
            i = min(max(bisect_right(times, t) - 1, 0), len(times) - 2)
            share = (t - times[i]) / (times[i + 1] - times[i])
            result += delays[i] + min(max(share, 0.0), 1.0) * (
                delays[i + 1] - delays[i]
            )
        return result


def _CheckTrace(times: np.ndarray, delays: np.ndarray) -> None:
    if times.ndim != 1 or times.shape != delays.shape or times.size < 2:
        Refuse("trace", times.size, "at least two times and as many delays")
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(delays))):
        Refuse("trace", "not finite", "finite numbers (s)")
    wrong = np.flatnonzero(np.diff(times) <= 0)
    if wrong.size:
        Refuse("trace", float(times[wrong[0] + 1]), "ascending times (s)")
    if np.any(delays < 0):
        Refuse("trace", float(delays[delays < 0][0]), "delays >= 0 (s)")

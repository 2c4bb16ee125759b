"""Transport delay of a vector signal that varies with time."""

import math
from collections.abc import Sequence

from teleop_drake.channels.delay_line import DelayLine
from teleop_drake.channels.delay_profile import DelayProfile

# Keys are multiples of this, in s, so that the two sides of a jump have equal ones
# although t - T(t) is rounded. Exact for times up to some hours.
_KEY_STEP = 2.0**-36

SHORTEST_VARIABLE_DELAY = 1e-6
"""Least delay of a VariableDelay in s: no step may be longer."""


class VariableDelay(DelayLine):
    """Delays a vector signal by a time that varies, continuously and without packets.

        delayed_signal(t) = signal(t - T(t))    for t - T(t) > t0
                          = initial_value       before

    where t0 is the time at which the simulation starts. T changes by less than the
    time itself, dT/dt < 1, so nothing is delivered twice or in the wrong order.

    | port | name           | size | unit      |
    |------|----------------|------|-----------|
    | in   | signal         | size | any       |
    | out  | delayed_signal | size | of signal |

    State: see DelayLine. A sample is kept by the time when it was taken.

    Jumps: as for TransportDelay; a jump at s arrives at the t with t - T(t) = s, found
    to some 1e-11 s.

    Initial value: `initial_value` is delivered until the first sample arrives.

    Direct feedthrough: none.

    It does not extrapolate, so no step can be longer than the smallest delay.

    Args:
        profile: T(t) in s, at least SHORTEST_VARIABLE_DELAY and of slope < 1.
        size: Width of the signal, >= 1.
        initial_value: What is delivered at first (size); zeros if None.
        max_sample_interval: Longest time between two samples in s, at most the
            smallest delay; infinity: the steps are as they come. None takes 0.01 s,
            or the smallest delay if that is less.

    Raises:
        ValueError: If a parameter is outside its range.
    """

    def __init__(
        self,
        *,
        profile: DelayProfile,
        size: int,
        initial_value: Sequence[float] | None = None,
        max_sample_interval: float | None = None,
    ):
        profile.CheckContinuous(SHORTEST_VARIABLE_DELAY)
        self._profile = profile
        DelayLine.__init__(
            self,
            size=size,
            initial_value=initial_value,
            shortest_delay=profile.minimum,
            max_sample_interval=max_sample_interval,
        )

    def StoreKey(self, time: float) -> float:
        """Returns the time itself, rounded: samples are kept by when they were taken.

        Args:
            time: In s.
        """
        return _Round(time)

    def FetchKey(self, time: float) -> float:
        """Returns t - T(t), rounded.

        Args:
            time: t in s.
        """
        return _Round(time - self._profile(time))

    def FetchTime(self, key: float) -> float:
        """Returns the t with t - T(t) = key; infinity if the profile ends before.

        Args:
            key: As from StoreKey().
        """
        early = key
        # The slope of t - T(t) is at least 1 - max_slope.
        late = early + self._profile(early) / (1 - self._profile.max_slope)
        late = min(late + _KEY_STEP, self._profile.duration)
        if late - self._profile(late) < key:
            return math.inf
        while early < (middle := (early + late) / 2) < late:
            if middle - self._profile(middle) < key:
                early = middle
            else:
                late = middle
        return late


def _Round(time: float) -> float:
    return round(time / _KEY_STEP) * _KEY_STEP

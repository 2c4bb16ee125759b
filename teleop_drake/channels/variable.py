"""An exact delay that varies with time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teleop_drake.channels.base import SHORTEST_TIME, ConstantDelay
from teleop_drake.channels.delay_line import DelayLine
from teleop_drake.channels.delay_profile import DelayProfile
from teleop_drake.channels.varying_delay import VaryingDelayConfig
from teleop_drake.kernel import Delay, Kernel
from teleop_drake.validation import Refuse, Within

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

    def Kernel(self) -> Kernel:
        """Returns what the block computes; see kernel."""
        return Kernel(
            delays=[
                Delay(
                    signal="signal",
                    output="delayed_signal",
                    time=self._profile,
                    nonsmooth_times=self._profile.nonsmooth_times,
                    initial_value=self._initial_value,
                )
            ]
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


# Instants at which a delay that varies is looked at for its mean.
_NUM_TIMES = 20001


@dataclass(kw_only=True, eq=False)
class VariableChannelConfig(VaryingDelayConfig):
    """Delays the signal exactly by T(t), which is continuous and keeps the order."""

    kind = "variable"

    def Check(self, path: str, duration: float) -> None:
        """Checks every field; reads the trace.

        Args:
            path: The channel's field in a scenario, for messages.
            duration: How long the simulation lasts, s.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        super().Check(path, duration)
        trace = self.MeasuredDelays(duration, path)
        if trace is not None and trace.is_lost.any():
            Refuse(
                f"{path}.trace",
                self.trace,
                f"without losses, and has {int(trace.is_lost.sum())}; where packets "
                "are lost, kind must be network",
            )
        profile = self.ProfileOf(trace, duration, path)
        with Within(path):
            profile.CheckContinuous(SHORTEST_TIME, self.trace or "")

    def MakeChannel(
        self,
        *,
        size: int,
        initial_value: Sequence[float],
        duration: float = math.inf,
        stream: str = "",
    ) -> VariableDelay:
        """Makes the block; see ChannelConfig.MakeChannel.

        Args:
            size: Width of the packets.
            initial_value: What arrives before the first packet does (size).
            duration: Until when the delay is needed, s.
            stream: Has no effect.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """
        return VariableDelay(
            profile=self.Profile(duration),
            size=size,
            initial_value=initial_value,
            # LongestStep says how the solver has to step.
            max_sample_interval=math.inf,
        )

    def LongestStep(self, duration: float) -> float:
        """Returns a lower bound of the delay in s.

        Args:
            duration: How long the simulation lasts, s.
        """
        return self.Profile(duration).minimum

    def AsConstantDelay(self, path: str, duration: float) -> ConstantDelay:
        """Returns the mean of T over the duration.

        A constant delay says what holds while T changes slowly against the loop. A T
        that changes fast may destabilise although each of its values, held, would not,
        and the reverse.

        Args:
            path: The channel's field in a scenario, for messages.
            duration: How long the simulation lasts, s.
        """
        profile = self.Profile(duration, path)
        times = np.linspace(0.0, duration, _NUM_TIMES)
        delays = np.array([profile(t) for t in times.tolist()])
        delay = float(np.trapezoid(delays, times) / duration)
        return ConstantDelay(
            delay=delay,
            note=f"{path}: the delay varies from {delays.min():.4g} to "
            f"{delays.max():.4g} s; the margins hold for a constant delay, here the "
            f"mean, {delay:.4g} s.",
        )

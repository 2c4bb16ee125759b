"""An exact delay that varies with time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teleop_drake.channels.base import (
    SHORTEST_TIME,
    ChannelBlock,
    ConstantDelay,
)
from teleop_drake.channels.delay_profile import DelayProfile, VaryingDelayConfig
from teleop_drake.validation import Refuse, Within

SHORTEST_VARIABLE_DELAY = 1e-6
"""Least delay of a VariableDelay in s: no step may be longer."""


class VariableDelay(ChannelBlock):
    """Delays a vector signal by a time that varies, continuously and without packets.

        delayed_signal(t) = signal(t - T(t))    for t - T(t) > t0
                          = initial_value       before

    where t0 is the time at which the simulation starts. T changes by less than the
    time itself, dT/dt < 1, so nothing is delivered twice or in the wrong order.

    | port | name           | size | unit      |
    |------|----------------|------|-----------|
    | in   | signal         | size | any       |
    | out  | delayed_signal | size | of signal |

    State, jumps: those of DelayLine.

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


# Instants at which a delay that varies is looked at for its mean.
_NUM_TIMES = 20001


@dataclass(kw_only=True, eq=False)
class VariableChannelConfig(VaryingDelayConfig):
    """Delays the signal exactly by T(t), which is continuous and keeps the order."""

    kind = "variable"

    def Check(self, path: str, duration: float) -> None:
        """Checks every field; reads the trace."""
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
        """Makes the block; see ChannelConfig.MakeChannel."""
        return VariableDelay(
            profile=self.Profile(duration),
            size=size,
            initial_value=initial_value,
            # LongestStep says how the solver has to step.
            max_sample_interval=math.inf,
        )

    def LongestStep(self, duration: float) -> float:
        """Returns a lower bound of the delay in s."""
        return self.Profile(duration).minimum

    def AsConstantDelay(self, path: str, duration: float) -> ConstantDelay:
        """Returns the mean of T over the duration.

        A constant delay says what holds while T changes slowly against the loop. A T
        that changes fast may destabilise although each of its values, held, would not,
        and the reverse.
        """
        profile = self.Profile(duration, path)
        times = np.linspace(0.0, duration, _NUM_TIMES)
        delays = profile(times)
        delay = float(np.trapezoid(delays, times) / duration)
        return ConstantDelay(
            delay=delay,
            note=f"{path}: the delay varies from {delays.min():.4g} to "
            f"{delays.max():.4g} s; the margins hold for a constant delay, here the "
            f"mean, {delay:.4g} s.",
        )

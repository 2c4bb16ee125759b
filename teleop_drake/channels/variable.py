"""An exact delay that varies with time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teleop_drake.channels.base import SHORTEST_TIME, ConstantDelay
from teleop_drake.channels.variable_delay import VariableDelay
from teleop_drake.channels.varying_delay import VaryingDelayConfig
from teleop_drake.validation import Within

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
        profile = self.Profile(duration, path)
        with Within(path):
            profile.CheckContinuous(SHORTEST_TIME)

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

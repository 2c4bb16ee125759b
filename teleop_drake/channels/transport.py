"""An exact, constant delay."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from teleop_drake.channels.base import ChannelConfig
from teleop_drake.channels.transport_delay import TransportDelay


@dataclass(kw_only=True, eq=False)
class TransportChannelConfig(ChannelConfig):
    """Delays the signal exactly by `delay`; 0 passes it through."""

    kind = "transport"

    def MakeChannel(
        self,
        *,
        size: int,
        initial_value: Sequence[float],
        duration: float = math.inf,
        stream: str = "",
    ) -> TransportDelay:
        """Makes the block; see ChannelConfig.MakeChannel.

        Args:
            size: Width of the packets.
            initial_value: What arrives before the first packet does (size).
            duration: Has no effect.
            stream: Has no effect.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """
        return TransportDelay(
            delay=self.delay,
            size=size,
            initial_value=initial_value,
            # LongestStep says how the solver has to step.
            max_sample_interval=math.inf,
        )

    def LongestStep(self, duration: float) -> float:
        """Returns the delay in s: what arrives in a step was sent before it.

        Args:
            duration: Has no effect.
        """
        return self.delay or math.inf

    def IsPassThrough(self) -> bool:
        """Returns whether there is no delay."""
        return self.delay == 0

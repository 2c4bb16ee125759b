"""A channel of packets at a fixed rate, each held until the next one."""

import math
from collections.abc import Sequence

from teleop_drake.loops.delays.base import MAX_PACKETS, SHORTEST_TIME
from teleop_drake.loops.delays.sampled import CheckAtMostDelay, SampledDelay
from teleop_drake.loops.framework.validation import (
    REQUIRED,
    CheckNumber,
    Config,
)
from teleop_drake.model.channels.base import ChannelConfig, ConstantDelay


def CheckSamplePeriod(path: str, sample_period: float, delay: float) -> None:
    """Checks the sample period of a channel.

    Args:
        path: The channel's field in a scenario, for messages.
        sample_period: The sample period in s.
        delay: The delay of the channel in s.

    Raises:
        ScenarioError: If it is not allowed.
    """
    minimum = max(SHORTEST_TIME, delay / MAX_PACKETS)
    CheckNumber(f"{path}.sample_period", sample_period, "s", minimum=minimum)


@Config
class SampledChannelConfig(ChannelConfig):
    """Sends a packet each sample period, which arrives after `delay` and is held.

    A delay of 0 passes the signal through, unsampled.
    """

    kind = "sampled"

    # Time between packets, s, > 0 and at most a non-zero delay.
    sample_period: float = REQUIRED

    def Check(self, path: str, duration: float) -> None:
        """Checks every field."""
        super().Check(path, duration)
        CheckSamplePeriod(path, self.sample_period, self.delay)
        CheckAtMostDelay(f"{path}.sample_period", self.sample_period, self.delay)

    def MakeChannel(
        self,
        *,
        size: int,
        initial_value: Sequence[float],
        duration: float = math.inf,
        stream: str = "",
    ) -> SampledDelay:
        """Makes the block; see ChannelConfig.MakeChannel."""
        return SampledDelay(
            delay=self.delay,
            sample_period=self.sample_period,
            size=size,
            initial_value=initial_value,
        )

    def IsPassThrough(self) -> bool:
        """Returns whether there is no delay."""
        return self.delay == 0

    def PacketPeriod(self) -> float:
        """Returns the sample period in s."""
        return self.sample_period

    def AsConstantDelay(self, path: str, duration: float) -> ConstantDelay:
        """Returns the delay of a packet plus half of the period for which it is held.

        To first order in the period h, a hold is a delay of h/2:
        (1 - e^(-s h))/(s h) = e^(-s h/2) (1 + (s h)^2/24 + ...).
        """
        if self.delay == 0:
            return ConstantDelay(delay=0.0)
        delay = self.delay + self.sample_period / 2
        return ConstantDelay(
            delay=delay,
            note=f"{path}: packets are held for {self.sample_period:g} s, on average "
            f"half of that; the margins hold for a constant delay, here {delay:g} s.",
        )

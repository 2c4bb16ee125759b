"""Packets at a fixed rate, each held until the next one."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from teleop_drake.channels.base import (
    SHORTEST_TIME,
    ChannelConfig,
    ConstantDelay,
)
from teleop_drake.channels.sampled_delay import SampledDelay
from teleop_drake.validation import REQUIRED, CheckNumber, Refuse

MAX_PACKETS = 100_000
"""Most packets that may be under way in a channel."""


def CheckSamplePeriod(path: str, sample_period: float, delay: float) -> None:
    """Checks the sample period of a channel.

    Args:
        path: The channel's field in a scenario, for messages.
        sample_period: In s.
        delay: In s.

    Raises:
        ScenarioError: If it is not allowed.
    """
    minimum = max(SHORTEST_TIME, delay / MAX_PACKETS)
    CheckNumber(f"{path}.sample_period", sample_period, "s", minimum=minimum)


@dataclass(kw_only=True, eq=False)
class SampledChannelConfig(ChannelConfig):
    """Sends a packet each sample period, which arrives after `delay` and is held.

    A delay of 0 passes the signal through, unsampled.
    """

    kind = "sampled"

    # Time between packets, s, > 0 and at most a non-zero delay.
    sample_period: float = REQUIRED

    def Check(self, path: str, duration: float) -> None:
        """Checks every field.

        Args:
            path: The channel's field in a scenario, for messages.
            duration: How long the simulation lasts, s.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        super().Check(path, duration)
        CheckSamplePeriod(path, self.sample_period, self.delay)
        if 0 < self.delay < self.sample_period:
            allowed = f"at most the delay, {self.delay:g} (s)"
            Refuse(f"{path}.sample_period", self.sample_period, allowed)

    def MakeChannel(
        self,
        *,
        size: int,
        initial_value: Sequence[float],
        duration: float = math.inf,
        stream: str = "",
    ) -> SampledDelay:
        """Makes the block; see ChannelConfig.MakeChannel.

        Args:
            size: Width of the packets.
            initial_value: What arrives before the first packet does (size).
            duration: Has no effect.
            stream: Has no effect.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """
        CheckNumber("sample_period", self.sample_period, "s", above=0)
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
        """Returns the delay of a packet and half a period, for which it is held.

        To first order in the period h, a hold is that delay:
        (1 - e^(-s h))/(s h) = e^(-s h/2) (1 + (s h)^2/24 + ...).

        Args:
            path: The channel's field in a scenario, for messages.
            duration: Has no effect.
        """
        if self.delay == 0:
            return ConstantDelay(delay=0.0)
        delay = self.delay + self.sample_period / 2
        return ConstantDelay(
            delay=delay,
            note=f"{path}: packets are held for {self.sample_period:g} s, on average "
            f"half of that; the margins hold for a constant delay, here {delay:g} s.",
        )

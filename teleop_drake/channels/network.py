"""Packets with fates of their own: jitter, loss, reordering, and a receiver."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from teleop_drake.channels.base import ConstantDelay
from teleop_drake.channels.network_delay import NetworkDelay
from teleop_drake.channels.packet_network import Jitter, Loss, PacketNetwork
from teleop_drake.channels.packet_statistics import ComputePacketStatistics
from teleop_drake.channels.receiver import CheckReceiver, Receiver
from teleop_drake.channels.sampled import CheckSamplePeriod
from teleop_drake.channels.varying_delay import VaryingDelayConfig
from teleop_drake.validation import (
    REQUIRED,
    CheckNumber,
    Refuse,
    ScenarioError,
    Within,
)


@dataclass(kw_only=True, eq=False)
class NetworkChannelConfig(VaryingDelayConfig):
    """Sends a packet each sample period through a network that has its ways with it."""

    kind = "network"
    draws_random_numbers: ClassVar[bool] = True
    has_packet_statistics: ClassVar[bool] = True

    # Time between packets, s, > 0.
    sample_period: float = REQUIRED
    jitter: Jitter = field(default_factory=Jitter)
    loss: Loss = field(default_factory=Loss)
    receiver: Receiver = field(default_factory=Receiver)

    def Check(self, path: str, duration: float) -> None:
        """Checks every field; reads the trace.

        Args:
            path: The channel's field in a scenario, for messages.
            duration: How long the simulation lasts, s.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        super().Check(path, duration)
        CheckSamplePeriod(path, self.sample_period, self.delay)
        self.Network(duration, path=path)
        with Within(path):
            CheckReceiver(self.receiver)

    def Network(
        self, duration: float, *, stream: str = "", path: str = "channel"
    ) -> PacketNetwork:
        """Returns what happens to the packets.

        Args:
            duration: How long packets are sent, s.
            stream: Name of the random numbers.
            path: The channel's field in a scenario, for messages.

        Raises:
            ScenarioError: If a field is not allowed.
        """
        profile = self.Profile(duration, path)
        with Within(path):
            CheckNumber("sample_period", self.sample_period, "s", above=0)
            return PacketNetwork(
                profile=profile,
                sample_period=self.sample_period,
                jitter=self.jitter,
                loss=self.loss,
                seed=self.seed,
                stream=stream,
            )

    def MakeChannel(
        self,
        *,
        size: int,
        initial_value: Sequence[float],
        duration: float = math.inf,
        stream: str = "",
    ) -> NetworkDelay:
        """Makes the block; see ChannelConfig.MakeChannel.

        Args:
            size: Width of the packets.
            initial_value: What arrives before the first packet does (size).
            duration: How long packets are sent, s.
            stream: Name of the random numbers; another one gives other numbers.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """
        return NetworkDelay(
            network=self.Network(duration, stream=stream),
            receiver=self.receiver,
            size=size,
            initial_value=initial_value,
        )

    def PacketPeriod(self) -> float:
        """Returns the sample period in s."""
        return self.sample_period

    def AsConstantDelay(self, path: str, duration: float) -> ConstantDelay:
        """Returns the mean age of information behind the receiver.

        It is that of this network's own packets: their delays, losses, order and seed.

        Args:
            path: The channel's field in a scenario, which names the random numbers.
            duration: How long packets are sent, s.

        Raises:
            ScenarioError: If the receiver extrapolates, which is no delay, or no
                packet arrives.
        """
        if self.receiver.policy == "extrapolate":
            Refuse(
                f"{path}.receiver.policy",
                self.receiver.policy,
                "newest or playout, because what extrapolates is not a delay",
            )
        network = self.Network(duration, stream=path, path=path)
        age = ComputePacketStatistics(network, self.receiver, duration).age_mean
        if age is None:
            raise ScenarioError(
                f"{path}: must deliver a packet within the duration, {duration:g} s, "
                "and does not"
            )
        return ConstantDelay(
            delay=age,
            note=f"{path}: packets have delays of their own; the margins hold for a "
            f"constant delay, here the mean age of what is received, {age:.4g} s.",
        )

"""The constant delay that stands for a channel in the analysis of the loop."""

from dataclasses import dataclass

import numpy as np

from teleop_drake.channels.packet_network import PacketNetwork, packet_statistics
from teleop_drake.scenario import ChannelConfig, ChannelProfile, Scenario, ScenarioError

# Instants at which a delay that varies is looked at.
_NUM_TIMES = 20001


@dataclass(frozen=True, kw_only=True)
class ChannelDelay:
    """A constant delay in the place of a channel.

    Attributes:
        delay: In s.
        note: A sentence that says what it stands for; None: for itself.
    """

    delay: float
    note: str | None = None


def ConstantDelay(scenario: Scenario, path: str) -> ChannelDelay:
    """Returns the constant delay that a channel is analysed with.

    Of a transport channel its delay, which is exact. Of the others the time mean, over
    the duration of the scenario, of how old the signal is that they deliver:

    * variable: T(t). A constant delay says what holds while T changes slowly against
      the loop; a T that changes fast may destabilise although each of its values,
      held, would not, and the reverse.
    * sampled: the delay of a packet and, because it is held until the next one,
      half a period. To first order in the period a hold is that delay:
      (1 - e^(-s h))/(s h) = e^(-s h/2) (1 + (s h)^2/24 + ...).
    * network: the mean age of information of its packets (their delays, losses, order
      and seed) behind the receiver.

    Args:
        scenario: A valid one.
        path: forward_channel or return_channel.

    Raises:
        ScenarioError: If the receiver extrapolates, which is no delay, or no packet
            arrives.
    """
    channel: ChannelConfig = getattr(scenario, path)
    if channel.kind == "transport" or (channel.kind == "sampled" and not channel.delay):
        return ChannelDelay(delay=channel.delay)
    if channel.kind == "sampled":
        period = channel.sample_period or 0.0
        delay = channel.delay + period / 2
        return ChannelDelay(
            delay=delay,
            note=f"{path}: packets are held for {period:g} s, on average half of "
            f"that; the margins hold for a constant delay, here {delay:g} s.",
        )
    profile = ChannelProfile(channel, scenario.duration, path=path)
    if channel.kind == "variable":
        times = np.linspace(0.0, scenario.duration, _NUM_TIMES)
        delays = np.array([profile(t) for t in times.tolist()])
        delay = float(np.trapezoid(delays, times) / scenario.duration)
        return ChannelDelay(
            delay=delay,
            note=f"{path}: the delay varies from {delays.min():.4g} to "
            f"{delays.max():.4g} s; the margins hold for a constant delay, here the "
            f"mean, {delay:.4g} s.",
        )
    if channel.receiver.policy == "extrapolate":
        raise ScenarioError(
            f"{path}.receiver.policy = 'extrapolate': must be newest or playout, "
            "because what extrapolates is not a delay"
        )
    network = PacketNetwork(
        profile=profile,
        sample_period=channel.sample_period or 0.0,
        jitter=channel.jitter,
        loss=channel.loss,
        seed=channel.seed,
        stream=path,
    )
    age = packet_statistics(network, channel.receiver, scenario.duration).age_mean
    if age is None:
        raise ScenarioError(
            f"{path}: must deliver a packet within the duration, {scenario.duration:g} "
            "s, and does not"
        )
    return ChannelDelay(
        delay=age,
        note=f"{path}: packets have delays of their own; the margins hold for a "
        f"constant delay, here the mean age of what is received, {age:.4g} s.",
    )

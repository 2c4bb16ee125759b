"""The independent solution over channels that are no constant delay."""

from functools import partial
from math import inf, isinf

import numpy as np
from benchmarks.accuracy import Solve
from independent_solver import Packets, Result
from scipy.optimize import brentq

from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.model.channels import ChannelConfig
from teleop_drake.model.scenario import Scenario


class _Variable(Result):
    """Both delays are T(t) = delay + amplitude sin(frequency t + phase)."""

    def __init__(self, task, wave):
        super().__init__(task)
        self._wave = wave
        self.longest_step = task.forward_delay - wave.amplitude

    def sent(self, t, channel):
        wave = self._wave
        delay = wave.amplitude * np.sin(wave.frequency * t + wave.phase)
        return t - self.delays[channel] - delay

    def arrival(self, t, channel):
        if isinf(t):
            return inf
        latest = t + self.delays[channel] + self._wave.amplitude
        return brentq(lambda x: self.sent(x, channel) - t, t, latest, xtol=1e-14)


def ChannelOracle(scenario: Scenario) -> Result:
    """Returns the independent solution of a thesis's task over its channels.

    Both channels have the same configuration, of kind variable, sampled or network
    (receiver newest).
    """
    channel = scenario.forward_channel
    duration = scenario.duration
    if channel.kind == "variable":
        make = partial(_Variable, wave=channel.sinusoid)
    else:
        ways = ("forward_channel", "return_channel")
        arrivals = [_Arrivals(channel, duration, way) for way in ways]
        make = partial(Packets, period=channel.sample_period, arrivals=arrivals)
    arguments = scenario.name, scenario.controller.kind, channel.delay, duration
    return Solve(*arguments, rtol=1e-10, make=make)


def _Arrivals(channel: ChannelConfig, duration: float, stream: str) -> list[float]:
    period = channel.sample_period
    assert period is not None
    count = round(duration / period) + 1
    if channel.kind == "sampled":
        return [k * period + channel.delay for k in range(count)]
    network = PacketNetwork(
        profile=channel.Profile(duration),
        sample_period=period,
        jitter=channel.jitter,
        loss=channel.loss,
        seed=channel.seed,
        stream=stream,
    )
    return network.Arrivals(count).tolist()

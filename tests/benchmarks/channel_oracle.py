"""The independent solution over channels that are no constant delay."""

import bisect
from functools import partial
from math import inf, isinf

import numpy as np
from benchmarks.accuracy import Solve
from independent_solver import Result
from scipy.optimize import brentq

from teleop_drake.channels import ChannelConfig
from teleop_drake.channels.packet_network import PacketNetwork
from teleop_drake.scenario import Scenario

_TINY = 1e-12


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


class _Packets(Result):
    """Both directions hold the newest packet that has arrived.

    A step ends at each sending and each arrival. When packets of a network arrive is
    drawn from a seed: those times are the package's, as data.
    """

    def __init__(self, task, period, arrivals):
        super().__init__(task)
        self.longest_step, self._period, self._arrivals = inf, period, arrivals
        times = {time for way in arrivals for time in way if time < inf}
        self.breakpoints = sorted(times | {k * period for k in range(len(arrivals[0]))})
        self._sent: tuple[list, list] = ([], [])
        zero = np.zeros(self.n)
        # (when it arrived, its number, what it says) of the packets shown, by channel.
        self._shown = (
            [(-inf, -1, np.concatenate([zero, zero]))],
            [(-inf, -1, np.concatenate([self.p_start, zero]))],
        )

    def arrival(self, t, channel):
        return inf  # The breakpoints are known before.

    def arrive(self, t, y, layer):
        if t >= len(self._sent[0]) * self._period - _TINY:
            v_d, force = self.command(t)
            if force is None:
                force = self.device_force(y)
            p, v, _ = self.motion(layer, y)
            self._sent[0].append(np.concatenate([v_d, force]))
            self._sent[1].append(np.concatenate([p, v]))
        for sent, times, shown in zip(
            self._sent, self._arrivals, self._shown, strict=True
        ):
            for k in range(shown[-1][1] + 1, len(sent)):
                if times[k] <= t + _TINY:
                    shown.append((t, k, sent[k]))
        if self.perceives and isinf(self.perceived):
            surface = self.task.layers[self.task.contact_index()].start
            if self._Newest(t, 1)[0][0] >= surface:
                self.perceived = t

    def _Newest(self, t, channel):
        """Returns the two halves of the packet that is shown at t."""
        shown = self._shown[channel]
        i = bisect.bisect_right(shown, t, key=lambda packet: packet[0])
        return np.split(shown[i - 1][2], 2)

    def received_command(self, t):
        return self._Newest(t, 0)

    def felt(self, t, p, v):
        return self._Newest(t, 1)


def ChannelOracle(scenario: Scenario) -> Result:
    """Returns the independent solution of a thesis's task over its channels.

    Both channels have the same configuration, of kind variable, sampled or network
    (receiver newest).
    """
    channel, duration = scenario.forward_channel, scenario.duration
    if channel.kind == "variable":
        make = partial(_Variable, wave=channel.sinusoid)
    else:
        ways = ("forward_channel", "return_channel")
        arrivals = [_Arrivals(channel, duration, way) for way in ways]
        make = partial(_Packets, period=channel.sample_period, arrivals=arrivals)
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

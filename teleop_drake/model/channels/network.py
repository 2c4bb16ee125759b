"""A channel of packets with jitter, loss and reordering, and its receiver."""

import math
from collections.abc import Callable, Sequence
from dataclasses import field, replace

import numpy as np

from teleop_drake.loops.delays.base import SHORTEST_TIME
from teleop_drake.loops.delays.netem import Chance, GilbertElliott, Netem, ParseNetem
from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Jitter, Loss, Receiver
from teleop_drake.loops.delays.packet_random import BLOCK, PacketRandom
from teleop_drake.loops.delays.packet_statistics import (
    ComputePacketStatistics,
)
from teleop_drake.loops.delays.variable import DelayProfile
from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.validation import (
    REQUIRED,
    CheckNumber,
    Config,
    Refuse,
    ScenarioError,
    Within,
)
from teleop_drake.model.channels.base import ConstantDelay
from teleop_drake.model.channels.sampled import CheckSamplePeriod
from teleop_drake.model.channels.trace import Trace
from teleop_drake.model.channels.variable import VaryingDelayConfig
from teleop_drake.model.tables.histogram import Histogram
from teleop_drake.model.tables.measured import HALVED

# From this number of packets on for each entry of a trace, a note tells of losses.
_MANY = 2


def CheckPeriods(mean: float, periods: Sequence[float], jitter: Jitter) -> None:
    """Checks times between packets that differ.

    Args:
        mean: Their mean, s.
        periods: The times, s; empty: they are not listed.
        jitter: Their random part.

    Raises:
        ScenarioError: If they are not allowed.
    """
    with Within("period_jitter"):
        try:
            jitter.Check()
        except ScenarioError as error:
            raise ScenarioError(str(error).removeprefix("jitter.")) from None
        if jitter.keeps_order:
            Refuse("keeps_order", True, "false: packets are sent one after another")
        CheckNumber("minimum", jitter.minimum, "s", minimum=0, maximum=mean)
        if jitter.kind == "gamma" and jitter.minimum == mean:
            Refuse("minimum", jitter.minimum, f"less than the mean period, {mean:g} s")
        if jitter.kind == "uniform" and math.sqrt(3) * jitter.std >= mean:
            most = mean / math.sqrt(3)
            Refuse("std", jitter.std, f"< {most:g} (s), so that no period is negative")
    if not periods:
        return
    if jitter.kind != "none":
        Refuse("period_jitter.kind", jitter.kind, "none with periods")
    for i, period in enumerate(periods):
        CheckNumber(f"periods.{i}", period, "s", minimum=SHORTEST_TIME)
    found = sum(periods) / len(periods)
    if not math.isclose(found, mean, rel_tol=1e-6):
        Refuse("sample_period", mean, f"{found:.9g} (s), the mean of periods")


@Config
class NetworkChannelConfig(VaryingDelayConfig):
    """Sends a packet each sample period through a network with jitter and loss."""

    kind = "network"
    draws_random_numbers = True
    has_packet_statistics = True

    # Time between packets, s, > 0; the mean if it varies.
    sample_period: float = REQUIRED
    # Times between packets, s, which are repeated; their mean is sample_period. Empty:
    # they do not differ.
    periods: list[float] = field(default_factory=list)
    # The random part of the time between packets, whose mean is sample_period.
    period_jitter: Jitter = field(default_factory=Jitter)
    jitter: Jitter = field(default_factory=Jitter)
    loss: Loss = field(default_factory=Loss)
    # Share of packets that are sent twice, 0 to 1. Each copy is lost and delayed by
    # itself; the receiver uses the first that arrives.
    duplicates: float = 0.0
    # Options of netem as tc takes them, for example "delay 100ms 10ms loss 1%", in the
    # place of jitter, loss and duplicates; see loops.delays.netem. A delay in it must
    # equal `delay`. Null: none.
    netem: str | None = None
    receiver: Receiver = field(default_factory=Receiver)

    def Check(self, path: str, duration: float) -> None:
        """Checks every field; reads the trace."""
        super().Check(path, duration)
        CheckSamplePeriod(path, self.sample_period, self.delay)
        with Within(path):
            CheckPeriods(self.sample_period, self.periods, self.period_jitter)
            self.receiver.Check()
        self.Network(duration, path=path)

    def Network(
        self, duration: float, *, stream: str = "", path: str = "channel"
    ) -> PacketNetwork:
        """Returns the network, which determines when each packet arrives.

        Args:
            duration: The time until which packets are sent, s.
            stream: Name of the channel, as in MakeChannel.
            path: The channel's field in a scenario, for messages.
        """
        profile, trace = self.Read(duration, path, stream)
        with Within(path):
            return self._Network(profile, trace, stream)

    def DrawTrace(self, duration: float, stream: str) -> Callable[[Histogram], Trace]:
        """Returns a function that draws the delay of each packet from a histogram."""

        def Draw(histogram: Histogram) -> Trace:
            if math.isinf(duration):
                Refuse("duration", duration, "finite with a histogram of delays (s)")
            count = math.floor(duration / self.sample_period) + 2
            name = f"{stream}/histogram".encode()
            seeds = np.random.SeedSequence(self.seed, spawn_key=tuple(name))
            shares = np.random.Generator(np.random.Philox(seeds)).random(count)
            return Trace(
                times=np.arange(count) * self.sample_period,
                delays=histogram.Quantiles(shares),
                is_lost=np.zeros(count, bool),
                is_halved=histogram.kind == HALVED,
                summary=histogram.Summary(),
            )

        return Draw

    def _Network(
        self, profile: DelayProfile, trace: Trace | None, stream: str
    ) -> PacketNetwork:
        netem = None if self.netem is None else ParseNetem("netem", self.netem)
        return PacketNetwork(
            profile=profile,
            is_lost=None if trace is None else trace.IsLost,
            sample_period=self.sample_period,
            periods=self._Periods(profile.duration, stream),
            jitter=self.jitter,
            loss=self.loss,
            duplicates=self.duplicates,
            netem=netem,
            seed=self.seed,
            stream=stream,
        )

    def HasUnevenPeriods(self) -> bool:
        """Returns whether the times between packets differ."""
        return bool(self.periods) or self.period_jitter.kind != "none"

    def _Periods(self, duration: float, stream: str) -> Array | None:
        """Returns the times between packets until a time in s; None: all are equal."""
        if not self.HasUnevenPeriods():
            return None
        if duration == math.inf:
            Refuse("duration", duration, "finite where the times between packets vary")
        count = math.ceil(duration / self.sample_period)
        if self.periods:
            repeats = count // len(self.periods) + 2
            return np.tile(np.array(self.periods, dtype=float), repeats)
        random = PacketRandom(self.seed, f"{stream}/period")
        num_blocks = count // BLOCK + 1
        periods = np.empty(0)
        while periods.sum() <= duration:
            jitters = random.Jitters(
                self.period_jitter, self.sample_period, self.sample_period, num_blocks
            )
            periods = np.maximum(self.sample_period + jitters, SHORTEST_TIME)
            num_blocks += 1
        return periods

    def MakeChannel(
        self,
        *,
        size: int,
        initial_value: Sequence[float],
        duration: float = math.inf,
        stream: str = "",
    ) -> NetworkDelay:
        """Makes the block; see ChannelConfig.MakeChannel."""
        profile, trace = self.Read(duration, stream=stream)
        block = NetworkDelay(
            network=self._Network(profile, trace, stream),
            receiver=self.receiver,
            size=size,
            initial_value=initial_value,
        )
        block.notes = self._Notes(trace)
        return block

    def _Notes(self, trace: Trace | None) -> list[str]:
        """Returns what was read, and for how many packets a loss in it stands."""
        if trace is None:
            return []
        notes = [trace.summary]
        step = float(np.median(np.diff(trace.times)))
        count = round(step / self.sample_period)
        if trace.is_lost.any() and count >= _MANY:
            notes.append(
                f"a packet that was lost in the trace stands for about {count} "
                f"packets, because its entries are {step:.4g} s apart and the packets "
                f"{self.sample_period:g} s; `loss` loses packets one by one"
            )
        return notes

    def PacketPeriod(self) -> float:
        """Returns the sample period in s."""
        return self.sample_period

    def AsNetem(self, duration: float) -> tuple[Netem, list[str]]:
        """Returns options of netem for the network; see ChannelConfig."""
        like, missing = super().AsNetem(duration)
        jitter = self.jitter
        names = {"uniform": "uniform", "normal": "normal", "gamma": "normal"}
        width = math.sqrt(3) if jitter.kind == "uniform" else 1.0
        if jitter.kind == "gamma":
            missing.append("gamma distribution: the line has a normal one")
        lacks = {
            "a least delay": jitter.kind != "none" and jitter.minimum > 0,
            "the correlation of delays: that of netem leaves delays independent": (
                jitter.correlation_time > 0
            ),
            "delays that are held from packet to packet": jitter.hold > 0,
            "the order of packets: netem lets fast ones overtake": jitter.keeps_order,
            "times between packets that vary": self.HasUnevenPeriods(),
            f"the receiver, {self.receiver.policy}": self.receiver.policy != "newest",
        }
        missing += [name for name, is_lacking in lacks.items() if is_lacking]
        lost = self._TraceLoss(duration)
        if lost > 0:
            missing.append(f"the losses of the trace, {100 * lost:.3g} % of packets")
        if self.netem is not None:
            own = ParseNetem("netem", self.netem)
            return replace(own, delay=like.delay), missing
        options = replace(
            like,
            jitter=round(1e9 * width * jitter.std),
            distribution=names.get(jitter.kind, "uniform"),
            loss=self._NetemLoss(),
            duplicate=Chance(share=self.duplicates),
        )
        return options, missing

    def _TraceLoss(self, duration: float) -> float:
        """Returns the share of packets that the trace loses."""
        _, trace = self.Read(duration)
        if trace is None:
            return 0.0
        sent = np.arange(math.ceil(duration / self.sample_period)) * self.sample_period
        return float(trace.IsLost(sent).mean())

    def _NetemLoss(self) -> Chance | GilbertElliott:
        loss = self.loss
        if loss.kind in ("none", "independent"):
            return Chance(share=loss.probability)
        _, to_bad, to_good = loss.Chain()
        return GilbertElliott(
            to_bad=to_bad,
            to_good=to_good,
            bad_loss=loss.bad_loss,
            good_loss=loss.good_loss,
        )

    def Arrivals(self, sent: ArrayLike, duration: float, stream: str = "") -> Array:
        """Returns the arrival times in s of the packets sent nearest to given times."""
        network = self.Network(duration, stream=stream)
        stamps = network.SentTimes(network.CountUntil(duration) or 1)
        arrivals = network.Arrivals(len(stamps))
        between = (stamps[1:] + stamps[:-1]) / 2
        return arrivals[np.searchsorted(between, np.asarray(sent, dtype=float))]

    def AsConstantDelay(self, path: str, duration: float) -> ConstantDelay:
        """Returns the mean age of information at the output of the receiver.

        It is computed from the packets that this network delivers with its seed.

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

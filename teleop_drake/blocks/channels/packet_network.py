"""Networks that delay, lose and reorder packets.

    d_k  = T(k h) + jitter_k          delay of packet k, sent at k h; infinite if lost

Jitter is independent from packet to packet, or correlated. Correlated jitter is a
first-order autoregressive sequence g, transformed to the distribution function F of the
jitter,

    g_k  = a g_(k-1) + sqrt(1 - a^2) n_k,  n_k ~ N(0, 1),  a = exp(-h/correlation_time)
    jitter_k = F^-1(Phi(g_k))         Phi: distribution function of N(0, 1)

so that every packet has the same distribution as without correlation. The rank
correlation between packets m apart is 6/pi asin(a^m/2). D. A. Vivanco and A. P.
Jayasumana (A measurement-based modeling approach for network-induced packet delay, LCN
2007) find autoregressive models in measured delays. If packets keep their order, a
packet that is faster than its predecessor waits for it:

    arrival_k = max(k h + d_k, arrival_j)       packet j: the last before k not lost

Every random number is a pure function of (seed, stream, impairment, k), computed by
NumPy's counter-based Philox generator. It depends neither on the order of evaluation
nor on the parameters of other impairments.

A ValueError names the parameter by its place in a channel ("jitter.std"), its value
and the allowed values.
"""

import itertools
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from teleop_drake.blocks.channels.variable import DelayProfile
from teleop_drake.numerics.instants import SAME, TIE
from teleop_drake.validation import (
    CheckChoice,
    CheckNumber,
    FixedFields,
    Number,
    Refuse,
)

Array = np.ndarray

# Number of packets whose random numbers are drawn together.
_BLOCK = 1024


@dataclass(kw_only=True)
class PacketConfig(FixedFields):
    """Base of the configs in which one field decides which others have an effect.

    Attributes:
        choice: Name of the field that decides.
        used: The fields that have an effect, keyed by the value of the field `choice`.
    """

    choice: ClassVar[str] = "kind"
    used: ClassVar[dict[str, tuple[str, ...]]] = {}

    def Check(self) -> None:
        """Checks every field; fields without effect must have their defaults.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        path = type(self).__name__.lower()
        choice = getattr(self, self.choice)
        CheckChoice(f"{path}.{self.choice}", choice, self.used)
        self.CheckNumbers(path)
        for item in fields(self):
            value = getattr(self, item.name)
            is_used = item.name in (self.choice, *self.used[choice])
            if not is_used and value != item.default:
                default = f"{item.default:g} where {path}.{self.choice} is {choice}"
                Refuse(f"{path}.{item.name}", value, default)


@dataclass(kw_only=True)
class Jitter(PacketConfig):
    """The random part of the delays of packets.

    uniform: within sqrt(3) std on either side of the mean.
    normal:  the density of N(mean, std^2), truncated below `minimum` and normalized
             again. Mean and std are the values before the truncation.
    gamma:   minimum + Gamma(shape, scale) with shape = ((mean - minimum) / std)^2 and
             scale = std^2 / (mean - minimum).

    The mean is the channel's `delay`.
    """

    used: ClassVar = {
        "none": ("keeps_order",),
        "uniform": ("std", "correlation_time", "keeps_order"),
        "normal": ("std", "minimum", "correlation_time", "keeps_order"),
        "gamma": ("std", "minimum", "correlation_time", "keeps_order"),
    }

    # One of the keys of `used`.
    kind: str = "none"
    # Standard deviation, s, >= 0.
    std: float = Number(0.0, "s", minimum=0)
    # Smallest delay, s, 0 to `delay`; normal and gamma only, else 0. The parts of the
    # delay that vary with time are added to it.
    minimum: float = 0.0
    # Time constant of the correlation between the delays of packets, s, >= 0. 0: the
    # delays are independent.
    correlation_time: float = Number(0.0, "s", minimum=0)
    # Whether packets arrive in the order in which they are sent. A packet that waits
    # for its predecessor arrives later than mean and std imply. The effect grows as the
    # sample period and the correlation time become shorter.
    keeps_order: bool = False


@dataclass(kw_only=True)
class Loss(PacketConfig):
    """The loss of packets.

    independent: each packet is lost with `probability`.
    burst:       the Gilbert-Elliott model. A Markov chain is in a good or a bad state
                 at each packet; a packet is lost with the probability good_loss or
                 bad_loss. The chain leaves the bad state with the probability
                 1 / burst_length and starts in its stationary distribution. The share
                 of packets in the bad state is such that the share `probability` of all
                 packets is lost in the long run.

    Source: E. N. Gilbert, Bell Syst. Tech. J. 39 (1960); E. O. Elliott, ibid. 42
    (1963).
    """

    used: ClassVar = {
        "none": (),
        "independent": ("probability",),
        "burst": ("probability", "burst_length", "good_loss", "bad_loss"),
    }

    # One of the keys of `used`.
    kind: str = "none"
    # Share of packets lost in the long run, 0 to 1; below 1 for burst.
    probability: float = Number(0.0, "1", minimum=0, maximum=1)
    # Mean length of the bad state, packets, >= 1; burst only.
    burst_length: float = Number(1.0, "packets", minimum=1)
    # Share lost in the good state, 0 to `probability`; burst only.
    good_loss: float = Number(0.0, "1", minimum=0, maximum=1)
    # Share lost in the bad state, more than good_loss, `probability` to 1; burst only.
    bad_loss: float = Number(1.0, "1", minimum=0, maximum=1)


@dataclass(kw_only=True)
class Receiver(PacketConfig):
    """The policy of the receiver. It discards packets older than the one it shows.

    newest:      holds the packet with the newest time stamp.
    playout:     like `newest`, but shows a packet no earlier than delay + depth after
                 it was sent. A packet that arrives later is shown at once. The clocks
                 of sender and receiver are assumed to agree.
    extrapolate: shows the newest packet at its arrival, and then extrapolates with the
                 slope of the line through the time stamps and values of this packet and
                 of the one that it replaced.
    """

    choice = "policy"
    used: ClassVar = {"newest": (), "playout": ("depth",), "extrapolate": ()}

    # One of the keys of `used`.
    policy: str = "newest"
    # Time from sending to showing a packet in excess of `delay`, s, >= 0; playout only,
    # else 0.
    depth: float = Number(0.0, "s", minimum=0)


class PacketNetwork:
    """A network through which a packet is sent every sample period.

    Args:
        profile: The part of the delay that is not random.
        sample_period: h in s, > 0 and at most the duration of the profile.
        jitter: The random part of the delay; None: there is none.
        loss: The random losses; None: there are none.
        is_lost: Function that returns which packets are lost as well (N), for the times
            in s when they are sent (N). None: there are no further losses.
        seed: Seed of the random numbers, >= 0.
        stream: Name of the channel. Networks with equal seed and name have the same
            random numbers; networks with different names are independent.

    Raises:
        ValueError: If a parameter is outside its range or a delay may be negative.
    """

    def __init__(
        self,
        *,
        profile: DelayProfile,
        sample_period: float,
        jitter: Jitter | None = None,
        loss: Loss | None = None,
        is_lost: Callable[[Array], Array] | None = None,
        seed: int = 0,
        stream: str = "",
    ):
        self.profile = profile
        self.sample_period = float(sample_period)
        self._jitter = jitter or Jitter()
        self._loss = loss or Loss()
        self._is_lost = is_lost
        self._seed = seed
        self._stream = stream
        if not 0 < sample_period <= profile.duration or math.isinf(sample_period):
            Refuse(
                "sample_period",
                sample_period,
                f"a finite number > 0 and <= {profile.duration:g} (s)",
            )
        if seed < 0:
            Refuse("seed", seed, "a whole number >= 0")
        self._CheckJitter()
        self._CheckLoss()
        # Arrival times of the first packets in s; NaN beyond the profile's duration.
        self._arrivals = np.empty(0)
        self._lock = threading.Lock()

    def _CheckJitter(self) -> None:
        """Checks the jitter, and that no delay is negative."""
        jitter = self._jitter
        mean = self.profile.delay
        jitter.Check()
        # The smallest jitter of each kind, and then the smallest delay.
        least = 0.0
        if jitter.kind == "uniform":
            least = -math.sqrt(3) * jitter.std
        elif jitter.kind != "none":
            CheckNumber("jitter.minimum", jitter.minimum, "s", minimum=0, maximum=mean)
            if jitter.kind == "gamma" and jitter.std > 0 and jitter.minimum == mean:
                Refuse(
                    "jitter.minimum",
                    jitter.minimum,
                    f"less than the mean delay, {mean:g} s",
                )
            least = jitter.minimum - mean if jitter.std > 0 else 0.0
        least += self.profile.minimum
        # A margin for the rounding of the sum of the bounds.
        if least >= -1e-12:
            return
        if jitter.kind == "uniform":
            Refuse(
                "jitter.std",
                jitter.std,
                f"such that the delay, down to {least:g} s, is never negative",
            )
        Refuse(
            "jitter.minimum",
            jitter.minimum,
            f">= {jitter.minimum - least:g} (s), so that with what varies with "
            "time no delay is negative",
        )

    def _CheckLoss(self) -> None:
        """Checks the loss, and that the chain of bursts exists."""
        loss = self._loss
        loss.Check()
        if loss.kind != "burst":
            return
        if not loss.good_loss < loss.bad_loss:
            Refuse("loss.bad_loss", loss.bad_loss, f"> good_loss, {loss.good_loss:g}")
        # The chain enters the bad state with the probability
        # share / (1 - share) / burst_length, which must not exceed 1.
        most = loss.good_loss + (loss.bad_loss - loss.good_loss) * (
            loss.burst_length / (1 + loss.burst_length)
        )
        # The chain leaves the bad state, so it cannot be in that state at all packets.
        bad_share = loss.probability - loss.good_loss
        is_always_bad = bad_share >= loss.bad_loss - loss.good_loss
        if is_always_bad or not loss.good_loss <= loss.probability <= most:
            Refuse(
                "loss.probability",
                loss.probability,
                f">= {loss.good_loss:g} and <= {most:g}, and less than bad_loss, with "
                "this burst_length, good_loss and bad_loss",
            )

    def Arrival(self, k: int) -> float:
        """Returns the arrival time in s of packet k, sent at k h; infinity if lost.

        Raises:
            ValueError: If it is sent beyond the duration of the profile.
        """
        with self._lock:  # Runs in several threads share a channel.
            if k >= len(self._arrivals):
                self._arrivals = self._Arrivals(2 * (k // _BLOCK + 1))
        arrival = float(self._arrivals[k])
        if math.isnan(arrival):
            # The profile raises the ValueError.
            self.profile(k * self.sample_period)
        return arrival

    def Arrivals(self, count: int) -> Array:
        """Returns the arrival times of packets 0 to count - 1, s; lost: infinity."""
        return np.array([self.Arrival(k) for k in range(count)])

    def Shown(self, k: int, receiver: Receiver) -> float:
        """Returns the time in s when packet k is shown unless there is a newer one.

        Raises:
            ValueError: If it is sent beyond the duration of the profile.
        """
        arrival = self.Arrival(k)
        if receiver.policy != "playout":
            return arrival
        due = k * self.sample_period + self.profile.delay + receiver.depth
        return max(arrival, float(self._Snap(np.array(due))))

    def ShownUntil(self, receiver: Receiver, end: float) -> tuple[Array, Array]:
        """Returns the times when a receiver shows packets, and their time stamps.

        Args:
            receiver: The receiver.
            end: The time in s before which packets are sent and shown.

        Returns:
            The times in s when the receiver shows a packet or discards it as outdated,
            ascending (N), and the time stamps in s of the packets then shown (N).
        """
        sent = range(self.CountUntil(end))
        shown = np.array([self.Shown(k, receiver) for k in sent])
        stamps = np.arange(len(sent)) * self.sample_period
        order = np.argsort(shown, kind="stable")
        order = order[shown[order] < end]
        return shown[order], np.maximum.accumulate(stamps[order])

    def CountUntil(self, end: float) -> int:
        """Returns the number of packets sent before a time in s."""
        return math.ceil(end / self.sample_period - TIE)

    def _Draw(
        self, impairment: str, num_blocks: int, draw: Callable[..., Array], *of: float
    ) -> Array:
        """Returns random numbers of an impairment, one for each packet of some blocks.

        Args:
            draw: The method of a Generator that draws them.
            of: The parameters of their distribution.
        """
        name = f"{self._stream}/{impairment}".encode()
        sequence = np.random.SeedSequence(self._seed, spawn_key=tuple(name))
        key = sequence.generate_state(2, np.uint64)
        numbers = []
        for block in range(num_blocks):
            # The upper half of the counter's 256 bits is the number of the block.
            bits = np.random.Philox(key=key, counter=block << 128)
            numbers.append(draw(np.random.Generator(bits), *of, _BLOCK))
        return np.concatenate(numbers)

    def _Arrivals(self, num_blocks: int) -> Array:
        """Returns the arrival times in s of the packets of the first blocks.

        That of a lost packet is infinity. That of a packet sent beyond the duration of
        the profile is NaN.
        """
        sent = np.arange(num_blocks * _BLOCK) * self.sample_period
        # The profile allows times up to its duration with the same margin.
        sent = sent[sent <= self.profile.duration * (1 + 1e-9)]
        delays = self.profile(sent) + self._Jitters(num_blocks)[: len(sent)]
        times = sent + np.maximum(delays, 0.0)
        has_arrived = ~self._Losses(num_blocks)[: len(sent)]
        if self._is_lost is not None:
            has_arrived &= ~self._is_lost(sent)
        if self._jitter.keeps_order:
            times[has_arrived] = np.maximum.accumulate(times[has_arrived])
        arrivals = np.full(num_blocks * _BLOCK, math.nan)
        arrivals[: len(sent)] = np.where(has_arrived, self._Snap(times), math.inf)
        return arrivals

    def _Snap(self, times: Array) -> Array:
        # Moves times that are at a tick but for rounding: 0.1 + 3 * 0.1 is not 4 * 0.1.
        ticks = np.round(times / self.sample_period) * self.sample_period
        return np.where(np.isclose(times, ticks, rtol=2e-15, atol=SAME), ticks, times)

    def _Jitters(self, num_blocks: int) -> Array:
        """Returns the jitter of the packets of the first blocks in s."""
        jitter = self._jitter
        std = jitter.std
        excess = self.profile.delay - jitter.minimum
        if jitter.kind == "none" or std == 0:
            return np.zeros(num_blocks * _BLOCK)
        if jitter.kind == "gamma" and not jitter.correlation_time:
            of = (excess / std) ** 2, std**2 / excess
            return self._Draw("jitter", num_blocks, Generator.gamma, *of) - excess

        from scipy.special import gammaincinv, ndtr, ndtri  # The import takes 0.1 s.

        u = np.clip(self._Shares(num_blocks), 2.0**-53, 1 - 2.0**-53)
        jitters: Array
        if jitter.kind == "gamma":
            jitters = gammaincinv((excess / std) ** 2, u) * std**2 / excess - excess
        elif jitter.kind == "uniform":
            jitters = math.sqrt(3) * std * (2 * u - 1)
        else:
            # The inverse of the cumulative distribution above the minimum.
            jitters = np.maximum(-std * ndtri(u * ndtr(excess / std)), -excess)
        return jitters

    def _Shares(self, num_blocks: int) -> Array:
        """Returns the value of the jitter's distribution function for each packet."""
        time = self._jitter.correlation_time
        if not time:
            return self._Draw("jitter", num_blocks, Generator.random)
        a = math.exp(-self.sample_period / time)
        noise = self._Draw("jitter", num_blocks, Generator.standard_normal)

        def Next(g: float, n: float) -> float:
            return a * g + math.sqrt(1 - a * a) * n

        from scipy.special import ndtr

        shares: Array = ndtr(list(itertools.accumulate(noise.tolist(), Next)))
        return shares

    def _Losses(self, num_blocks: int) -> NDArray[np.bool_]:
        """Returns whether each packet of the first blocks is lost."""
        loss = self._loss
        probability: float | Array = loss.probability
        if loss.kind == "burst":
            is_bad = self._Bursts(num_blocks)
            probability = np.where(is_bad, loss.bad_loss, loss.good_loss)
        return self._Draw("loss", num_blocks, Generator.random) < probability

    def _Bursts(self, num_blocks: int) -> list[bool]:
        """Returns whether the chain of bursts is in its bad state at each packet."""
        loss = self._loss
        share = (loss.probability - loss.good_loss) / (loss.bad_loss - loss.good_loss)
        leave = 1 / loss.burst_length
        enter = leave * share / (1 - share)

        def Next(is_bad: bool, step: float) -> bool:
            return step >= leave if is_bad else step < enter

        first, *others = self._Draw("burst", num_blocks, Generator.random).tolist()
        return list(itertools.accumulate(others, Next, initial=first < share))

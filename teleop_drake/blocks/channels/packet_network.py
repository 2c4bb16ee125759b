"""Networks that delay, lose and reorder packets.

    d_k  = T(k h) + jitter_k          delay of packet k, sent at k h; infinite if lost

Jitter is independent from packet to packet, or correlated: then a first-order
autoregressive sequence g is put through the distribution function F of the jitter,

    g_k  = a g_(k-1) + sqrt(1 - a^2) n_k,  n_k ~ N(0, 1),  a = exp(-h/correlation_time)
    jitter_k = F^-1(Phi(g_k))         Phi that of N(0, 1)

so that every packet has the same distribution as without correlation. Rank correlation
is 6/pi asin(a^m/2) between packets m apart. D. A. Vivanco and A. P. Jayasumana (A
measurement-based modeling approach for network-induced packet delay, LCN 2007) find
autoregressive models in measured delays. Where packets keep their order, one that is
faster than its predecessor waits for it:

    arrival_k = max(k h + d_k, arrival_(k-1))       the latest that is not lost

Every random number is a pure function of (seed, stream, impairment, k), from numpy's
counter-based Philox generator: nothing depends on who asks first or how often, and the
parameters of one impairment leave the numbers of the others alone.

A ValueError names the parameter by its place in a channel ("jitter.std"), its value
and what is allowed.
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

_BLOCK = 1024


@dataclass(kw_only=True)
class PacketConfig(FixedFields):
    """Base of what happens to packets: one of its fields says which others count.

    Attributes:
        choice: Name of that field.
        used: By each of its values, the fields that have an effect.
    """

    choice: ClassVar[str] = "kind"
    used: ClassVar[dict[str, tuple[str, ...]]] = {}

    def Check(self) -> None:
        """Checks every field; those without effect have to keep their defaults.

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
    """How the delays of the packets scatter.

    uniform: within sqrt(3) std on either side of the mean.
    normal:  the density of N(mean, std^2) above `minimum`, zero below and normalized
             again. Mean and std are those before this truncation.
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

    # One of those of `used`.
    kind: str = "none"
    # Standard deviation, s, >= 0.
    std: float = Number(0.0, "s", minimum=0)
    # Least delay, s, 0 to `delay`; normal and gamma only, else 0. What varies with
    # time comes on top.
    minimum: float = 0.0
    # After which time the delay has forgotten what it was, s, >= 0. 0: each packet is
    # independent of the others.
    correlation_time: float = Number(0.0, "s", minimum=0)
    # Whether no packet overtakes another one. What waits arrives later than the mean
    # and std say, the more so the shorter the sample period and the correlation time.
    keeps_order: bool = False


@dataclass(kw_only=True)
class Loss(PacketConfig):
    """Which packets never arrive.

    independent: each with `probability`.
    burst:       the Gilbert-Elliott model. A Markov chain is in a good or a bad state
                 at each packet; a packet is lost with good_loss or bad_loss. The
                 chain leaves the bad state with 1 / burst_length, starts in its
                 stationary distribution, and has a share of bad packets such that
                 `probability` are lost in the long run.

    Source: E. N. Gilbert, Bell Syst. Tech. J. 39 (1960); E. O. Elliott, ibid. 42
    (1963).
    """

    used: ClassVar = {
        "none": (),
        "independent": ("probability",),
        "burst": ("probability", "burst_length", "good_loss", "bad_loss"),
    }

    # One of those of `used`.
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
    """What the receiver makes of the packets; older ones than it has are discarded.

    newest:      holds the packet with the newest time stamp.
    playout:     the same, but shows a packet no earlier than delay + depth after it
                 was sent; one that is late is shown at once. The clocks agree.
    extrapolate: goes on from the newest packet, from its arrival, along the line
                 through the time stamps and values of this packet and the one it
                 replaced.
    """

    choice = "policy"
    used: ClassVar = {"newest": (), "playout": ("depth",), "extrapolate": ()}

    # One of those of `used`.
    policy: str = "newest"
    # How much longer than `delay` a packet waits, s, >= 0; playout only, else 0.
    depth: float = Number(0.0, "s", minimum=0)


class PacketNetwork:
    """A network to which a packet is given every sample period.

    Args:
        profile: The part of the delay that is not random.
        sample_period: h in s, > 0 and at most the duration of the profile.
        jitter: The random part of the delay.
        loss: Which packets never arrive.
        is_lost: Which packets, beside these, never arrive, by the times when they are
            sent in s (N); None: no such packet.
        seed: >= 0. The same seed and stream give the same packets.
        stream: Name of the channel. Other names make independent networks.

    Raises:
        ValueError: If a parameter is outside its range or a delay might be negative.
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
        # Those of the first packets; NaN beyond the duration of the profile.
        self._arrivals = np.empty(0)
        self._lock = threading.Lock()

    def _CheckJitter(self) -> None:
        """Checks the jitter, and that no delay is negative."""
        jitter = self._jitter
        mean = self.profile.delay
        jitter.Check()
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
        # The chain enters the bad state with share / (1 - share) / burst_length.
        most = loss.good_loss + (loss.bad_loss - loss.good_loss) * (
            loss.burst_length / (1 + loss.burst_length)
        )
        # A chain that is always in the bad state cannot leave it and come back.
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
        """Returns when packet k, sent at k h, arrives (s); infinity if it is lost.

        Raises:
            ValueError: If it is sent beyond the duration of the profile.
        """
        with self._lock:  # Runs in several threads share a channel.
            if k >= len(self._arrivals):
                self._arrivals = self._Arrivals(2 * (k // _BLOCK + 1))
        arrival = float(self._arrivals[k])
        if math.isnan(arrival):
            self.profile(k * self.sample_period)
        return arrival

    def Arrivals(self, count: int) -> Array:
        """Returns when packets 0 to count - 1 arrive (s); infinity if lost."""
        return np.array([self.Arrival(k) for k in range(count)])

    def Shown(self, k: int, receiver: Receiver) -> float:
        """Returns when a receiver shows packet k if it has no newer one (s).

        Raises:
            ValueError: If it is sent beyond the duration of the profile.
        """
        arrival = self.Arrival(k)
        if receiver.policy != "playout":
            return arrival
        due = k * self.sample_period + self.profile.delay + receiver.depth
        return max(arrival, float(self._Snap(np.array(due))))

    def ShownUntil(self, receiver: Receiver, end: float) -> tuple[Array, Array]:
        """Returns what a receiver shows of the packets sent before a time.

        Returns:
            When it shows something (N), ascending, and the time stamp of it (N), in s.
        """
        sent = range(self.CountUntil(end))
        shown = np.array([self.Shown(k, receiver) for k in sent])
        stamps = np.arange(len(sent)) * self.sample_period
        order = np.argsort(shown, kind="stable")
        order = order[shown[order] < end]
        return shown[order], np.maximum.accumulate(stamps[order])

    def CountUntil(self, end: float) -> int:
        """Returns how many packets are sent before a time in s."""
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
            # Of the 256 bits of the counter, the upper half tells the blocks apart.
            bits = np.random.Philox(key=key, counter=block << 128)
            numbers.append(draw(np.random.Generator(bits), *of, _BLOCK))
        return np.concatenate(numbers)

    def _Arrivals(self, num_blocks: int) -> Array:
        """Returns when the packets of the first blocks arrive (s).

        A packet that is lost arrives at infinity; beyond the duration it is NaN.
        """
        sent = np.arange(num_blocks * _BLOCK) * self.sample_period
        # As the profile has it.
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
        # 0.1 + 3 * 0.1 is not 4 * 0.1.
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

        from scipy.special import gammaincinv, ndtr, ndtri  # It takes a tenth of a s.

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
        """Returns where packets are in the distribution of the jitter, 0 to 1."""
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
        """Returns which packets of the first blocks are lost."""
        loss = self._loss
        probability: float | Array = loss.probability
        if loss.kind == "burst":
            is_bad = self._Bursts(num_blocks)
            probability = np.where(is_bad, loss.bad_loss, loss.good_loss)
        return self._Draw("loss", num_blocks, Generator.random) < probability

    def _Bursts(self, num_blocks: int) -> list[bool]:
        """Returns at which packets the chain of bursts is in its bad state."""
        loss = self._loss
        share = (loss.probability - loss.good_loss) / (loss.bad_loss - loss.good_loss)
        leave = 1 / loss.burst_length
        enter = leave * share / (1 - share)

        def Next(is_bad: bool, step: float) -> bool:
            return step >= leave if is_bad else step < enter

        first, *others = self._Draw("burst", num_blocks, Generator.random).tolist()
        return list(itertools.accumulate(others, Next, initial=first < share))

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

import math
from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from teleop_drake.channels.delay_profile import DelayProfile
from teleop_drake.channels.receiver import Receiver
from teleop_drake.integrator.problem import TIE
from teleop_drake.validation import CheckNumber, FixedFields, Number, Refuse

JITTERS = ("none", "uniform", "normal", "gamma")
"""Every kind of jitter."""

LOSSES = ("none", "independent", "burst")
"""Every kind of loss."""

_BLOCK = 1024
_SQRT_3 = math.sqrt(3)
_NORMAL = NormalDist()


@dataclass(kw_only=True)
class Jitter(FixedFields):
    """How the delays of the packets scatter.

    uniform: within sqrt(3) std on either side of the mean.
    normal:  the density of N(mean, std^2) above `minimum`, zero below and normalized
             again. Mean and std are those before this truncation.
    gamma:   minimum + Gamma(shape, scale) with shape = ((mean - minimum) / std)^2 and
             scale = std^2 / (mean - minimum).

    The mean is the channel's `delay`.
    """

    # One of JITTERS.
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
class Loss(FixedFields):
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

    # One of LOSSES.
    kind: str = "none"
    # Share of packets lost in the long run, 0 to 1; below 1 for burst.
    probability: float = Number(0.0, "1", minimum=0, maximum=1)
    # Mean length of the bad state, packets, >= 1; burst only.
    burst_length: float = Number(1.0, "packets", minimum=1)
    # Share lost in the good state, 0 to `probability`; burst only.
    good_loss: float = Number(0.0, "1", minimum=0, maximum=1)
    # Share lost in the bad state, more than good_loss, `probability` to 1; burst only.
    bad_loss: float = Number(1.0, "1", minimum=0, maximum=1)


@dataclass
class _Block:
    """The fates of _BLOCK packets, and what the next block goes on from.

    A packet is lost if it arrives at infinity; NaN is beyond the network's duration.
    """

    arrivals: list[float]
    # Of the loss.
    is_bad: bool
    # The last g of the jitter.
    deviate: float
    # When the latest packet so far arrives.
    latest: float


class PacketNetwork:
    """A network to which a packet is given every sample period.

    Args:
        profile: The part of the delay that is not random.
        sample_period: h in s, > 0 and at most the duration of the profile.
        jitter: The random part of the delay.
        loss: Which packets never arrive.
        is_lost: Whether, beside these, a packet never arrives that is sent at a time
            (s); None: no such packet.
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
        is_lost: Callable[[float], bool] | None = None,
        seed: int = 0,
        stream: str = "",
    ):
        self._profile = profile
        self._is_lost = is_lost or (lambda sent: False)
        self._jitter = jitter or Jitter()
        self._loss = loss or Loss()
        if not 0 < sample_period <= profile.duration or math.isinf(sample_period):
            Refuse(
                "sample_period",
                sample_period,
                f"a finite number > 0 and <= {profile.duration:g} (s)",
            )
        if seed < 0:
            Refuse("seed", seed, "a whole number >= 0")
        self._period = float(sample_period)
        self._seed = seed
        self._stream = stream
        self._CheckJitter()
        self._CheckLoss()
        # Pure values: what a block holds does not depend on who asks.
        self._blocks: list[_Block] = []

    def _CheckJitter(self) -> None:
        jitter, mean = self._jitter, self._profile.delay
        if jitter.kind not in JITTERS:
            Refuse("jitter.kind", jitter.kind, f"one of {', '.join(JITTERS)}")
        jitter.CheckNumbers("jitter")
        if jitter.kind == "none":
            for name in ("std", "correlation_time"):
                if value := getattr(jitter, name):
                    Refuse(f"jitter.{name}", value, "0 where jitter.kind is none")
        if jitter.kind in ("none", "uniform"):
            if jitter.minimum != 0:
                Refuse(
                    "jitter.minimum",
                    jitter.minimum,
                    f"0 where jitter.kind is {jitter.kind}",
                )
            least = -_SQRT_3 * jitter.std
        else:
            CheckNumber("jitter.minimum", jitter.minimum, "s", minimum=0, maximum=mean)
            if jitter.kind == "gamma" and jitter.std > 0 and jitter.minimum == mean:
                Refuse(
                    "jitter.minimum",
                    jitter.minimum,
                    f"less than the mean delay, {mean:g} s",
                )
            least = jitter.minimum - mean if jitter.std > 0 else 0.0
        least += self._profile.minimum
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
            f">= {jitter.minimum - least:g} (s), so that with what varies with time no "
            "delay is negative",
        )

    def _CheckLoss(self) -> None:
        loss = self._loss
        if loss.kind not in LOSSES:
            Refuse("loss.kind", loss.kind, f"one of {', '.join(LOSSES)}")
        loss.CheckNumbers("loss")
        if loss.kind == "none" and loss.probability != 0:
            Refuse("loss.probability", loss.probability, "0 where loss.kind is none")
        if loss.kind != "burst":
            for name, default in (
                ("burst_length", 1.0),
                ("good_loss", 0.0),
                ("bad_loss", 1.0),
            ):
                value = getattr(loss, name)
                if value != default:
                    Refuse(
                        f"loss.{name}",
                        value,
                        f"{default:g} where loss.kind is {loss.kind}",
                    )
            return
        if not loss.good_loss < loss.bad_loss:
            Refuse("loss.bad_loss", loss.bad_loss, f"> good_loss, {loss.good_loss:g}")
        # The chain enters the bad state with share / (1 - share) / burst_length.
        most = loss.good_loss + (loss.bad_loss - loss.good_loss) * (
            loss.burst_length / (1 + loss.burst_length)
        )
        if not loss.good_loss <= loss.probability <= most:
            Refuse(
                "loss.probability",
                loss.probability,
                f">= {loss.good_loss:g} and <= {most:g}, with this burst_length, "
                "good_loss and bad_loss",
            )

    @property
    def profile(self) -> DelayProfile:
        """The part of the delay that is not random."""
        return self._profile

    @property
    def sample_period(self) -> float:
        """h in s."""
        return self._period

    def Arrival(self, k: int) -> float:
        """Returns when packet k, sent at k h, arrives (s); infinity if it is lost.

        Raises:
            ValueError: If it is sent beyond the duration of the profile.
        """
        block, place = divmod(k, _BLOCK)
        while block >= len(self._blocks):
            self._blocks.append(self._MakeBlock(len(self._blocks)))
        arrival = self._blocks[block].arrivals[place]
        if math.isnan(arrival):
            self._profile(k * self._period)
        return arrival

    def Arrivals(self, count: int) -> np.ndarray:
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
        due = k * self._period + self._profile.delay + receiver.depth
        return max(arrival, self._Snap(due))

    def _Random(self, impairment: str, block: int) -> np.random.Generator:
        name = f"{self._stream}/{impairment}".encode()
        sequence = np.random.SeedSequence(self._seed, spawn_key=tuple(name))
        key = sequence.generate_state(2, np.uint64)
        # Of the 256 bits of the counter, the upper half tells the blocks apart.
        return np.random.Generator(np.random.Philox(key=key, counter=block << 128))

    def _MakeBlock(self, block: int) -> _Block:
        jitter, deviate = self._JitterOf(block)
        is_lost, is_bad = self._LossOf(block)
        arrivals = []
        latest = self._blocks[block - 1].latest if block else 0.0
        end = self._profile.duration * (1 + 1e-9)  # As the profile has it.
        for i in range(_BLOCK):
            sent = (block * _BLOCK + i) * self._period
            if sent > end or is_lost[i] or self._is_lost(sent):
                arrivals.append(math.nan if sent > end else math.inf)
                continue
            arrival = sent + max(self._profile(sent) + jitter[i], 0.0)
            if self._jitter.keeps_order:
                latest = arrival = max(arrival, latest)
            arrivals.append(self._Snap(arrival))
        return _Block(arrivals, is_bad, deviate, latest)

    def _Snap(self, time: float) -> float:
        # 0.1 + 3 * 0.1 is not 4 * 0.1.
        periods = time / self._period
        whole = round(periods)
        return whole * self._period if abs(periods - whole) < TIE else time

    def _JitterOf(self, block: int) -> tuple[list[float], float]:
        """Returns the jitter, and the last deviate g if it is correlated."""
        jitter, mean = self._jitter, self._profile.delay
        if jitter.kind == "none" or jitter.std == 0:
            return [0.0] * _BLOCK, 0.0
        random = self._Random("jitter", block)
        values: list[float]
        deviate, excess = 0.0, mean - jitter.minimum
        shape = (excess / jitter.std) ** 2
        if jitter.correlation_time:
            deviates = self._Deviates(block, random.standard_normal(_BLOCK).tolist())
            deviate = deviates[-1]
            u = np.array([_NORMAL.cdf(g) for g in deviates])
        elif jitter.kind == "gamma":
            scale = jitter.std**2 / excess
            values = (random.gamma(shape, scale, _BLOCK) - excess).tolist()
            return values, deviate
        else:
            u = random.random(_BLOCK)
        u = np.clip(u, 2.0**-53, 1 - 2.0**-53)
        if jitter.kind == "gamma":
            from scipy.special import gammaincinv  # It takes a tenth of a second.

            values = (gammaincinv(shape, u) * jitter.std**2 / excess - excess).tolist()
        elif jitter.kind == "uniform":
            values = (_SQRT_3 * jitter.std * (2 * u - 1)).tolist()
        else:
            # The inverse of the cumulative distribution above the minimum.
            above = _NORMAL.cdf(excess / jitter.std)
            values = [
                max(-jitter.std * _NORMAL.inv_cdf(p * above), -excess)
                for p in u.tolist()
            ]
        return values, deviate

    def _Deviates(self, block: int, noise: list[float]) -> list[float]:
        """Returns g of a block, which goes on from the block before."""
        a = math.exp(-self._period / self._jitter.correlation_time)
        g = self._blocks[block - 1].deviate if block else noise[0]
        deviates = [] if block else [g]
        for n in noise if block else noise[1:]:
            g = a * g + math.sqrt(1 - a * a) * n
            deviates.append(g)
        return deviates

    def _LossOf(self, block: int) -> tuple[list[bool], bool]:
        """Returns what is lost, and whether the chain ends in its bad state."""
        loss = self._loss
        if loss.kind == "none":
            return [False] * _BLOCK, False
        u = self._Random("loss", block).random(_BLOCK).tolist()
        if loss.kind == "independent":
            return [p < loss.probability for p in u], False
        share = (loss.probability - loss.good_loss) / (loss.bad_loss - loss.good_loss)
        leave = 1 / loss.burst_length
        enter = leave * share / (1 - share)
        is_bad = self._blocks[block - 1].is_bad if block else False
        is_lost = []
        steps = self._Random("burst", block).random(_BLOCK).tolist()
        for i, (p, step) in enumerate(zip(u, steps, strict=True)):
            if block == 0 and i == 0:
                is_bad = step < share
            else:
                is_bad = step >= leave if is_bad else step < enter
            is_lost.append(p < (loss.bad_loss if is_bad else loss.good_loss))
        return is_lost, is_bad

"""Delays that vary, and networks that delay, lose and reorder packets.

    T(t) = delay + drift t + amplitude sin(frequency t + phase) + trace(t)
    d_k  = T(k h) + jitter_k          delay of packet k, sent at k h; infinite if lost

Every random number is a pure function of (seed, stream, impairment, k), from numpy's
counter-based Philox generator: nothing depends on who asks first or how often, and the
parameters of one impairment leave the numbers of the others alone.

A ValueError names the parameter by its place in a channel ("jitter.std"), its value
and what is allowed.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, NoReturn

import numpy as np

JITTERS = ("none", "uniform", "normal", "gamma")
"""Every kind of jitter."""

LOSSES = ("none", "independent", "burst")
"""Every kind of loss."""

RECEIVERS = ("newest", "playout", "extrapolate")
"""Every policy of a receiver."""

_BLOCK = 1024
_SQRT_3 = math.sqrt(3)
_NORMAL = NormalDist()

# An arrival this close to a multiple of the sample period, in periods, is meant to be
# one: 0.1 + 3 * 0.1 is not 4 * 0.1.
_SNAP = 1e-9


@dataclass(kw_only=True)
class Sinusoid:
    """A periodic part of the delay, amplitude sin(frequency t + phase)."""

    # s, >= 0.
    amplitude: float = 0.0
    # rad/s, >= 0.
    frequency: float = 1.0
    # rad.
    phase: float = 0.0


@dataclass(kw_only=True)
class Jitter:
    """How the delays of the packets scatter, each independently of the others.

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
    std: float = 0.0
    # Least delay, s, 0 to `delay`; normal and gamma only, else 0. What varies with
    # time comes on top.
    minimum: float = 0.0


@dataclass(kw_only=True)
class Loss:
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
    probability: float = 0.0
    # Mean length of the bad state, packets, >= 1; burst only.
    burst_length: float = 1.0
    # Share lost in the good state, 0 to `probability`; burst only.
    good_loss: float = 0.0
    # Share lost in the bad state, more than good_loss, `probability` to 1; burst only.
    bad_loss: float = 1.0


@dataclass(kw_only=True)
class Receiver:
    """What the receiver makes of the packets; older ones than it has are discarded.

    newest:      holds the packet with the newest time stamp.
    playout:     the same, but shows a packet no earlier than delay + depth after it
                 was sent; one that is late is shown at once. The clocks agree.
    extrapolate: goes on from the newest packet, from its arrival, along the line
                 through the time stamps and values of this packet and the one it
                 replaced.
    """

    # One of RECEIVERS.
    policy: str = "newest"
    # How much longer than `delay` a packet waits, s, >= 0; playout only, else 0.
    depth: float = 0.0


@dataclass(kw_only=True)
class PacketStatistics:
    """What one channel did to its packets until the end of a run.

    Attributes:
        sent: Number of packets sent.
        received: Number of those that arrived before the end.
        lost: Number of those that never arrive. The rest were still under way.
        loss_rate: lost / sent.
        reordered: Number of packets that arrived after a newer one.
        late: Number of packets that arrived after they should have been shown
            (playout only).
        delay_mean: Of the packets received, s; None if there are none, as for the
            following.
        delay_minimum: Smallest delay, s.
        delay_median: Half of the delays are smaller, s.
        delay_p95: 95 % of the delays are smaller, s.
        delay_p99: 99 % of the delays are smaller, s.
        delay_maximum: Largest delay, s.
        age_mean: Age of information: the time since what is shown was sent; mean
            over time from the first packet shown, s.
        age_maximum: Largest age of information, s.
    """

    sent: int
    received: int
    lost: int
    loss_rate: float
    reordered: int
    late: int
    delay_mean: float | None
    delay_minimum: float | None
    delay_median: float | None
    delay_p95: float | None
    delay_p99: float | None
    delay_maximum: float | None
    age_mean: float | None
    age_maximum: float | None


def _refuse(name: str, value: Any, allowed: str) -> NoReturn:
    raise ValueError(f"{name} = {value!r}: must be {allowed}")


def _check(
    name: str,
    value: float,
    unit: str,
    minimum: float = -math.inf,
    maximum: float = math.inf,
) -> None:
    """Refuses what is not finite or not within the bounds."""
    if not (math.isfinite(value) and minimum <= value <= maximum):
        bounds = f" >= {minimum:g}" if minimum > -math.inf else ""
        bounds += " and" if bounds and maximum < math.inf else ""
        bounds += f" <= {maximum:g}" if maximum < math.inf else ""
        _refuse(name, value, f"a finite number{bounds} ({unit})")


class DelayProfile:
    """A delay that varies with time but not at random.

        T(t) = delay + drift t + amplitude sin(frequency t + phase) + trace(t)

    Calling it returns T(t) in s. The trace is interpolated linearly; its own time
    counts from its first entry.

    Args:
        delay: Constant part in s, >= 0.
        drift: Change per time, s/s.
        sinusoid: Periodic part.
        trace: (times, delays) in s, measured, at least two of each; the times ascend
            and the delays are not negative. None: no such part.
        duration: Until when T is needed, in s, > 0; None: the whole trace, or forever
            without one.

    Raises:
        ValueError: If a parameter is outside its range, the trace does not cover the
            duration, or T might be negative.
    """

    def __init__(
        self,
        *,
        delay: float,
        drift: float = 0.0,
        sinusoid: Sinusoid | None = None,
        trace: tuple[Sequence[float], Sequence[float]] | None = None,
        duration: float | None = None,
    ):
        sinusoid = sinusoid or Sinusoid()
        _check("delay", delay, "s", minimum=0)
        _check("drift", drift, "s/s")
        _check("sinusoid.amplitude", sinusoid.amplitude, "s", minimum=0)
        _check("sinusoid.frequency", sinusoid.frequency, "rad/s", minimum=0)
        _check("sinusoid.phase", sinusoid.phase, "rad")
        self._delay = float(delay)
        self._drift = float(drift)
        self._amplitude = float(sinusoid.amplitude)
        self._frequency = float(sinusoid.frequency)
        self._phase = float(sinusoid.phase)
        self._times: list[float] = []
        self._delays: list[float] = []
        if trace is not None:
            times, delays = (np.array(part, dtype=float) for part in trace)
            _check_trace(times, delays)
            times -= times[0]
            if duration is not None and times[-1] < duration:
                _refuse(
                    "trace",
                    float(times[-1]),
                    f"at least as long as the duration, {duration:g} s",
                )
            self._times, self._delays = times.tolist(), delays.tolist()
            if duration is None:
                duration = self._times[-1]
        self._duration = math.inf if duration is None else float(duration)
        if not self._duration > 0:
            _refuse("duration", duration, "a number > 0 (s)")
        self._minimum = self._delay - self._amplitude + min(self._delays, default=0.0)
        if self._drift < 0:
            self._minimum += self._drift * self._duration
        slopes = np.diff(self._delays) / np.diff(self._times)
        self._slopes = {
            "drift": self._drift,
            "sinusoid.amplitude": self._amplitude * self._frequency,
            "trace": float(slopes.max()) if slopes.size else 0.0,
        }
        self._max_slope = sum(self._slopes.values())
        if self._minimum < 0:
            self._RefuseMinimum("negative")

    def _RefuseMinimum(self, what: str) -> NoReturn:
        _refuse(
            "delay",
            self._delay,
            f"such that the delay, down to {self._minimum:.6g} s, is never {what}",
        )

    @property
    def delay(self) -> float:
        """The constant part in s."""
        return self._delay

    @property
    def duration(self) -> float:
        """Until when T is defined, in s."""
        return self._duration

    @property
    def minimum(self) -> float:
        """A lower bound of T in s, the sum of the minima of its parts."""
        return self._minimum

    @property
    def max_slope(self) -> float:
        """An upper bound of dT/dt, the sum of the maxima of its parts."""
        return self._max_slope

    def CheckContinuous(self, least: float) -> None:
        """Checks that a signal can be delayed by T continuously and in order.

        Args:
            least: Least delay in s that is allowed.

        Raises:
            ValueError: If T might be less, or rise as fast as time goes by.
        """
        if self._minimum < least:
            self._RefuseMinimum(f"less than {least:g} s")
        if self._max_slope >= 1:
            name = max(self._slopes, key=lambda key: self._slopes[key])
            value = {"drift": self._drift, "sinusoid.amplitude": self._amplitude}
            _refuse(
                name,
                value.get(name, "this"),
                f"such that dT/dt, up to {self._max_slope:.6g}, is less than 1",
            )

    def __call__(self, t: float) -> float:
        """Returns T(t) in s.

        Args:
            t: Time in s, 0 to `duration`.

        Raises:
            ValueError: If t lies beyond the duration.
        """
        if t > self._duration * (1 + 1e-9):
            _refuse("t", t, f"at most {self._duration:g} s, the duration of the delay")
        result = self._delay + self._drift * t
        if self._amplitude:
            result += self._amplitude * math.sin(self._frequency * t + self._phase)
        if self._times:
            times, delays = self._times, self._delays
            i = min(max(bisect_right(times, t) - 1, 0), len(times) - 2)
            share = (t - times[i]) / (times[i + 1] - times[i])
            result += delays[i] + min(max(share, 0.0), 1.0) * (
                delays[i + 1] - delays[i]
            )
        return result


def _check_trace(times: np.ndarray, delays: np.ndarray) -> None:
    if times.ndim != 1 or times.shape != delays.shape or times.size < 2:
        _refuse("trace", times.size, "at least two times and as many delays")
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(delays))):
        _refuse("trace", "not finite", "finite numbers (s)")
    wrong = np.flatnonzero(np.diff(times) <= 0)
    if wrong.size:
        _refuse("trace", float(times[wrong[0] + 1]), "ascending times (s)")
    if np.any(delays < 0):
        _refuse("trace", float(delays[delays < 0][0]), "delays >= 0 (s)")


@dataclass
class _Block:
    """The fates of _BLOCK packets, and the state of the loss after the last one.

    A packet is lost if it arrives at infinity; NaN is beyond the network's duration.
    """

    arrivals: list[float]
    is_bad: bool


class PacketNetwork:
    """A network to which a packet is given every sample period.

    Args:
        profile: The part of the delay that is not random.
        sample_period: h in s, > 0 and at most the duration of the profile.
        jitter: The random part of the delay.
        loss: Which packets never arrive.
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
        seed: int = 0,
        stream: str = "",
    ):
        self._profile = profile
        self._jitter = jitter or Jitter()
        self._loss = loss or Loss()
        if not 0 < sample_period <= profile.duration or math.isinf(sample_period):
            _refuse(
                "sample_period",
                sample_period,
                f"a finite number > 0 and <= {profile.duration:g} (s)",
            )
        if seed < 0:
            _refuse("seed", seed, "a whole number >= 0")
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
            _refuse("jitter.kind", jitter.kind, f"one of {', '.join(JITTERS)}")
        _check("jitter.std", jitter.std, "s", minimum=0)
        if jitter.kind == "none" and jitter.std != 0:
            _refuse("jitter.std", jitter.std, "0 where jitter.kind is none")
        if jitter.kind in ("none", "uniform"):
            if jitter.minimum != 0:
                _refuse(
                    "jitter.minimum",
                    jitter.minimum,
                    f"0 where jitter.kind is {jitter.kind}",
                )
            least = -_SQRT_3 * jitter.std
        else:
            _check("jitter.minimum", jitter.minimum, "s", minimum=0, maximum=mean)
            if jitter.kind == "gamma" and jitter.std > 0 and jitter.minimum == mean:
                _refuse(
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
            _refuse(
                "jitter.std",
                jitter.std,
                f"such that the delay, down to {least:g} s, is never negative",
            )
        _refuse(
            "jitter.minimum",
            jitter.minimum,
            f">= {jitter.minimum - least:g} (s), so that with what varies with time no "
            "delay is negative",
        )

    def _CheckLoss(self) -> None:
        loss = self._loss
        if loss.kind not in LOSSES:
            _refuse("loss.kind", loss.kind, f"one of {', '.join(LOSSES)}")
        _check("loss.probability", loss.probability, "1", minimum=0, maximum=1)
        if loss.kind == "none" and loss.probability != 0:
            _refuse("loss.probability", loss.probability, "0 where loss.kind is none")
        if loss.kind != "burst":
            for name, default in (
                ("burst_length", 1.0),
                ("good_loss", 0.0),
                ("bad_loss", 1.0),
            ):
                value = getattr(loss, name)
                if value != default:
                    _refuse(
                        f"loss.{name}",
                        value,
                        f"{default:g} where loss.kind is {loss.kind}",
                    )
            return
        _check("loss.burst_length", loss.burst_length, "packets", minimum=1)
        _check("loss.good_loss", loss.good_loss, "1", minimum=0, maximum=1)
        _check("loss.bad_loss", loss.bad_loss, "1", minimum=0, maximum=1)
        if not loss.good_loss < loss.bad_loss:
            _refuse("loss.bad_loss", loss.bad_loss, f"> good_loss, {loss.good_loss:g}")
        # The chain enters the bad state with share / (1 - share) / burst_length.
        most = loss.good_loss + (loss.bad_loss - loss.good_loss) * (
            loss.burst_length / (1 + loss.burst_length)
        )
        if not loss.good_loss <= loss.probability <= most:
            _refuse(
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

        Args:
            k: Number of the packet.
            receiver: The receiver.

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
        jitter = self._JitterOf(block)
        is_lost, is_bad = self._LossOf(block)
        arrivals = []
        end = self._profile.duration * (1 + _SNAP)
        for i in range(_BLOCK):
            sent = (block * _BLOCK + i) * self._period
            if is_lost[i] or sent > end:
                arrivals.append(math.nan if sent > end else math.inf)
                continue
            arrival = sent + max(self._profile(sent) + jitter[i], 0.0)
            arrivals.append(self._Snap(arrival))
        return _Block(arrivals, is_bad)

    def _Snap(self, time: float) -> float:
        periods = time / self._period
        whole = round(periods)
        return whole * self._period if abs(periods - whole) < _SNAP else time

    def _JitterOf(self, block: int) -> list[float]:
        jitter, mean = self._jitter, self._profile.delay
        if jitter.kind == "none" or jitter.std == 0:
            return [0.0] * _BLOCK
        random = self._Random("jitter", block)
        excess = mean - jitter.minimum
        if jitter.kind == "gamma":
            shape, scale = (excess / jitter.std) ** 2, jitter.std**2 / excess
            return (random.gamma(shape, scale, _BLOCK) - excess).tolist()
        u = np.maximum(random.random(_BLOCK), 2.0**-53)
        if jitter.kind == "uniform":
            return (_SQRT_3 * jitter.std * (2 * u - 1)).tolist()
        # The inverse of the cumulative distribution above the minimum.
        above = _NORMAL.cdf(excess / jitter.std)
        return [
            max(-jitter.std * _NORMAL.inv_cdf(p * above), -excess) for p in u.tolist()
        ]

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


def check_receiver(receiver: Receiver) -> None:
    """Checks a receiver.

    Raises:
        ValueError: If a parameter is outside its range.
    """
    if receiver.policy not in RECEIVERS:
        _refuse("receiver.policy", receiver.policy, f"one of {', '.join(RECEIVERS)}")
    _check("receiver.depth", receiver.depth, "s", minimum=0)
    if receiver.policy != "playout" and receiver.depth != 0:
        _refuse(
            "receiver.depth",
            receiver.depth,
            f"0 where receiver.policy is {receiver.policy}",
        )


def packet_statistics(
    network: PacketNetwork, receiver: Receiver, end_time: float
) -> PacketStatistics:
    """Returns what a network and a receiver make of the packets sent before a time.

    Args:
        network: The network.
        receiver: The receiver.
        end_time: In s; what arrives later has not been received.
    """
    h = network.sample_period
    sent = math.ceil(end_time / h - _SNAP)
    arrivals = network.Arrivals(sent)
    shown = np.array([network.Shown(k, receiver) for k in range(sent)])
    stamps = np.arange(sent) * h
    received = np.flatnonzero(arrivals <= end_time)
    # Two that arrive together are in order.
    received = received[np.argsort(arrivals[received], kind="stable")]
    is_newest = received == np.maximum.accumulate(received)
    delays = (arrivals - stamps)[received]
    due = stamps + network.profile.delay + receiver.depth + _SNAP * h
    is_late = (arrivals > due)[received] & (receiver.policy == "playout")
    ages = _ages(stamps[received], shown[received], end_time)
    percentiles: list[float | None] = [None] * 5
    if delays.size:
        percentiles = np.percentile(delays, [0, 50, 95, 99, 100]).tolist()
    lost = int(np.sum(np.isinf(arrivals)))
    return PacketStatistics(
        sent=sent,
        received=len(received),
        lost=lost,
        loss_rate=lost / sent if sent else 0.0,
        reordered=int(np.sum(~is_newest)),
        late=int(np.sum(is_late)),
        delay_mean=float(delays.mean()) if delays.size else None,
        delay_minimum=percentiles[0],
        delay_median=percentiles[1],
        delay_p95=percentiles[2],
        delay_p99=percentiles[3],
        delay_maximum=percentiles[4],
        age_mean=ages[0],
        age_maximum=ages[1],
    )


def _ages(
    stamps: np.ndarray, shown: np.ndarray, end_time: float
) -> tuple[float | None, float | None]:
    """Returns the mean and the maximum of the age of what is shown."""
    order = np.lexsort((stamps, shown))
    stamps, shown = np.maximum.accumulate(stamps[order]), shown[order]
    stamps, shown = stamps[shown < end_time], shown[shown < end_time]
    if not shown.size:
        return None, None
    # Between two packets the age grows with slope 1.
    ends = np.append(shown[1:], end_time)
    integral = np.sum((ends - stamps) ** 2 - (shown - stamps) ** 2) / 2
    return float(integral / (end_time - shown[0])), float(np.max(ends - stamps))

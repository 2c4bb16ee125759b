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

A network may send some packets twice. The copies are lost and delayed by themselves,
and the receiver uses the first that arrives. With the options of netem, what Linux does
takes the place of jitter, losses and copies; see netem_queue.

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

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from teleop_drake.blocks.channels.netem import Netem
from teleop_drake.blocks.channels.netem_queue import Deliver
from teleop_drake.blocks.channels.packet_options import Jitter, Loss, Receiver
from teleop_drake.blocks.channels.variable import DelayProfile
from teleop_drake.numerics.instants import SAME, TIE
from teleop_drake.validation import CheckNumber, Refuse

Array = np.ndarray

# Number of packets whose random numbers are drawn together.
_BLOCK = 1024


class PacketNetwork:
    """A network through which a packet is sent every sample period.

    Args:
        profile: The part of the delay that is not random.
        sample_period: h in s, > 0 and at most the duration of the profile.
        jitter: The random part of the delay; None: there is none.
        loss: The random losses; None: there are none.
        is_lost: Function that returns which packets are lost as well (N), for the times
            in s when they are sent (N). None: there are no further losses.
        duplicates: The share of packets that are sent twice, 0 to 1.
        netem: The options of netem, which take the place of jitter, losses and copies.
            None: those are used. Its delay is 0 or that of the profile.
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
        duplicates: float = 0.0,
        netem: Netem | None = None,
        seed: int = 0,
        stream: str = "",
    ):
        self.profile = profile
        self.sample_period = float(sample_period)
        self._jitter = jitter or Jitter()
        self._loss = loss or Loss()
        self._is_lost = is_lost
        self._duplicates = duplicates
        self._netem = netem
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
        CheckNumber("duplicates", duplicates, "1", minimum=0, maximum=1)
        self._CheckJitter()
        self._CheckLoss()
        if netem is not None:
            self._CheckNetem(netem)
        # Arrival times of the first packets, and of their copies that arrive later, in
        # s (2, N); NaN beyond the profile's duration.
        self._arrivals = np.empty((2, 0))
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
        if loss.kind not in ("burst", "gilbert_elliott"):
            return
        if not loss.good_loss < loss.bad_loss:
            Refuse("loss.bad_loss", loss.bad_loss, f"> good_loss, {loss.good_loss:g}")
        if loss.kind == "gilbert_elliott":
            return
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

    def _CheckNetem(self, netem: Netem) -> None:
        """Checks that nothing else takes the place of netem's options."""
        others = {
            "jitter.kind": (self._jitter.kind, "none"),
            "loss.kind": (self._loss.kind, "none"),
            "duplicates": (self._duplicates, 0.0),
        }
        for name, (value, nothing) in others.items():
            if value != nothing:
                Refuse(name, value, f"{nothing} with netem, which has its own")
        delay = 1e-9 * netem.delay
        if delay and not math.isclose(delay, self.profile.delay, rel_tol=1e-9):
            Refuse(
                "delay",
                self.profile.delay,
                f"{delay:g} (s), the delay of netem, or netem without a delay",
            )

    def Arrival(self, k: int) -> float:
        """Returns the arrival time in s of packet k, sent at k h; infinity if lost.

        Raises:
            ValueError: If it is sent beyond the duration of the profile.
        """
        return self._Times(k)[0]

    def CopyArrival(self, k: int) -> float:
        """Returns when a second copy of packet k arrives, s; infinity: there is none.

        Raises:
            ValueError: If it is sent beyond the duration of the profile.
        """
        return self._Times(k)[1]

    def _Times(self, k: int) -> tuple[float, float]:
        with self._lock:  # Runs in several threads share a channel.
            if k >= self._arrivals.shape[1]:
                self._arrivals = self._Arrivals(2 * (k // _BLOCK + 1))
        first, second = self._arrivals[:, k].tolist()
        if math.isnan(first):
            # The profile raises the ValueError.
            self.profile(k * self.sample_period)
        return first, second

    def Arrivals(self, count: int) -> Array:
        """Returns the arrival times of packets 0 to count - 1, s; lost: infinity."""
        return np.array([self.Arrival(k) for k in range(count)])

    def CopyArrivals(self, count: int) -> Array:
        """Returns when second copies arrive, s; infinity: there is none (count)."""
        return np.array([self.CopyArrival(k) for k in range(count)])

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
        """Returns the arrival times in s of the packets of the first blocks (2, N).

        The first row has the copy that arrives first, the second one the other. That of
        a lost packet is infinity. That of a packet sent beyond the duration of the
        profile is NaN.
        """
        sent = np.arange(num_blocks * _BLOCK) * self.sample_period
        # The profile allows times up to its duration with the same margin.
        sent = sent[sent <= self.profile.duration * (1 + 1e-9)]
        copies = self._Copies(sent, num_blocks)
        if self._is_lost is not None:
            copies[:, self._is_lost(sent)] = math.inf
        times = np.stack([copies.min(axis=0), copies.max(axis=0)])
        if self._jitter.keeps_order:
            has_arrived = np.isfinite(times[0])
            first = np.maximum.accumulate(times[0, has_arrived])
            times[0, has_arrived] = first
            times[1, has_arrived] = np.maximum(times[1, has_arrived], first)
        arrivals = np.full((2, num_blocks * _BLOCK), math.nan)
        arrivals[:, : len(sent)] = self._Snap(times)
        return arrivals

    def _Copies(self, sent: Array, num_blocks: int) -> Array:
        """Returns when both copies of packets arrive, s; infinity: none (2, N)."""
        delays = self.profile(sent)
        if self._netem is not None:

            def Draw(name: str) -> Array:
                name = f"netem {name}"
                return self._Draw(name, num_blocks, Generator.integers, 0, 2**32)

            queued = Deliver(self._netem, sent, Draw)
            return sent + delays - 1e-9 * self._netem.delay + np.stack(queued)
        copies = np.full((2, len(sent)), math.inf)
        number = slice(len(sent))
        names = [""]
        is_double = np.zeros(len(sent), dtype=bool)
        if self._duplicates:
            share = self._Draw("duplicate", num_blocks, Generator.random)[number]
            is_double = share < self._duplicates
            names = ["", "copy "]
        for i, name in enumerate(names):
            late = delays + self._Jitters(num_blocks, name)[number]
            is_lost = self._Losses(num_blocks, name)[number]
            has_none = is_lost if i == 0 else is_lost | ~is_double
            copies[i] = np.where(has_none, math.inf, sent + np.maximum(late, 0.0))
        return copies

    def _Snap(self, times: Array) -> Array:
        # Moves times that are at a tick but for rounding: 0.1 + 3 * 0.1 is not 4 * 0.1.
        ticks = np.round(times / self.sample_period) * self.sample_period
        return np.where(np.isclose(times, ticks, rtol=2e-15, atol=SAME), ticks, times)

    def _Jitters(self, num_blocks: int, copy: str) -> Array:
        """Returns the jitter of the packets of the first blocks in s.

        Args:
            copy: The beginning of the names of random numbers; empty: of the packets
                themselves.
        """
        jitter = self._jitter
        if jitter.kind == "none" or jitter.std == 0:
            return np.zeros(num_blocks * _BLOCK)
        jitters = self._FreshJitters(num_blocks, f"{copy}jitter")
        if not jitter.hold:
            return jitters
        u = self._Draw(f"{copy}hold", num_blocks, Generator.random)
        # The first packet has nothing to hold.
        fresh = np.where(u < jitter.hold, 0, np.arange(len(u)))
        return jitters[np.maximum.accumulate(fresh)]

    def _FreshJitters(self, num_blocks: int, name: str) -> Array:
        """Returns the jitter of packets that hold none, in s."""
        jitter = self._jitter
        std = jitter.std
        excess = self.profile.delay - jitter.minimum
        if jitter.kind == "gamma" and not jitter.correlation_time:
            of = (excess / std) ** 2, std**2 / excess
            return self._Draw(name, num_blocks, Generator.gamma, *of) - excess

        from scipy.special import gammaincinv, ndtr, ndtri  # The import takes 0.1 s.

        u = np.clip(self._Shares(num_blocks, name), 2.0**-53, 1 - 2.0**-53)
        jitters: Array
        if jitter.kind == "gamma":
            jitters = gammaincinv((excess / std) ** 2, u) * std**2 / excess - excess
        elif jitter.kind == "uniform":
            jitters = math.sqrt(3) * std * (2 * u - 1)
        else:
            # The inverse of the cumulative distribution above the minimum.
            jitters = np.maximum(-std * ndtri(u * ndtr(excess / std)), -excess)
        return jitters

    def _Shares(self, num_blocks: int, name: str) -> Array:
        """Returns the value of the jitter's distribution function for each packet."""
        time = self._jitter.correlation_time
        if not time:
            return self._Draw(name, num_blocks, Generator.random)
        a = math.exp(-self.sample_period / time)
        noise = self._Draw(name, num_blocks, Generator.standard_normal)

        def Next(g: float, n: float) -> float:
            return a * g + math.sqrt(1 - a * a) * n

        from scipy.special import ndtr

        shares: Array = ndtr(list(itertools.accumulate(noise.tolist(), Next)))
        return shares

    def _Losses(self, num_blocks: int, copy: str) -> NDArray[np.bool_]:
        """Returns whether each packet of the first blocks, or its copy, is lost."""
        loss = self._loss
        probability: float | Array = loss.probability
        if loss.kind in ("burst", "gilbert_elliott"):
            is_bad = self._Bursts(num_blocks)
            probability = np.where(is_bad, loss.bad_loss, loss.good_loss)
        return self._Draw(f"{copy}loss", num_blocks, Generator.random) < probability

    def _Bursts(self, num_blocks: int) -> list[bool]:
        """Returns whether the chain of bursts is in its bad state at each packet."""
        share, to_bad, to_good = self._loss.Chain()

        def Next(is_bad: bool, step: float) -> bool:
            return step >= to_good if is_bad else step < to_bad

        first, *others = self._Draw("burst", num_blocks, Generator.random).tolist()
        return list(itertools.accumulate(others, Next, initial=first < share))

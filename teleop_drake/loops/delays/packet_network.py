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

packet_random has the random numbers.

A ValueError names the parameter by its place in a channel ("jitter.std"), its value
and the allowed values.
"""

import math
import threading
from collections.abc import Callable, Sequence

import numpy as np
from numpy.random import Generator

from teleop_drake.loops.delays.netem import Netem
from teleop_drake.loops.delays.netem_queue import Deliver
from teleop_drake.loops.delays.packet_options import Jitter, Loss, Receiver
from teleop_drake.loops.delays.packet_random import BLOCK, PacketRandom
from teleop_drake.loops.delays.variable import DelayProfile
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import CheckNumber, Refuse
from teleop_drake.loops.numerics.instants import SAME, TIE


class PacketNetwork:
    """A network through which a packet is sent every sample period.

    Args:
        profile: The part of the delay that is not random.
        sample_period: h in s, > 0 and at most the duration of the profile; the mean
            where periods differ.
        periods: The times between packets, s, each > 0, which reach beyond the duration
            of the profile (N). None: each is the sample period.
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
        periods: Array | None = None,
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
        self._sent = None if periods is None else np.cumsum([0.0, *periods])
        self._jitter = jitter or Jitter()
        self._loss = loss or Loss()
        self._is_lost = is_lost
        self._duplicates = duplicates
        self._netem = netem
        self._random = PacketRandom(seed, stream)
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
                self._arrivals = self._Arrivals(2 * (k // BLOCK + 1))
        first, second = self._arrivals[:, k].tolist()
        if math.isnan(first):
            # The profile raises the ValueError.
            self.profile(self._SentTime(k))
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
        due = self._SentTime(k) + self.profile.delay + receiver.depth
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
        stamps = self.SentTimes(self.CountUntil(end))
        shown = np.array([self.Shown(k, receiver) for k in range(len(stamps))])
        order = np.argsort(shown, kind="stable")
        order = order[shown[order] < end]
        return shown[order], np.maximum.accumulate(stamps[order])

    def CountUntil(self, end: float) -> int:
        """Returns the number of packets sent before a time in s."""
        if self._sent is not None:
            return int(np.searchsorted(self._sent, end - SAME))
        return math.ceil(end / self.sample_period - TIE)

    def SentTimes(self, count: int) -> Array:
        """Returns the times in s when packets 0 to count - 1 are sent (count)."""
        if self._sent is not None:
            return self._sent[:count]
        return np.asarray(self.sample_period * np.arange(count), dtype=float)

    def Instants(self) -> Sequence[float]:
        """Returns when packets are sent, s; empty: every sample period."""
        if self._sent is None:
            return ()
        return tuple(self._sent[self._sent <= self.profile.duration].tolist())

    def _SentTime(self, k: int) -> float:
        return k * self.sample_period if self._sent is None else float(self._sent[k])

    def _Arrivals(self, num_blocks: int) -> Array:
        """Returns the arrival times in s of the packets of the first blocks (2, N).

        The first row has the copy that arrives first, the second one the other. That of
        a lost packet is infinity. That of a packet sent beyond the duration of the
        profile is NaN.
        """
        sent = self.SentTimes(num_blocks * BLOCK)
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
        arrivals = np.full((2, num_blocks * BLOCK), math.nan)
        arrivals[:, : len(sent)] = self._Snap(times)
        return arrivals

    def _Copies(self, sent: Array, num_blocks: int) -> Array:
        """Returns when both copies of packets arrive, s; infinity: none (2, N)."""
        delays = self.profile(sent)
        if self._netem is not None:

            def Draw(name: str) -> Array:
                name = f"netem {name}"
                draw = Generator.integers
                return self._random.Draw(name, num_blocks, draw, 0, 2**32)

            queued = Deliver(self._netem, sent, Draw)
            return sent + delays - 1e-9 * self._netem.delay + np.stack(queued)
        copies = np.full((2, len(sent)), math.inf)
        number = slice(len(sent))
        names = [""]
        is_double = np.zeros(len(sent), dtype=bool)
        if self._duplicates:
            draw = Generator.random
            share = self._random.Draw("duplicate", num_blocks, draw)[number]
            is_double = share < self._duplicates
            names = ["", "copy "]
        for i, name in enumerate(names):
            jitters = self._random.Jitters(
                self._jitter, self.profile.delay, self.sample_period, num_blocks, name
            )
            late = delays + jitters[number]
            is_lost = self._random.Losses(self._loss, num_blocks, name)[number]
            has_none = is_lost if i == 0 else is_lost | ~is_double
            copies[i] = np.where(has_none, math.inf, sent + np.maximum(late, 0.0))
        return copies

    def _Snap(self, times: Array) -> Array:
        # Moves times that are at a tick but for rounding: 0.1 + 3 * 0.1 is not 4 * 0.1.
        if self._sent is None:
            ticks = np.round(times / self.sample_period) * self.sample_period
        else:
            between = (self._sent[1:] + self._sent[:-1]) / 2
            ticks = self._sent[np.searchsorted(between, times)]
        return np.where(np.isclose(times, ticks, rtol=2e-15, atol=SAME), ticks, times)

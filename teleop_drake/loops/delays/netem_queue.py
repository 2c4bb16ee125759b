"""What netem does to packets: delay, loss, copies and another order, as in Linux.

The queue follows net/sched/sch_netem.c in its order of decisions and in its whole
numbers: u is uniform on 0 to 2^32 - 1, and times are in ns.

* A correlation rho makes x_n = rho x_(n-1) + (1 - rho) u_n of the random numbers. Their
  variance is then (1 - rho)/(1 + rho) of that of u. A small percentage is therefore met
  more rarely than it says.
* The delay is delay + (x mod 2 jitter) - jitter, or delay + jitter table[x mod 4096].
  The remainder depends on the last digits of x, so that a correlation of x leaves
  delays practically independent, except with jitters of seconds.
* A packet that is reordered is sent at once; after it, `gap` - 1 packets are delayed.
* A packet is sent twice, or lost, before it is queued. Of a packet that is both, one
  copy is left; a copy may be lost by itself, and has a delay of its own.
* Gilbert and Elliott: the share that is lost belongs to the state in which the packet
  finds the chain, which begins in the good state and changes at each packet.
* A packet that finds `limit` packets in the queue is lost.
"""

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from teleop_drake.loops.delays.netem import Chance, Netem
from teleop_drake.loops.framework.arrays import Array

_RANGE = 2**32

# The unit of the distribution tables, as a share of the jitter.
_SCALE = 8192
_LARGEST = 32767

RANDOM_NUMBERS = (
    *("delay", "delay of copies", "reorder", "reorder of copies", "duplicate"),
    *("loss", "loss of copies", "state", "state of copies"),
)
"""The names of the sequences of random numbers that Deliver() takes."""

STARTS = ("delay", "loss", "duplicate", "reorder")
"""The names of the correlated sequences, each of which has a random start."""


@cache
def Table(distribution: str) -> Sequence[int]:
    """Returns netem's table of a distribution, whose 4096 entries are equally likely.

    They are those of /usr/lib/tc/*.dist: the deviations from the mean, in 1/8192 of the
    standard deviation, that the programs beside them (netem/*.c of iproute2) compute.
    The Pareto distribution has the exponent 3, and its largest deviation is cut off at
    four standard deviations.
    """
    from scipy.special import ndtri

    k = np.arange(4096)
    normal = _SCALE * ndtri((4 * k + 0.5) / 16384)
    shares = 1 - k / 4096
    pareto = np.minimum((shares ** (-1 / 3) - 1.5) * _SCALE * 4 / 3, _LARGEST)
    deviations = {
        "normal": normal,
        "pareto": pareto,
        "paretonormal": 0.25 * normal + 0.75 * pareto,
    }
    table = np.rint(deviations[distribution]).clip(-_LARGEST - 1, _LARGEST)
    return tuple(table.astype(int).tolist())


def _Threshold(share: float) -> int:
    """Returns the number of 32 bits that stands for a share."""
    return round(share * (_RANGE - 1))


@dataclass
class _Correlated:
    """Correlated random numbers.

    Args:
        correlation: rho, 0 to 1.
        last: The number before the first one.
    """

    correlation: float
    last: int

    def Next(self, u: int) -> int:
        """Returns the next number, made of a uniform one."""
        if self.correlation == 0:
            return u
        rho = _Threshold(self.correlation) + 1
        self.last = (u * (_RANGE - rho) + self.last * rho) >> 32
        return self.last


@dataclass
class _Queue:
    """netem's queue.

    Args:
        netem: The options.
        draws: The random numbers, of each name one for each packet.
        starts: The starts of the correlated random numbers.
    """

    netem: Netem
    draws: dict[str, Sequence[int]]
    starts: dict[str, int]
    _sent: list[int] = field(default_factory=list)
    _num_delayed: int = 0
    _is_bad: bool = False

    def __post_init__(self) -> None:
        netem = self.netem
        loss = netem.loss if isinstance(netem.loss, Chance) else Chance()
        correlations = {
            "delay": netem.correlation,
            "loss": loss.correlation,
            "duplicate": netem.duplicate.correlation,
            "reorder": netem.reorder.correlation,
        }
        self._random = {
            name: _Correlated(correlation, self.starts[name])
            for name, correlation in correlations.items()
        }

    def Send(self, k: int, now: int) -> tuple[int | None, int | None]:
        """Returns when packet k and its copy leave the queue, ns; None: lost."""
        is_double = self._Happens("duplicate", self.netem.duplicate, k, "")
        is_lost = self._IsLost(k, "")
        copy = None
        if is_lost and not is_double:
            return None, None
        if is_double and not is_lost and not self._IsLost(k, " of copies"):
            copy = self._Enter(k, now, " of copies")
        return self._Enter(k, now, ""), copy

    def _Happens(self, name: str, chance: Chance, k: int, which: str) -> bool:
        if chance.share == 0:
            return False
        number = self._random[name].Next(self.draws[name + which][k])
        return number <= _Threshold(chance.share)

    def _IsLost(self, k: int, which: str) -> bool:
        loss = self.netem.loss
        if isinstance(loss, Chance):
            return self._Happens("loss", loss, k, which)
        lost = loss.bad_loss if self._is_bad else loss.good_loss
        leaves = loss.to_good if self._is_bad else loss.to_bad
        if self.draws["state" + which][k] < _Threshold(leaves):
            self._is_bad = not self._is_bad
        return self.draws["loss" + which][k] < _Threshold(lost)

    def _Enter(self, k: int, now: int, which: str) -> int | None:
        """Returns when a packet leaves that is queued now, ns; None: it is full."""
        netem = self.netem
        while self._sent and self._sent[0] <= now:
            heapq.heappop(self._sent)
        if len(self._sent) >= netem.limit:
            return None
        may_be_reordered = self._num_delayed >= netem.gap - 1
        if may_be_reordered and self._Happens("reorder", netem.reorder, k, which):
            self._num_delayed = 0
            return now
        time = now + self._Delay(k, which)
        self._num_delayed += 1
        heapq.heappush(self._sent, time)
        return max(time, now)

    def _Delay(self, k: int, which: str) -> int:
        netem = self.netem
        if netem.jitter == 0:
            return netem.delay
        number = self._random["delay"].Next(self.draws["delay" + which][k])
        if netem.distribution == "uniform":
            return netem.delay + number % (2 * netem.jitter) - netem.jitter
        table = Table(netem.distribution)
        deviation = netem.jitter * table[number % len(table)] / _SCALE
        return netem.delay + round(deviation)


def Deliver(
    netem: Netem, sent: Array, draw: Callable[[str], Array]
) -> tuple[Array, Array]:
    """Returns how long packets are in netem's queue, s; infinity: lost.

    Args:
        netem: The options of netem.
        sent: The times when the packets are sent, s, ascending (N).
        draw: A function that returns whole random numbers from 0 to 2^32 - 1, by one of
            RANDOM_NUMBERS one for each packet, and by "starts" one for each of STARTS
            or more.

    Returns:
        The times of the packets (N), and of their copies (N).
    """
    draws = {name: draw(name).tolist() for name in RANDOM_NUMBERS}
    starts = dict(zip(STARTS, draw("starts").tolist(), strict=False))
    queue = _Queue(netem, draws, starts)
    times = np.full((2, len(sent)), math.inf)
    for k, time in enumerate(np.rint(1e9 * sent).astype(np.int64).tolist()):
        for copy, leaves in enumerate(queue.Send(k, time)):
            if leaves is not None:
                times[copy, k] = 1e-9 * (leaves - time)
    return times[0], times[1]

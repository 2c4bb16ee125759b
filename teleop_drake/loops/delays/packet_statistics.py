"""Statistics of the packets of a run: losses, delays, age of information."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Receiver
from teleop_drake.loops.numerics.instants import TIE

_PERCENTS = {"minimum": 0, "median": 50, "p95": 95, "p99": 99, "maximum": 100}


@dataclass(kw_only=True)
class PacketStatistics:
    """Statistics of the packets of one channel until the end of a run.

    The delays are those of the packets that were not lost, also of those that were
    still under way at the end: without them the largest delays would be left out. They
    are None if there are none. The age of information is the time since the packet that
    is shown was sent. Its mean and maximum begin with the first packet shown, and are
    None if no packet is shown.

    Attributes:
        sent: Number of packets sent.
        received: Number of packets that arrived by the end.
        lost: Number of packets lost. The others that were not received were still
            under way.
        loss_rate: lost / sent.
        reordered: Number of packets that arrived after a newer one.
        late: Number of packets that arrived after their playout time (playout only).
        duplicated: Number of packets that arrived twice.
        delay_mean: Mean delay, s.
        delay_minimum: Smallest delay, s.
        delay_median: Median of the delays, s.
        delay_p95: 95th percentile of the delays, s.
        delay_p99: 99th percentile of the delays, s.
        delay_maximum: Largest delay, s.
        age_mean: Mean age of information over time, s.
        age_maximum: Largest age of information, s.
    """

    sent: int
    received: int
    lost: int
    loss_rate: float
    reordered: int
    late: int
    duplicated: int = 0
    delay_mean: float | None = None
    delay_minimum: float | None = None
    delay_median: float | None = None
    delay_p95: float | None = None
    delay_p99: float | None = None
    delay_maximum: float | None = None
    age_mean: float | None = None
    age_maximum: float | None = None


def ComputePacketStatistics(
    network: PacketNetwork, receiver: Receiver, end_time: float
) -> PacketStatistics:
    """Returns the statistics of the packets sent before a time.

    Args:
        network: The network, which determines the arrivals.
        receiver: The receiver, which determines the packets that are shown.
        end_time: The time in s; a packet that arrives later is not received.
    """
    sent = network.CountUntil(end_time)
    arrivals = network.Arrivals(sent)
    stamps = network.SentTimes(sent)
    received = np.flatnonzero(arrivals <= end_time)
    # Packets that arrive together count as being in order.
    received = received[np.argsort(arrivals[received], kind="stable")]
    is_newest = received == np.maximum.accumulate(received)
    delays = arrivals - stamps
    due = network.profile.delay + receiver.depth + TIE * network.sample_period
    is_late = (delays[received] > due) & (receiver.policy == "playout")
    measured: dict[str, Any] = {}
    known = delays[np.isfinite(delays)]
    if known.size:
        for name, percent in _PERCENTS.items():
            measured[f"delay_{name}"] = float(np.percentile(known, percent))
        measured["delay_mean"] = float(known.mean())
    shown, stamps = network.ShownUntil(receiver, end_time)
    if shown.size:
        # Between two packets the age grows with slope 1.
        ends = np.append(shown[1:], end_time)
        integral = np.sum((ends - stamps) ** 2 - (shown - stamps) ** 2) / 2
        measured["age_mean"] = float(integral / (end_time - shown[0]))
        measured["age_maximum"] = float(np.max(ends - stamps))
    lost = int(np.sum(np.isinf(arrivals)))
    return PacketStatistics(
        sent=sent,
        received=len(received),
        lost=lost,
        loss_rate=lost / sent if sent else 0.0,
        reordered=int(np.sum(~is_newest)),
        late=int(np.sum(is_late)),
        duplicated=int(np.sum(network.CopyArrivals(sent) <= end_time)),
        **measured,
    )

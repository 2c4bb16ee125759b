"""What a network and a receiver have made of the packets of a run."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from teleop_drake.blocks.channels.packet_network import PacketNetwork, Receiver
from teleop_drake.numerics.instants import TIE

_PERCENTS = {"minimum": 0, "median": 50, "p95": 95, "p99": 99, "maximum": 100}


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
    """Returns what a network and a receiver make of the packets sent before a time.

    Args:
        end_time: In s; what arrives later has not been received.
    """
    sent = network.CountUntil(end_time)
    arrivals = network.Arrivals(sent)
    stamps = np.arange(sent) * network.sample_period
    received = np.flatnonzero(arrivals <= end_time)
    # Two that arrive together are in order.
    received = received[np.argsort(arrivals[received], kind="stable")]
    is_newest = received == np.maximum.accumulate(received)
    delays = (arrivals - stamps)[received]
    due = network.profile.delay + receiver.depth + TIE * network.sample_period
    is_late = (delays > due) & (receiver.policy == "playout")
    measured: dict[str, Any] = {}
    if delays.size:
        for name, percent in _PERCENTS.items():
            measured[f"delay_{name}"] = float(np.percentile(delays, percent))
        measured["delay_mean"] = float(delays.mean())
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
        **measured,
    )

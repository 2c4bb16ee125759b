"""Packet statistics of one channel over a run."""

import math
from dataclasses import dataclass

import numpy as np

from teleop_drake.channels.packet_network import PacketNetwork
from teleop_drake.channels.receiver import Receiver
from teleop_drake.integrator.problem import TIE


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


def ComputePacketStatistics(
    network: PacketNetwork, receiver: Receiver, end_time: float
) -> PacketStatistics:
    """Returns what a network and a receiver make of the packets sent before a time.

    Args:
        end_time: In s; what arrives later has not been received.
    """
    h = network.sample_period
    sent = math.ceil(end_time / h - TIE)
    arrivals = network.Arrivals(sent)
    shown = np.array([network.Shown(k, receiver) for k in range(sent)])
    stamps = np.arange(sent) * h
    received = np.flatnonzero(arrivals <= end_time)
    # Two that arrive together are in order.
    received = received[np.argsort(arrivals[received], kind="stable")]
    is_newest = received == np.maximum.accumulate(received)
    delays = (arrivals - stamps)[received]
    due = stamps + network.profile.delay + receiver.depth + TIE * h
    is_late = (arrivals > due)[received] & (receiver.policy == "playout")
    ages = _Ages(stamps[received], shown[received], end_time)
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


def _Ages(
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

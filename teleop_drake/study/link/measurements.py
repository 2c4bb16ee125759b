"""Measurements of the network by a side: ticks, packets in use, delays.

The packet in use at a tick is the newest packet that has been received.
"""

from typing import NamedTuple

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Record
from teleop_drake.study.link.half import Half
from teleop_drake.study.link.packets import NUM_USED

# Entries of `used` where no packet was in use, and where it is not known which was.
_NONE = -1
_UNKNOWN = -2


class Tick(NamedTuple):
    """A tick that was not missed, with its measurements.

    Attributes:
        tick: The number of the tick.
        is_stale: Whether the packet in use was too old, or the other side had ended.
        packet_age: The age of the packet in use, s.
        round_trip: The age of the echo in it, s. The echo is this side's packet that
            the other side had in use when it sent.
        period: The time since the beginning of the tick before, s.
        lateness: The time by which the tick began too late, s.
        trust: The trust in the packet in use, 0 to 1.
    """

    tick: int
    is_stale: bool
    packet_age: float
    round_trip: float
    period: float
    lateness: float
    trust: float


TIMES = ("packet_age", "round_trip", "period", "lateness")
"""The fields of a Tick that are times in s."""


class Measurements:
    """The ticks of a side, and the packets that were in use at them.

    Args:
        half: The side.
        last: The number of its last tick.

    Attributes:
        ticks: The ticks that were not missed.
        used: For each direction, the tick of the packet that was in use at each tick of
            the side that receives it; -1: there was none, or the tick was missed; -2:
            it is not known.
    """

    def __init__(self, half: Half, last: int):
        self._spoken = half.spoken
        self._period = half.period
        self.ticks: list[Tick] = []
        # The first packets report entries before tick 0, for which there is room.
        num = NUM_USED + last + 1
        self._padded = {
            half.heard: np.full(num, _NONE),
            half.spoken: np.full(num, _UNKNOWN),
        }
        self.used = {way: used[NUM_USED:] for way, used in self._padded.items()}

    @property
    def last_tick(self) -> int:
        """The number of the last tick; -1 before the start."""
        return self.ticks[-1].tick if self.ticks else -1

    def LatestUsed(self, way: str, tick: int) -> Array:
        """Returns a view of the NUM_USED entries of `used` that end at a tick.

        Args:
            way: The direction of the packets.
            tick: The last tick.
        """
        return self._padded[way][tick + 1 :][:NUM_USED]

    def Time(self) -> Array:
        """Returns the times of the ticks (N), s."""
        return self._period * np.array([x.tick for x in self.ticks], float)

    def Signals(self) -> dict[str, Array]:
        """Returns the measured signals (N, 1), by their names."""
        return {
            name: np.array([[getattr(tick, name)] for tick in self.ticks], float)
            for name in (*TIMES, "trust")
        }

    def Used(self) -> dict[str, Array]:
        """Returns `used` up to the last tick, without gaps, for each direction.

        Where the packet in use is not known, its tick grows in steady steps between the
        known ones. It never decreases.
        """
        ticks = np.arange(self.last_tick + 1)
        steady = {}
        for way, used in self.used.items():
            known = np.flatnonzero(used[: ticks.size] > _UNKNOWN)
            steps = np.maximum.accumulate(np.append(_NONE, used[known]))
            between = np.interp(ticks, np.append(-1, known), steps)
            steady[way] = np.floor(between).astype(int).clip(max=self.last_tick)
        return steady

    def Delays(self) -> dict[str, Array]:
        """Returns the delay from each packet's tick until it was in use, s.

        Returns:
            The delays for `forward` and `return`. Entry k belongs to the packet of tick
            k; it is NaN if that was never in use, and negative if clocks have drifted
            so far that it was in use before its tick.
        """
        delays = {}
        for way, used in self.Used().items():
            # The first entry belongs to the packet before tick 0.
            packets, first_ticks = np.unique(np.append(_NONE, used), return_index=True)
            delays[way] = np.full(self.last_tick + 1, np.nan)
            num_ticks = first_ticks - 1 - packets
            delays[way][packets[1:]] = self._period * num_ticks[1:]
        return delays

    def Outages(self) -> list[list[float]]:
        """Returns the begin and the end in s of each interval of stale ticks."""
        is_stale = [False, *(tick.is_stale for tick in self.ticks), False]
        changes = np.flatnonzero(np.diff(is_stale))
        time = self.Time()
        ends = np.append(time, time[-1])
        return ends[changes].reshape(-1, 2).round(6).tolist()

    def Report(self) -> Record:
        """Returns a summary of the measurements for JSON, with times in s."""
        delays = self.Delays()
        known = np.flatnonzero(self.used[self._spoken] > _UNKNOWN)
        num_periods = self.last_tick - self.ticks[0].tick + 1
        report: Record = {
            "missed_periods": num_periods - len(self.ticks),
            "unused_packets": {x: int(np.isnan(y).sum()) for x, y in delays.items()},
            "early_packets": {x: int((y < 0).sum()) for x, y in delays.items()},
            "unknown_periods": int(np.sum(np.diff(known) - 1)),
            "outages_s": self.Outages(),
        }
        for name in TIMES:
            report[f"{name}_s"] = _Statistics(self.Signals()[name])
        return report


def _Statistics(x: Array) -> dict[str, float]:
    """Returns mean, deviation, extremes and median of an array."""
    statistics = {
        "mean": x.mean(),
        "deviation": x.std(),
        "least": x.min(),
        "median": np.median(x),
        "most": x.max(),
    }
    return {name: round(float(value), 9) for name, value in statistics.items()}

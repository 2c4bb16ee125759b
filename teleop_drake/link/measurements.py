"""What a side measures of the network: ticks, packets in use, delays."""

from typing import Any, NamedTuple

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.link.half import Half
from teleop_drake.link.packets import NUM_USED

# What `used` has where no packet was in use, and where that is not known.
_NONE = -1
_UNKNOWN = -2


class Tick(NamedTuple):
    """A tick that was not missed, and what was measured then.

    Attributes:
        tick: Its number.
        is_stale: Whether what was in use was too old.
        packet_age: Age of what was in use, s.
        round_trip: Age of the echo in it, s.
        period: How long after the one before it began, s.
        lateness: How late it began, s.
        trust: How far what was in use was trusted, 0 to 1.
    """

    tick: int
    is_stale: bool
    packet_age: float
    round_trip: float
    period: float
    lateness: float
    trust: float


_TIMES = ("packet_age", "round_trip", "period", "lateness")

MEASURED = (*_TIMES, "trust")
"""The fields of a Tick that are signals of a recording."""


class Measurements:
    """The ticks of a side, and the packets that were in use at them.

    Args:
        half: The side.
        last: The number of its last tick.

    Attributes:
        ticks: Those that were not missed.
        used: Of each way, the tick of the packet that was in use at each tick where it
            is heard; -1: none, or it was missed; -2: not known.
    """

    def __init__(self, half: Half, last: int):
        self._spoken = half.spoken
        self._period = half.period
        self.ticks: list[Tick] = []
        # Entries before tick 0 are those of the first packets.
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
        """Returns what was in use at a tick and before (NUM_USED), to read or to set.

        Args:
            way: The direction of the packets.
        """
        return self._padded[way][tick + 1 :][:NUM_USED]

    def Time(self) -> Array:
        """Returns the times of the ticks (N), s."""
        return self._period * np.array([x.tick for x in self.ticks], float)

    def Signals(self) -> dict[str, Array]:
        """Returns what was measured (N, 1), by its name."""
        return {
            name: np.array([[getattr(tick, name)] for tick in self.ticks], float)
            for name in MEASURED
        }

    def Used(self) -> dict[str, Array]:
        """Returns of each way which packet was in use at each tick where it is heard.

        In between of what is known, packets are taken in steady steps.
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
        """Returns how long each packet took until it was in use, s; NaN: it never was.

        Returns:
            By `forward` and `return`; entry k is of the packet of tick k. It is less
            than 0 if clocks have drifted so far that it was in use before its tick.
        """
        delays = {}
        for way, used in self.Used().items():
            # The first entry is that of the packet before tick 0.
            packets, first_ticks = np.unique(np.append(_NONE, used), return_index=True)
            delays[way] = np.full(self.last_tick + 1, np.nan)
            num_ticks = first_ticks - 1 - packets
            delays[way][packets[1:]] = self._period * num_ticks[1:]
        return delays

    def Outages(self) -> list[list[float]]:
        """Returns when what was in use began and ceased to be too old, s."""
        is_stale = [False, *(tick.is_stale for tick in self.ticks), False]
        changes = np.flatnonzero(np.diff(is_stale))
        time = self.Time()
        ends = np.append(time, time[-1])
        return ends[changes].reshape(-1, 2).round(6).tolist()

    def Report(self) -> dict[str, Any]:
        """Returns what was measured, times in s, as JSON has it."""
        delays = self.Delays()
        known = np.flatnonzero(self.used[self._spoken] > _UNKNOWN)
        num_periods = self.last_tick - self.ticks[0].tick + 1
        report: dict[str, Any] = {
            "missed_periods": num_periods - len(self.ticks),
            "unused_packets": {x: int(np.isnan(y).sum()) for x, y in delays.items()},
            "early_packets": {x: int((y < 0).sum()) for x, y in delays.items()},
            "unknown_periods": int(np.sum(np.diff(known) - 1)),
            "outages_s": self.Outages(),
        }
        for name in _TIMES:
            report[f"{name}_s"] = _Statistics(self.Signals()[name])
        return report


def _Statistics(x: Array) -> dict[str, float]:
    """Returns the statistics of some numbers."""
    statistics = {
        "mean": x.mean(),
        "deviation": x.std(),
        "least": x.min(),
        "median": np.median(x),
        "most": x.max(),
    }
    return {name: round(float(value), 9) for name, value in statistics.items()}


# The log of a side is a CSV file. Each line is handed to the operating system as it is
# written, so that it is there when the process is not any more.


def LogHeader(half: Half) -> bytes:
    """Returns the first line of a side's log, the names of its columns."""
    columns = ["time_s", *(f"{name}_s" for name in _TIMES)]
    columns += ["trust", "tick_of_packet_in_use"]
    columns += [f"received_{i}" for i in range(half.fed.size)]
    columns += [f"sent_{i}" for i in range(half.sent[0].size)]
    return f"{','.join(columns)}\n".encode("ascii")


def LogLine(half: Half, tick: Tick, packet_tick: int) -> bytes:
    """Returns the line of a tick in a side's log.

    Args:
        half: The side; the line has its packets.
        packet_tick: That of the packet that was in use.
    """
    numbers = [
        tick.tick * half.period,
        *(getattr(tick, name) for name in MEASURED),
        packet_tick,
        *half.fed.tolist(),
        *half.sent[-1].tolist(),
    ]
    return f"{','.join(f'{x:.9g}' for x in numbers)}\n".encode("ascii")

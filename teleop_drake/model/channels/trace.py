"""Measured delays of a channel, read from a file.

tables.ReadPackets() tells which files there are.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.files import Replacing
from teleop_drake.loops.framework.validation import Refuse, ScenarioError, Show
from teleop_drake.model.tables.histogram import Histogram
from teleop_drake.model.tables.measured import HALVED
from teleop_drake.model.tables.packets import ReadMeasured, ReadPackets

ENDS = ("refuse", "hold", "repeat")
"""The treatments of a trace that is shorter than the simulation."""

# Largest number of entries of a trace that is repeated.
_MAX_ENTRIES = 10_000_000


@dataclass(frozen=True)
class Trace:
    """Measured delays, one entry for each packet that was sent.

    Attributes:
        times: The times when the packets were sent, s from the first one, ascending
            (N).
        delays: The delays of the packets, s (N). That of a lost packet is interpolated
            between its neighbours that arrived.
        is_lost: Whether each packet was lost (N).
        is_halved: Whether the delays are halves of round trips.
        summary: A line that tells what was read.
    """

    times: np.ndarray
    delays: np.ndarray
    is_lost: np.ndarray
    is_halved: bool = False
    summary: str = ""

    def Until(self, duration: float, end: str) -> "Trace":
        """Returns the trace with times that count from its first entry.

        Args:
            duration: The time that a repeated trace has to reach, s.
            end: The treatment of a shorter trace: with `repeat` it begins again, a mean
                step after its last entry; otherwise it keeps its length.
        """
        times = self.times - self.times[0]
        if duration <= times[-1] or end != "repeat":
            return replace(self, times=times)
        period = times[-1] + times[-1] / (len(times) - 1)
        count = int(duration / period) + 1
        if count * len(times) > _MAX_ENTRIES:
            Refuse("trace_end", end, f"such that there are {_MAX_ENTRIES:g} entries")
        # The first entry follows the last repetition, so that there are delays to
        # interpolate behind its last entry.
        entries = np.append(np.tile(np.arange(len(times)), count), 0)
        begins = period * np.arange(count)
        return replace(
            self,
            times=np.append(np.add.outer(begins, times), count * period),
            delays=self.delays[entries],
            is_lost=self.is_lost[entries],
        )

    def IsLost(self, times: np.ndarray) -> np.ndarray:
        """Returns whether the latest entry at each of the given times was lost (K).

        Args:
            times: Times since the first entry, s (K).
        """
        # With the margin, a packet that is sent at the time of an entry is assigned to
        # that entry in spite of rounding.
        i = np.searchsorted(self.times, times + 1e-9, side="right") - 1
        return np.asarray(self.is_lost[np.maximum(i, 0)])


def WriteTrace(
    path: str | os.PathLike[str], times: ArrayLike, delays: ArrayLike
) -> None:
    """Writes times and delays in s of packets as a CSV file; NaN: lost."""
    rows = np.column_stack((times, delays))
    with Replacing(path) as file:
        np.savetxt(file, rows, "%.9g", ",", header="time_s,delay_s", comments="")


def ReadTrace(
    path: str,
    file: str | Mapping[str, Any],
    draw: Callable[[Histogram], Trace] | None = None,
) -> Trace:
    """Reads measured delays from a file.

    Args:
        path: The field that names the file, for messages.
        file: The file, or a mapping with its columns; see tables.ReadMeasured().
        draw: A function that makes a trace from a histogram; None: it is refused.

    Returns:
        The trace, which has at least two entries.

    Raises:
        ScenarioError: If the file cannot be read or leaves anything unclear.
    """
    packets = ReadMeasured(path, file) if draw else ReadPackets(path, file)
    if isinstance(packets, Histogram):
        assert draw is not None
        return draw(packets)
    is_lost = np.isnan(packets.delays)
    if is_lost.all():
        raise ScenarioError(
            f"{path} = {Show(file)}: must have a delay that is a number"
        )
    # The delay of a lost packet is interpolated between its neighbours that arrived.
    times = packets.times
    delays = packets.delays.copy()
    delays[is_lost] = np.interp(times[is_lost], times[~is_lost], delays[~is_lost])
    return Trace(
        times,
        delays,
        is_lost,
        is_halved=packets.kind == HALVED,
        summary=packets.Summary(),
    )

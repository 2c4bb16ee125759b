"""Measured delays, read from a file: CSV, or the output of `ping`.

A CSV file begins with the header `time_s,delay_s`. Its columns are the time when a
packet was sent and its delay one way. The delays may be in ms or us instead, as
`delay_ms` or `delay_us`. The delay of a lost packet is `nan`, `lost` or empty.

From each line of ping, the sequence number and the round-trip time are read, and the
time stamp of `ping -D` if there is one. Without time stamps, a packet is taken to be
sent each second. A packet whose number is missing was lost. The delay one way is half
of the round trip.

Empty lines, and lines that begin with `#`, are skipped.
"""

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from teleop_drake.arrays import Array, ArrayLike
from teleop_drake.blocks.channels.base import SHORTEST_TIME
from teleop_drake.files import ReadNumbers, ReadRows, Replacing
from teleop_drake.validation import Refuse, ScenarioError, Show

ENDS = ("refuse", "hold", "repeat")
"""The treatments of a trace that is shorter than the simulation."""

# Largest number of entries of a trace that is repeated.
_MAX_ENTRIES = 10_000_000

# The headers of a CSV file, with the unit of its delays in s.
_HEADERS = {"time_s,delay_s": 1.0, "time_s,delay_ms": 1e-3, "time_s,delay_us": 1e-6}

# The delay of a lost packet in a CSV file.
_LOST = ("", "nan", "lost")

# A line such as `64 bytes from 10.0.0.1: icmp_seq=5 ttl=64 time=12.3 ms`. `ping -D`
# prints a time stamp in brackets before it.
_PING = re.compile(
    r"(?:\[(?P<stamp>[\d.]+)\] )?.*icmp_seq=(?P<number>\d+).*time=(?P<delay>[\d.]+) ms"
)


@dataclass(frozen=True)
class Trace:
    """Measured delays, one entry for each packet that was sent.

    Attributes:
        times: The times when the packets were sent, s, ascending (N).
        delays: The delays of the packets, s (N). That of a lost packet is interpolated
            between its neighbours that arrived.
        is_lost: Whether each packet was lost (N).
        is_halved: Whether the delays are halves of round trips.
    """

    times: np.ndarray
    delays: np.ndarray
    is_lost: np.ndarray
    is_halved: bool = False

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


def WriteTrace(path: str | os.PathLike[str], period: float, delays: ArrayLike) -> None:
    """Writes the delays in s of periodic packets as a CSV file; NaN: lost."""
    rows = np.column_stack((np.arange(np.size(delays)) * period, delays))
    with Replacing(path) as file:
        np.savetxt(file, rows, "%.9g", ",", header="time_s,delay_s", comments="")


def ReadTrace(path: str, file: str) -> Trace:
    """Reads measured delays from a CSV file, or from the output of `ping`.

    Args:
        path: The field that names the file, for messages.

    Returns:
        The trace, which has at least two entries.

    Raises:
        ScenarioError: If the file cannot be read or a line is not allowed.
    """
    origin = f"{path} = {Show(file)}"
    rows = ReadRows(file, origin)
    matches = [_PING.match(line) for _, line in rows]
    answers = [match for match in matches if match]
    entries = _EntriesOfPing(answers) if answers else _EntriesOfCsv(rows, origin)
    if len(entries) < 2:
        raise ScenarioError(f"{origin}: must have two packets, and has {len(entries)}")
    times, delays = entries.T
    is_lost = np.isnan(delays)
    if is_lost.all():
        raise ScenarioError(f"{origin}: must have a delay that is a number")
    # The delay of a lost packet is interpolated between its neighbours that arrived.
    delays[is_lost] = np.interp(times[is_lost], times[~is_lost], delays[~is_lost])
    return Trace(times, delays, is_lost, is_halved=bool(answers))


def _EntriesOfPing(answers: Sequence[re.Match[str]]) -> Array:
    """Returns times and delays in s of the packets of ping (N, 2); NaN: lost."""
    sent: dict[int, float] = {}
    delays: dict[int, float] = {}
    for answer in answers:
        number = int(answer["number"])
        if number in sent:
            continue  # Of duplicate answers, only the first is used.
        round_trip = float(answer["delay"]) * 1e-3
        delays[number] = round_trip / 2
        # The time stamp is that of the answer, a round trip after the packet was sent.
        stamp = answer["stamp"]
        sent[number] = float(stamp) - round_trip if stamp else float(number)
    known = sorted(sent)
    numbers = range(known[0], known[-1] + 1)
    times = np.interp(numbers, known, [sent[k] for k in known])
    return np.column_stack([times, [delays.get(k, math.nan) for k in numbers]])


def _EntriesOfCsv(rows: Sequence[tuple[int, str]], origin: str) -> Array:
    """Returns times and delays in s of a CSV file (N, 2), after checking each line."""
    header = "".join(rows[0][1].split()) if rows else ""
    if header not in _HEADERS:
        allowed = f"must begin with the header {' or '.join(_HEADERS)}"
        raise ScenarioError(f"{origin}: {allowed}, not {Show(header)}")
    table = ReadNumbers(
        rows[1:],
        origin,
        header.split(","),
        missing=_LOST,
        least_step=SHORTEST_TIME,
    )
    for (number, line), delay in zip(rows[1:], table[:, 1], strict=True):
        if delay < 0:
            place = f"{origin}: line {number}, {Show(line)}"
            raise ScenarioError(f"{place}: must be a delay >= 0")
    return table * (1.0, _HEADERS[header])

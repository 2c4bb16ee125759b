"""Measured delays, read from a file: CSV, or what `ping` prints.

A CSV file begins with a header, `time_s,delay_s`: when a packet was sent, and how long
it took one way. The delays may be in ms or us instead, as `delay_ms` or `delay_us`. A
packet that was lost has `nan`, `lost` or nothing for a delay.

Of ping's lines the number and the time count, with the time stamps of `ping -D` if
they are there. A number that is left out was lost. Half of a round trip is taken for
each way.

Empty lines, and those that begin with `#`, are skipped.
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
"""What may be done where the simulation outlasts a trace."""

# More entries than these make no channel.
_MAX_ENTRIES = 10_000_000

# The headers of a CSV file, and how many seconds a unit of its delays is.
_HEADERS = {"time_s,delay_s": 1.0, "time_s,delay_ms": 1e-3, "time_s,delay_us": 1e-6}

_LOST = ("", "nan", "lost")

# 64 bytes from 10.0.0.1: icmp_seq=5 ttl=64 time=12.3 ms, which `ping -D` puts a time
# in brackets before.
_PING = re.compile(
    r"(?:\[(?P<stamp>[\d.]+)\] )?.*icmp_seq=(?P<number>\d+).*time=(?P<delay>[\d.]+) ms"
)


@dataclass(frozen=True)
class Trace:
    """Measured delays, one entry for each packet that was sent.

    Attributes:
        times: When it was sent, s, ascending (N).
        delays: How long it took, s (N); of one that was lost, between those of its
            neighbours that arrived.
        is_lost: Which ones were lost (N).
        is_halved: Whether the delays are halves of round trips.
    """

    times: np.ndarray
    delays: np.ndarray
    is_lost: np.ndarray
    is_halved: bool = False

    def Until(self, duration: float, end: str) -> "Trace":
        """Returns the trace from its first entry on until a duration.

        Args:
            duration: How long it has to be, s.
            end: If it is shorter: `repeat` begins again, a mean step after the last
                entry; else it stays as long as it is.
        """
        times = self.times - self.times[0]
        if duration <= times[-1] or end != "repeat":
            return replace(self, times=times)
        period = times[-1] + times[-1] / (len(times) - 1)
        count = int(duration / period) + 1
        if count * len(times) > _MAX_ENTRIES:
            Refuse("trace_end", end, f"such that there are {_MAX_ENTRIES:g} entries")
        # Also the way back from the last entry to the first one.
        entries = np.append(np.tile(np.arange(len(times)), count), 0)
        begins = period * np.arange(count)
        return replace(
            self,
            times=np.append(np.add.outer(begins, times), count * period),
            delays=self.delays[entries],
            is_lost=self.is_lost[entries],
        )

    def IsLost(self, times: np.ndarray) -> np.ndarray:
        """Returns whether the last entry until each of some times was lost (K).

        Args:
            times: Since the first entry, s (K).
        """
        # A packet that is sent with an entry has that entry's fate, whatever the
        # rounding of its time.
        i = np.searchsorted(self.times, times + 1e-9, side="right") - 1
        return np.asarray(self.is_lost[np.maximum(i, 0)])


def WriteTrace(path: str | os.PathLike[str], period: float, delays: ArrayLike) -> None:
    """Writes delays in s, NaN: lost, of packets that were sent each period, as CSV."""
    rows = np.column_stack((np.arange(np.size(delays)) * period, delays))
    with Replacing(path) as file:
        np.savetxt(file, rows, "%.9g", ",", header="time_s,delay_s", comments="")


def ReadTrace(path: str, file: str) -> Trace:
    """Reads measured delays from a CSV file, or from what `ping` printed.

    Args:
        path: The field that names the file, for messages.

    Returns:
        At least two entries.

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
    # A lost packet has a delay between those of its neighbours.
    delays[is_lost] = np.interp(times[is_lost], times[~is_lost], delays[~is_lost])
    return Trace(times, delays, is_lost, is_halved=bool(answers))


def _EntriesOfPing(answers: Sequence[re.Match[str]]) -> Array:
    """Returns the packets of ping's answers, those that were lost among them."""
    sent: dict[int, float] = {}
    delays: dict[int, float] = {}
    for answer in answers:
        number = int(answer["number"])
        if number in sent:
            continue  # Only the first of two answers counts.
        round_trip = float(answer["delay"]) * 1e-3
        delays[number] = round_trip / 2
        # The stamp is that of the answer.
        stamp = answer["stamp"]
        sent[number] = float(stamp) - round_trip if stamp else float(number)
    known = sorted(sent)
    numbers = range(known[0], known[-1] + 1)
    times = np.interp(numbers, known, [sent[k] for k in known])
    return np.column_stack([times, [delays.get(k, math.nan) for k in numbers]])


def _EntriesOfCsv(rows: Sequence[tuple[int, str]], origin: str) -> Array:
    """Returns the packets of a CSV file, after checking each line."""
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

"""Measured delays, read from a file: CSV, or what `ping` prints."""

import csv
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.files import ReadRows, Replacing
from teleop_drake.validation import Choices, Refuse, ScenarioError, Show

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
"""Units of a measured delay, and how many seconds each is."""

ENDS = ("refuse", "hold", "repeat")
"""What may be done where the simulation outlasts a trace."""

# More entries than these make no channel.
_MAX_ENTRIES = 10_000_000

# Anything else is a row, which may have a typing error.
_HEADER = re.compile(r"""\s*["']?[^\W\d_][^,]*(,\s*["']?[^\W\d_][^,]*)*""")
# The unit at the end of a column's name: delay_ms, "rtt [us]", "delay (s)".
_UNIT = re.compile(r"[\s_(\[](us|µs|ms|s)[)\]]?$")
_TIME_NAME = re.compile(r"(time|t|timestamp|sent|seconds)(?![a-z])", re.IGNORECASE)
_DELAY_NAME = re.compile(r"(delay|rtt|latency|owd|ping|round.?trip)", re.IGNORECASE)
_ROUND_TRIP_NAME = re.compile(r"rtt|ping|round.?trip", re.IGNORECASE)
_LOST = ("", "nan", "inf", "-", "*", "lost", "timeout")

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
        is_round_trip: Whether they are those of a way and of the way back: what ping
            measures, and what a column `rtt` or `ping` says.
    """

    times: np.ndarray
    delays: np.ndarray
    is_lost: np.ndarray
    is_round_trip: bool = False

    def Until(self, duration: float, end: str) -> "Trace":
        """Returns the trace from its first entry on until a duration.

        Args:
            duration: How long it has to be, s.
            end: If it is shorter: `hold` goes on with its last entry, `repeat` begins
                again, a mean step after the last entry, and `refuse` leaves it.
        """
        times = self.times - self.times[0]
        missing = duration - times[-1]
        if missing <= 0 or end == "refuse":
            return replace(self, times=times)
        if end == "hold":
            return replace(
                self,
                times=np.append(times, duration),
                delays=np.append(self.delays, self.delays[-1]),
                is_lost=np.append(self.is_lost, self.is_lost[-1]),
            )
        period = times[-1] + times[-1] / (len(times) - 1)
        count = int(duration / period) + 1
        if count * len(times) > _MAX_ENTRIES:
            Refuse("trace_end", end, f"such that there are {_MAX_ENTRIES:g} entries")
        times = np.concatenate([times + i * period for i in range(count)])
        # Also the way back from the last entry to the first one.
        return replace(
            self,
            times=np.append(times, count * period),
            delays=np.append(np.tile(self.delays, count), self.delays[0]),
            is_lost=np.append(np.tile(self.is_lost, count), self.is_lost[0]),
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
        np.savetxt(file, rows, "%.9g", ",", header="time,delay", comments="")


def ReadTrace(
    path: str,
    file: str,
    *,
    unit: str | None = None,
    columns: Sequence[str] | None = None,
    sample_period: float | None = None,
) -> Trace:
    """Reads measured delays from a CSV file, or from what `ping` printed.

    A CSV file has the columns time and delay. Its first line may be a header, all of
    whose columns begin with a letter. What was lost has nothing, `nan`, `lost`,
    `timeout`, `-` or `*` for a delay. Of ping's lines the number and the time count,
    with the time stamps of `ping -D` if they are there; a number that is left out was
    lost.

    Args:
        path: The field that names the file, for messages.
        unit: Of the delays, one of UNITS; None: that at the end of the column's name
            (`delay_ms`), s if there is none; ping's are ms.
        columns: The names of the columns of time and delay, or that of the delay
            alone; None: two columns that there are, or those with such names.
        sample_period: If it is not None, line k is of packet k, sent at k times this,
            whatever its time; s.

    Returns:
        At least two entries.

    Raises:
        ScenarioError: If the file cannot be read or a line is not allowed.
    """
    origin = f"{path} = {Show(file)}"
    rows = ReadRows(file, origin)
    name = "ping"
    if any(_PING.match(line) for _, line in rows):
        times, delays = _ReadPing(rows)
        scale = UNITS[unit or "ms"]
    else:
        needs_time = sample_period is None
        times, delays, name = _ReadCsv(rows, path, origin, columns, needs_time)
        scale = UNITS[unit or _UnitOf(name)]
    is_lost = np.isnan(delays)
    if sample_period is not None:
        times = [k * sample_period for k in range(len(delays))]
    if len(times) < 2:
        raise ScenarioError(
            f"{origin}: must have at least two lines of time,delay, not {len(times)}"
        )
    if is_lost.all():
        raise ScenarioError(f"{origin}: must have a delay that is a number")
    seconds = np.array(delays) * scale
    at = np.array(times)
    seconds[is_lost] = np.interp(at[is_lost], at[~is_lost], seconds[~is_lost])
    return Trace(at, seconds, is_lost, bool(_ROUND_TRIP_NAME.search(name)))


def _ReadPing(rows: Sequence[tuple[int, str]]) -> tuple[list[float], list[float]]:
    """Returns times in s and delays in ms of ping's lines; NaN is lost."""
    found = [match for _, line in rows if (match := _PING.match(line))]
    entries: dict[int, tuple[float, float]] = {}
    for match in found:
        number = int(match["number"])
        # What arrives twice counts once; a stamp is that of the answer.
        delay = float(match["delay"])
        stamp = float(match["stamp"]) - delay * 1e-3 if match["stamp"] else number
        entries.setdefault(number, (stamp, delay))
    numbers = range(min(entries), max(entries) + 1)
    known = sorted(entries)
    stamps = np.interp(numbers, known, [entries[k][0] for k in known])
    return stamps.tolist(), [entries.get(k, (0.0, math.nan))[1] for k in numbers]


def _ReadCsv(
    rows: Sequence[tuple[int, str]],
    path: str,
    origin: str,
    columns: Sequence[str] | None,
    needs_time: bool,
) -> tuple[list[float], list[float], str]:
    """Returns times in s, delays (NaN is lost), and the name of the delays' column."""
    names: list[str] = []
    if rows and _HEADER.fullmatch(rows[0][1]):
        (names,) = csv.reader([rows[0][1]], skipinitialspace=True)
    if names and _IsRow(names):
        names = []
    elif names:
        rows = rows[1:]
    if not names and not needs_time and rows and "," not in rows[0][1]:
        names = [""]
    time_column, delay_column = _Columns(names, columns, needs_time, f"{path}_columns")
    time_scale = UNITS[_UnitOf(names[time_column])] if names else 1.0
    named = names[delay_column] if len(names) > delay_column else ""
    time_unit, delay_unit = _UnitOf(names[time_column] if names else ""), _UnitOf(named)
    allowed = f"time,delay in {delay_unit}"
    if needs_time and time_unit != delay_unit:
        allowed = f"time in {time_unit}, delay in {delay_unit}"
    times: list[float] = []
    delays: list[float] = []
    for number, line in rows:
        place = f"{origin}: line {number}, {Show(line)}"
        cells = line.split(",")
        if columns is None and len(cells) != len(names) and len(cells) != 2:
            cells = cells if not needs_time and len(cells) == 1 else []
        try:
            delay_text = cells[delay_column].strip().lower()
            delay = math.nan if delay_text in _LOST else float(delay_text)
            time = float(cells[time_column]) * time_scale if needs_time else 0.0
        except (ValueError, IndexError):
            raise ScenarioError(f"{place}: must be {allowed}") from None
        wrong = ""
        if not math.isfinite(time):
            wrong = "finite numbers"
        elif needs_time and times and time <= times[-1]:
            wrong = f"later than the line before, {times[-1]:g} s"
        elif delay < 0:
            wrong = "a delay >= 0 (s)"
        if wrong:
            raise ScenarioError(f"{place}: must be {wrong}")
        times.append(time)
        delays.append(delay)
    return times, delays, named


def _IsRow(names: Sequence[str]) -> bool:
    """Returns whether what looks like a header are numbers, or the fate of a packet."""
    for name in names:
        try:
            float(name)
        except ValueError:
            if name.strip().lower() not in _LOST:
                return False
    return True


def _UnitOf(name: str) -> str:
    """Returns the unit at the end of a column's name, s if there is none."""
    match = _UNIT.search(name.strip())
    return match[1].replace("µ", "u") if match else "s"


def _Columns(
    names: Sequence[str],
    columns: Sequence[str] | None,
    needs_time: bool,
    path: str,
) -> tuple[int, int]:
    """Returns the numbers of the columns of time and delay."""
    stripped = [name.strip() for name in names]
    if columns is not None:
        for name in columns:
            if name not in stripped:
                Refuse(path, list(columns), Choices(name, stripped))
        if len(columns) != 1 + needs_time and len(columns) != 2:
            Refuse(path, list(columns), "the columns of time and delay")
        return stripped.index(columns[0]), stripped.index(columns[-1])
    if len(names) == 1:
        return 0, 0
    if len(names) <= 2:
        return 0, 1
    time = [i for i, name in enumerate(stripped) if _TIME_NAME.match(name)]
    delay = [i for i, name in enumerate(stripped) if _DELAY_NAME.search(name)]
    if len(delay) == 1 and (len(time) == 1 or not needs_time):
        return (time or delay)[0], delay[0]
    return 0, 1

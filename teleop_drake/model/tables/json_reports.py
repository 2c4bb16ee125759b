"""JSON of tools that measure networks: irtt, iperf3, WebRTC's getStats().

Where each tool has its numbers is a row of a table of paths. A path leads through keys;
`*` stands for every element of a list or mapping.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.tables.measured import HALVED, InOrder, Packets


class Report(NamedTuple):
    """Where a tool has its packets.

    Attributes:
        tool: The tool's name.
        records: The path to the records, one for each packet.
        time: The path in a record to the time of sending.
        time_unit: Its unit, s.
        delay: The path in a record to the round trip; a record without it was lost.
        delay_unit: Its unit, s.
        lost: The path in a record to a word that tells that the packet was lost.
    """

    tool: str
    records: str
    time: str
    time_unit: float
    delay: str
    delay_unit: float
    lost: str = ""


REPORTS = (
    Report(
        "irtt",
        "round_trips.*",
        "timestamps.client.send.wall",
        1e-9,
        "delay.rtt",
        1e-9,
        lost="lost",
    ),
    # TCP: the smoothed round trip of each interval of the sender.
    Report("iperf3", "intervals.*.streams.*", "end", 1.0, "rtt", 1e-6),
    # --json-stream: an event a line.
    Report("iperf3", "*.data.streams.*", "end", 1.0, "rtt", 1e-6),
    # A list of reports, or of lists of reports, as code gathers them.
    Report("WebRTC", "*", "timestamp", 1e-3, "currentRoundTripTime", 1.0),
    Report("WebRTC", "*.*", "timestamp", 1e-3, "currentRoundTripTime", 1.0),
)
"""The tools whose JSON is read."""

# Larger than any time in ns. JSON has whole numbers that no float has.
_LARGEST = 1e30

# A tool that has no delays of packets, and what it must be asked for instead.
_HINTS = {
    "intervals": "iperf3 has round trips only of TCP, at the sender: iperf3 -c HOST -J",
    "round_trips": "irtt client -o FILE HOST, without --stats-only",
}


def PacketsOfReport(contents: Any, origin: str) -> Packets | None:
    """Returns the packets of a report; None if it is of no known tool.

    Raises:
        ScenarioError: If a tool's report has no delays, or its numbers are not allowed.
    """
    for report in REPORTS:
        records = [x for x in _Follow(contents, report.records) if isinstance(x, dict)]
        has_delays = any(_First(record, report.delay) is not None for record in records)
        if has_delays:
            return _Packets(report, records, origin)
    if isinstance(contents, dict):
        for key, hint in _HINTS.items():
            if key in contents:
                raise ScenarioError(f"{origin}: must have delays of packets: {hint}")
    return None


def _Packets(report: Report, records: list[Any], origin: str) -> Packets:
    if report.tool == "WebRTC":
        records = _OfOnePair(records, report, origin)
    # What iperf3 omits precedes its test, and its clock begins anew.
    records = [x for x in records if not x.get("omitted")]
    times = [_Number(_First(x, report.time)) for x in records]
    if not all(map(math.isfinite, times)):
        raise ScenarioError(f"{origin}: {report.time}: must be a number in each record")
    first = times[0]
    sent = np.array([time - first for time in times]) * report.time_unit
    round_trips = np.array([_Delay(report, x) for x in records]) * report.delay_unit
    # iperf3 prints 0 where the system tells no round trip.
    if (round_trips < 0).any() or not (round_trips != 0).any():
        raise ScenarioError(f"{origin}: {report.delay}: must be >= 0, and not always 0")
    places = np.arange(len(sent)) + 1
    order = InOrder(sent, round_trips, sent + round_trips, origin, places)
    sent = sent[order]
    is_date = first * report.time_unit > 1e8
    return Packets(
        times=sent - sent[0],
        delays=round_trips[order] / 2,
        kind=HALVED,
        clock="date stamps" if is_date else "seconds",
        remarks=(f"JSON of {report.tool}",),
    )


def _OfOnePair(records: list[Any], report: Report, origin: str) -> list[Any]:
    """Returns the records of WebRTC that have a delay, of the pair that is in use.

    Reports have many kinds of records, and pairs of addresses that are only checked.
    """
    found = [x for x in records if _First(x, report.delay) is not None]
    names = sorted({str(x.get("id")) for x in found})
    if len(names) > 1:
        found = [x for x in found if x.get("nominated") or x.get("selected")]
        instants = {_First(x, report.time) for x in found}
        if not found or len(instants) < len(found):
            raise ScenarioError(
                f"{origin}: candidate pairs {', '.join(names)}: must have one at a "
                "time that is nominated; leave the others out"
            )
    return found


def _Delay(report: Report, record: Any) -> float:
    """Returns the delay of a record in the report's unit; NaN: lost."""
    # irtt tells `false`, or the direction in which the packet was lost.
    if report.lost and str(_First(record, report.lost)).startswith("true"):
        return math.nan
    return _Number(_First(record, report.delay))


def _Number(value: Any) -> float:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return value if is_number and abs(value) < _LARGEST else math.nan


def _First(contents: Any, path: str) -> Any:
    return next(_Follow(contents, path), None)


def _Follow(contents: Any, path: str) -> Iterator[Any]:
    """Yields what stands at a path."""
    if not path:
        yield contents
        return
    key, _, rest = path.partition(".")
    if key == "*":
        elements = list(contents.values()) if isinstance(contents, dict) else contents
        for element in elements if isinstance(elements, list) else ():
            yield from _Follow(element, rest)
    elif isinstance(contents, dict) and key in contents:
        yield from _Follow(contents[key], rest)

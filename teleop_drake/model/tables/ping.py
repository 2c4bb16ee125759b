"""What `ping` prints, on every system and in every language.

A line of an answer is known by its form, not by its words: a packet number and a time
in ms, as iputils, BSD, macOS, BusyBox, fping and hping print them, or, on Windows, a
time in ms and a TTL. What was read is checked against the summary that the file ends
with, so that lines of an unknown form are not left out in silence.

The delay one way is half of the round trip. Stamps before the answers, of `ping -D` or
of another program, are those of the arrival: the packet was sent a round trip earlier.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.framework.validation import (
    CheckNumber,
    Refuse,
    ScenarioError,
    Show,
)
from teleop_drake.model.tables.losses import Unwrapped
from teleop_drake.model.tables.measured import HALVED, Packets
from teleop_drake.model.tables.ping_stamps import SplitStamp, TimesOfStamps
from teleop_drake.model.tables.ping_summary import ParseTime, PingSummary, ReadSummary
from teleop_drake.model.tables.source import TableSource

# `icmp_seq=5`, `seq=5`, `icmp_seq 5`, `: [5],`
_SEQUENCE = re.compile(r"\b(?:icmp_)?seq[ =:]\s?(\d{1,15})\b|(?:^|\s): \[(\d{1,15})\],")
# `time=12.3 ms`, `Zeit=12,3 ms`, `tempo<1ms`, `84 bytes, 12.3 ms`
_ROUND_TRIP = re.compile(
    r"([=<,])\s?(\d+(?:[.,]\d+)?)\s?((?:ms|мс|us|usec|s|sec)\b|ミリ秒|毫秒)"
)
# `bytes=32 time=10ms TTL=57` in any language and code page, or `: time=10ms` of IPv6.
_WINDOWS = re.compile(
    r".*[=<]\s?\d+\s?[^\s\d]{1,6}\s+TTL\s?=\s?\d+.*"
    r"|[^=]*:\s[^=<]*[=<]\s?\d+\s?(?:ms|мс)\s*",
    re.IGNORECASE,
)
_BEFORE_TTL = re.compile(r"([=<])\s?(\d+)\s?[^\s\d]{1,6}\s+TTL", re.IGNORECASE)
# An answer begins with its number of bytes; a line that tells of a loss does not.
_BYTES = re.compile(r"\s*\d+\s")
# What differs between answers besides their stamps: `id=7`, `(12.3 avg, 0% loss)`.
_DETAILS = re.compile(r"\w+=\S+|\([^()]*\)")
# The heading: `PING a.example (192.0.2.1) 56(84) bytes of data.`, `Pinging 1.1.1.1 ...`
_HEADING = re.compile(r"^(PING6?\b|Pinging )", re.MULTILINE)
# BSD, macOS and BusyBox: `PING a.example (192.0.2.1): 56 data bytes`.
_COUNTS_FROM_0 = re.compile(r"^PING6?(?:\(| .*: \d+ )", re.MULTILINE)
# The number of lines at which IsPing() looks.
_INSPECTED = 200
# Packet numbers with more gaps than this are no numbers of packets.
_MOST_GAPS = 10_000
# The packets are this far apart, s, unless the file or the user tells otherwise.
_USUAL_INTERVAL = 1.0


@dataclass(frozen=True)
class Answer:
    """A line of an answer, or one that tells of a lost packet.

    Attributes:
        line: The number of the line.
        number: The number of the packet; None: the lines have none.
        round_trip: The round trip, ms; NaN: there was no answer.
        resolution: The value of the last digit of the round trip, ms.
        is_below: Whether the round trip was only told to be less than a bound.
        is_copy: Whether the line is marked as a further answer to the same packet.
        stamp: The text of the stamp before it; empty: there is none.
        rest: The line without numbers of this packet; an unknown stamp is in it.
    """

    line: int
    number: int | None
    round_trip: float
    resolution: float = 0.0
    is_below: bool = False
    is_copy: bool = False
    stamp: str = ""
    rest: str = ""

    @property
    def is_lost(self) -> bool:
        """Returns whether the line tells that there was no answer."""
        return math.isnan(self.round_trip)


def IsPing(text: str) -> bool:
    """Returns whether a text is what ping prints."""
    if _HEADING.search(text):
        return True
    for line in text.splitlines()[:_INSPECTED]:
        if _WINDOWS.fullmatch(line):
            return True
        if _SEQUENCE.search(line) and (_ROUND_TRIP.search(line) or "," not in line):
            return True
    return False


def PacketsOfPing(text: str, source: TableSource) -> Packets:
    """Returns the packets of what ping printed.

    Raises:
        ScenarioError: If there is no answer, or what was read disagrees with the
            summary of the file, or the clock was set back.
    """
    origin = source.origin
    if len(_HEADING.findall(text)) > 1:
        raise ScenarioError(f"{origin}: must be one run of ping; split the file")
    lines = [SplitStamp(line) for line in text.splitlines()]
    summary = ReadSummary([body for _, body in lines], origin)
    found = _Answers(lines[: summary.begin], origin)
    answers = [x for x in found if not x.is_lost]
    if not answers:
        number = summary.sent or len(found)
        if summary.received:
            raise ScenarioError(
                f"{origin}: must have a line for each answer, and has only the summary "
                f"of {number} packets: leave out -q"
            )
        raise ScenarioError(
            f"{origin}: must have packets that were answered, and none of its {number} "
            "was"
        )
    numbered = _Numbered(found, origin)
    numbers = _AllNumbers(numbered, summary, text, origin)
    _CheckSummary(answers, numbered, numbers, summary, origin)
    times, clock, remarks = _TimesSent(numbered, numbers, summary, source)
    delays = np.full(len(numbers), np.nan)
    for number, answer in numbered.items():
        delays[number - numbers[0]] = answer.round_trip / 2e3
    below = sum(answer.is_below for answer in answers)
    if below:
        remarks = (
            *remarks,
            f"{below} round trips below the resolution, taken as half of it",
        )
    return Packets(
        times=times - times[0],
        delays=delays,
        kind=HALVED,
        clock=clock,
        remarks=remarks,
    )


def _Answers(lines: Sequence[tuple[str, str]], origin: str) -> list[Answer]:
    """Returns the answers and the lost packets of the lines before the summary.

    Args:
        lines: The stamp and the rest of each line.
        origin: The beginning of messages.

    Raises:
        ScenarioError: If a line is neither.
    """
    answers = []
    is_windows = [_WINDOWS.fullmatch(body) is not None for _, body in lines]
    # On Windows, each line tells of a packet. The heading ends with a colon there, and
    # what precedes it is not of ping.
    begin = len(lines)
    if True in is_windows:
        first = is_windows.index(True)
        headings = [i for i in range(first) if _IsHeading(lines[i][1])]
        begin = headings[-1] + 1 if headings else 0
    for i, (stamp, body) in enumerate(lines):
        sequence = _SEQUENCE.search(body)
        number = int(sequence[1] or sequence[2]) if sequence else None
        is_loss = i >= begin and bool(body.strip())
        if not (sequence or is_windows[i] or is_loss):
            continue
        answer = _Answer(i + 1, number, body, stamp)
        is_cut = sequence is not None and sequence[1] and _BYTES.match(body)
        if answer.is_lost and (is_cut or (not sequence and re.search("[=<>]", body))):
            raise ScenarioError(
                f"{origin}: line {i + 1}, {Show(body.strip())}: must have a round trip "
                "with its unit, as time=12.3 ms, or tell of a lost packet"
            )
        answers.append(answer)
    return answers


def _IsHeading(body: str) -> bool:
    """Returns whether a line is the heading, which Windows ends with a colon."""
    return bool(_HEADING.match(body)) or body.rstrip().endswith(":")


def _Answer(line: int, number: int | None, body: str, stamp: str) -> Answer:
    found = _ROUND_TRIP.search(body) or _BEFORE_TTL.search(body)
    if found is None:
        return Answer(line, number, math.nan, stamp=stamp)
    unit = found[3] if found.re is _ROUND_TRIP else "ms"
    round_trip, resolution = ParseTime(found[2], unit)
    is_below = found[1] == "<"
    after = body[found.end() :]
    return Answer(
        line,
        number,
        round_trip / 2 if is_below else round_trip,
        resolution,
        is_below,
        # `(DUP!)`, in each language.
        is_copy=bool(re.match(r"\s*\((?!.*avg)", after)),
        stamp=stamp,
        rest=_DETAILS.sub("", _SEQUENCE.sub("", body[: found.start()]) + after),
    )


def _Numbered(found: Sequence[Answer], origin: str) -> dict[int, Answer]:
    """Returns the answer of each packet that the lines tell of, by its number.

    Of several answers the first counts, and an answer counts more than a line that
    says that there is none yet.
    """
    if found[0].number is None:
        return dict(enumerate(found, 1))
    numbered: dict[int, Answer] = {}
    numbers = Unwrapped([answer.number or 0 for answer in found]).tolist()
    for number, answer in zip(numbers, found, strict=True):
        known = numbered.get(number)
        if known is None or known.is_lost:
            numbered[number] = answer
        elif not answer.is_copy and not answer.is_lost:
            raise ScenarioError(
                f"{origin}: line {answer.line}: packet {number}: must be answered "
                f"once, and is in line {known.line}; if ping began anew, split the file"
            )
    return numbered


def _IsUnnumbered(numbered: Mapping[int, Answer]) -> bool:
    """Returns whether the lines have no numbers: each packet has one, as on Windows."""
    return next(iter(numbered.values())).number is None


def _AllNumbers(
    numbered: Mapping[int, Answer], summary: PingSummary, text: str, origin: str
) -> Indices:
    """Returns the numbers of all packets, those lost before and behind included."""
    first = min(numbered)
    last = max(numbered)
    if _HEADING.search(text):
        first = min(first, 0 if _COUNTS_FROM_0.search(text) else 1)
    if summary.sent is not None and not _IsUnnumbered(numbered):
        first = min(first, 1)
        last = max(last, first + summary.sent - 1)
    if last - first > _MOST_GAPS * len(numbered):
        raise ScenarioError(
            f"{origin}: packets {first} to {last}: must have fewer gaps, and only "
            f"{len(numbered)} are told of"
        )
    return np.arange(first, last + 1)


def _CheckSummary(
    answers: Sequence[Answer],
    numbered: Mapping[int, Answer],
    numbers: Indices,
    summary: PingSummary,
    origin: str,
) -> None:
    """Refuses packets that disagree with the summary of the file."""
    received = sum(not answer.is_lost for answer in numbered.values())
    # Windows counts what a router says as an answer of the host.
    most = len(numbers) if _IsUnnumbered(numbered) else received
    counts = (
        ("packets", len(numbers), len(numbers), summary.sent),
        ("answers", received, most, summary.received),
    )
    for name, count, largest, told in counts:
        if told is not None and not count <= told <= largest:
            raise ScenarioError(
                f"{origin}: {count} {name} were read, and ping's summary has {told}: "
                "must be the whole output of one run of ping"
            )
    if summary.mean is None:
        return
    mean = float(np.mean([answer.round_trip for answer in answers]))
    resolution = float(np.mean([answer.resolution for answer in answers]))
    if abs(mean - summary.mean) > summary.resolution + resolution:
        raise ScenarioError(
            f"{origin}: a mean round trip of {mean:.4g} ms was read, and ping's "
            f"summary has {summary.mean:g} ms: must be the whole output of one run"
        )


def _TimesSent(
    numbered: Mapping[int, Answer],
    numbers: Indices,
    summary: PingSummary,
    source: TableSource,
) -> tuple[Array, str, tuple[str, ...]]:
    """Returns when the packets were sent, s (N), the clock, and remarks."""
    interval = source.options.get("interval")
    answered = {k: x for k, x in numbered.items() if not x.is_lost}
    has_stamps = any(answer.stamp for answer in answered.values())
    if interval is None and has_stamps:
        return _TimesOfStamps(answered, numbers, summary, source.origin)
    if interval is not None:
        path = f"{source.path}.interval"
        CheckNumber(path, interval, "s", above=0)
        if summary.duration and len(numbers) > 1:
            told = summary.duration / (len(numbers) - 1)
            if abs(interval - told) > 0.1 * told:
                Refuse(path, interval, f"{told:.4g} (s), as ping's summary tells")
        how = "as given"
    elif summary.duration and len(numbers) > 1:
        interval = summary.duration / (len(numbers) - 1)
        how = "from ping's summary"
    else:
        _CheckNoStamps(list(answered.values()), source.origin)
        interval = _USUAL_INTERVAL
        how = "taken so: no stamps"
    return (
        (numbers - numbers[0]) * float(interval),
        f"packets {interval:.4g} s apart ({how})",
        (),
    )


def _CheckNoStamps(answers: Sequence[Answer], origin: str) -> None:
    """Refuses lines without a known stamp that differ as if they had another one."""
    if len({answer.rest for answer in answers}) > len(answers) / 2 > 0.5:
        first = answers[0]
        raise ScenarioError(
            f"{origin}: line {first.line}, {Show(first.rest.strip())}: must have a "
            "stamp in seconds since 1970, in ISO 8601 or with a time of day, or no "
            "stamp; write {file: ..., interval: ...} (s) to leave it aside"
        )


def _TimesOfStamps(
    answered: Mapping[int, Answer],
    numbers: Indices,
    summary: PingSummary,
    origin: str,
) -> tuple[Array, str, tuple[str, ...]]:
    """Returns when the packets were sent by the stamps of their answers."""
    by_line = sorted(answered, key=lambda number: answered[number].line)
    answers = [answered[number] for number in by_line]
    known = np.array(by_line)
    sent, clock, remarks = TimesOfStamps(
        [answer.stamp for answer in answers],
        np.array([answer.round_trip for answer in answers]) * 1e-3,
        known,
        np.array([answer.line for answer in answers]),
        origin,
    )
    order = np.argsort(known)
    known = known[order]
    # Round trips are rounded, so that packets may seem to overtake each other.
    sent = np.maximum.accumulate(sent[order])
    times = np.interp(numbers, known, sent)
    # Packets before the first answer and behind the last one have the mean distance.
    period = _USUAL_INTERVAL
    if len(known) > 1:
        period = float(sent[-1] - sent[0]) / float(known[-1] - known[0])
    times += np.minimum(numbers - known[0], 0) * period
    times += np.maximum(numbers - known[-1], 0) * period
    duration = float(times[-1] - times[0])
    told = summary.duration
    if told is not None and abs(duration - told) > 2.0 + 0.05 * told:
        raise ScenarioError(
            f"{origin}: the stamps tell of {duration:.4g} s, and ping's summary of "
            f"{told:.4g} s: must agree"
        )
    return times, clock, remarks

"""The summary at the end of what `ping` prints, in every language."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from teleop_drake.loops.framework.validation import ScenarioError, Show

MILLISECONDS = {
    **dict.fromkeys(("ms", "мс", "ミリ秒", "毫秒"), 1.0),
    **{"us": 1e-3, "usec": 1e-3, "s": 1e3, "sec": 1e3},
}
"""The units of times that ping prints, in ms."""

# The words differ from language to language; the numbers and their marks do not.
_FORMS = (
    # iputils, BSD, macOS, BusyBox, hping; some languages write `%20`:
    # 5 packets transmitted, 4 received, 20% packet loss, time 4005ms
    re.compile(
        r"[^\d=:[]*(\d+)[^\d=:[]*[,\uff0c\u3001][^\d=:[]*(\d+)[^\d=:[]*[,\uff0c\u3001]"
        r".*?(?:\d\s?%|%\s?\d)(.*)"
    ),
    # fping:
    # 1.1.1.1 : xmt/rcv/%loss = 10/9/10%, min/avg/max = 12.3/13.2/14.1
    re.compile(r".*\sxmt/rcv/%loss = (\d+)/(\d+)/\d+%(.*)"),
)
# Windows; some languages break the line:
# Packets: Sent = 4, Received = 3, Lost = 1 (25% loss),
_WINDOWS = re.compile(
    r"[^=]*=\s*(\d+)(?!\d|\s?ms|\s?мс)[^=]*=\s*(\d+)(?!\d|\s?ms|\s?мс)[^=]*"
    r"=\s*(\d+)\s*(?:\(.*)?"
)
# The heading of a summary, which is no line of an answer in any language.
_RULE = re.compile(r"\s*---")
_DURATION = re.compile(r"(\d+)\s?(?:ms\b|мс\b|ミリ秒|毫秒)")
_MEANS = (
    # rtt min/avg/max/mdev = 12.1/13.2/14.3/0.5 ms
    re.compile(
        r".*=\s*[\d.,]+/(\d+(?:[.,]\d+)?)/[\d.,]+(?:/[\d.,]+)*"
        r"(?:\s*(ms|мс|us|s)\b)?"
    ),
    # Minimum = 1ms, Maximum = 2ms, Average = 1ms
    re.compile(r"[^=]*=\s*\d+\D[^=]*=\s*\d+\D[^=]*=\s*(\d+)()\D"),
)


@dataclass(frozen=True, kw_only=True)
class PingSummary:
    """The summary of a run of ping; None: the text does not tell.

    Attributes:
        begin: The number of lines before it.
        sent: The number of packets sent.
        received: The number of packets that were answered.
        duration: The time from the first packet to the last one, s.
        mean: The mean round trip, ms.
        resolution: The value of the mean's last digit, ms.
    """

    begin: int
    sent: int | None = None
    received: int | None = None
    duration: float | None = None
    mean: float | None = None
    resolution: float = 0.0


def ReadSummary(lines: Sequence[str], origin: str) -> PingSummary:
    """Returns the summary of what ping printed.

    Raises:
        ScenarioError: If there is one, and its numbers are not found.
    """
    for i, line in enumerate(lines):
        for form in _FORMS:
            counts = form.fullmatch(line)
            if counts is not None:
                return _Summary(lines, i, counts[1], counts[2], counts[3])
        counts = _WINDOWS.fullmatch(line) or _WINDOWS.fullmatch(line + _After(lines, i))
        # The number of lost packets tells that these are the counts.
        if counts and int(counts[1]) == int(counts[2]) + int(counts[3]):
            return _Summary(lines, i, counts[1], counts[2], "")
    for i, line in enumerate(lines):
        if _RULE.match(line):
            raise ScenarioError(
                f"{origin}: line {i + 1}, {Show(line.strip())}: must be followed by "
                "the numbers of packets sent and received"
            )
    return PingSummary(begin=len(lines))


def _After(lines: Sequence[str], i: int) -> str:
    """Returns the line behind line i if that one tells a number, else nothing."""
    return "".join(lines[i + 1 : i + 2]) if "=" in lines[i] else ""


def _Summary(
    lines: Sequence[str], i: int, sent: str, received: str, rest: str
) -> PingSummary:
    """Returns the summary whose counts stand in line i, counted from 0."""
    duration = _DURATION.search(rest)
    mean = None
    resolution = 0.0
    for line in [rest, *lines[i + 1 :]]:
        for form in _MEANS:
            found = form.match(line)
            if found is not None and mean is None:
                mean, resolution = ParseTime(found[1], found[2] or "ms")
    return PingSummary(
        # A line with the address stands before the counts, except in fping's.
        begin=max(i - 1, 0) if lines[i - 1].strip() else i,
        sent=int(sent),
        received=int(received),
        duration=None if duration is None else int(duration[1]) * 1e-3,
        mean=mean,
        resolution=resolution,
    )


def ParseTime(digits: str, unit: str) -> tuple[float, float]:
    """Returns a time and the value of its last digit, ms."""
    digits = digits.replace(",", ".").rstrip(".")
    size = MILLISECONDS[unit]
    decimals = len(digits.partition(".")[2])
    return float(digits) * size, 10.0**-decimals * size

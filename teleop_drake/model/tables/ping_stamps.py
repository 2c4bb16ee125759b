"""The stamps before the lines of `ping`, and the times at which packets were sent."""

import re
from collections.abc import Sequence

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.tables.measured import SET_BACK, ShowTime
from teleop_drake.model.tables.stamps import ReadTimes

# Times since 1970 in s (`ping -D`), ms, us or ns, a date, or a date of any form with a
# time of day. No colon may stand before that one, so that it is no part of an IPv6
# address.
_STAMPS = (
    re.compile(r"\s*\[?(\d{9,10}(?:[.,]\d+)?|\d{13}|\d{16}|\d{19})\]?[,;:]?\s"),
    re.compile(
        r"\s*\[?(\d{4}[-/]\d\d[-/]\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?"
        r"\s?(?:Z|UTC|[+-]\d\d:?\d\d)?)\]?[,;:]?\s"
    ),
    re.compile(r"[^:]{0,30}?\b(\d{1,2}:\d\d:\d\d(?:[.,]\d+)?(?: [AP]M)?)(?![:\w.])"),
)

# Stamps of which fewer than this share differ are those of a coarse clock, or of a
# program that was handed many lines at once.
_LEAST_DIFFERENT = 0.6


def SplitStamp(line: str) -> tuple[str, str]:
    """Returns the stamp before a line of ping, empty if there is none, and the rest."""
    for form in _STAMPS:
        found = form.match(line)
        if found:
            return found[1], line[found.end() :]
    return "", line


def TimesOfStamps(
    stamps: Sequence[str],
    round_trips: Array,
    numbers: Indices,
    lines: Indices,
    origin: str,
) -> tuple[Array, str, tuple[str, ...]]:
    """Returns when the answered packets were sent, s, the clock, and remarks.

    Args:
        stamps: The stamps of the answers, in the order of the lines (N).
        round_trips: Their round trips, s (N).
        numbers: The numbers of their packets (N).
        lines: The numbers of their lines (N).
        origin: The beginning of messages.

    Raises:
        ScenarioError: If an answer has no stamp, or a clock was set back.
    """
    import pandas

    for stamp, line in zip(stamps, lines, strict=True):
        if not stamp:
            raise ScenarioError(
                f"{origin}: line {line}: must have a stamp, as other answers have"
            )
    texts = pandas.Series([stamp.replace(",", ".") for stamp in stamps], dtype=object)
    read = ReadTimes(texts, "", f"{origin}: stamps", lines)
    steps = np.diff(read.seconds)
    if (steps < 0).any():
        i = int(np.argmin(steps)) + 1
        raise ScenarioError(
            f"{origin}: line {lines[i]}: must not be earlier than the answer before, "
            f"and is by {ShowTime(-steps[i - 1])}; {SET_BACK}"
        )
    if len(np.unique(read.seconds)) < _LEAST_DIFFERENT * len(stamps):
        period = read.seconds[-1] / max(float(numbers[-1] - numbers[0]), 1.0)
        remark = f"coarse stamps: packets {period:.4g} s apart, their mean"
        return (numbers - numbers[0]) * period, read.clock, (remark,)
    return read.seconds - round_trips, read.clock, ()

"""Measures the claims again, and compares them with the published ledger.

published.csv has the verdict and our value of each claim, as found by this version of
the package. The comparison shows whether another machine gives the same results.
"""

import csv
import re
import time
from collections.abc import Iterator, Sequence
from importlib import resources
from typing import NamedTuple

from teleop_drake.loops.framework.validation import Choices, ScenarioError
from teleop_drake.thesis.claims.claim import Row
from teleop_drake.thesis.report import CLAIMS
from teleop_drake.thesis.runs import ThesisRuns

TOLERANCE = 0.01
"""The relative difference that is allowed between a number and the published one."""

# The largest rounding error of a published 0 on another processor, in any unit.
_ZERO = 1e-9

_NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")


class Checked(NamedTuple):
    """A claim that was measured again.

    Attributes:
        key: The claim's short name.
        expected, found: Verdict and value, as published and as found now.
        seconds: The time that it took, including its runs, s.
        passes: Whether they agree.
    """

    key: str
    expected: str
    found: str
    seconds: float
    passes: bool


def Outcome(row: Row) -> str:
    """Returns the verdict and our value of a claim as one text."""
    return f"{row.verdict}: {row.ours}"


def Published() -> dict[str, str]:
    """Returns the published outcome of each claim, by the claims' keys."""
    text = (resources.files(__package__) / "published.csv").read_text("utf-8")
    return {row["key"]: row["outcome"] for row in csv.DictReader(text.splitlines())}


def Agree(expected: str, found: str) -> bool:
    """Returns whether two outcomes have equal words, and numbers within TOLERANCE."""
    if _NUMBER.sub("", expected) != _NUMBER.sub("", found):
        return False
    pairs = zip(_NUMBER.findall(expected), _NUMBER.findall(found), strict=True)
    for text, other in pairs:
        number = float(text)
        # A printed number is rounded: half of its last digit is no difference.
        digits = len(text.partition(".")[2])
        rounding = 0.5 * 10.0**-digits if digits and "e" not in text else 0.0
        if number == 0:
            rounding = max(rounding, _ZERO)
        if abs(float(other) - number) > TOLERANCE * abs(number) + rounding:
            return False
    return True


def CheckClaims(
    keys: Sequence[str] | None = None, runs: ThesisRuns | None = None
) -> Iterator[Checked]:
    """Yields each claim as soon as it is measured.

    Args:
        keys: The keys of the claims; None: all claims.
        runs: The runs to measure; None: they are simulated here.

    Raises:
        ScenarioError: If there is no such claim.
    """
    published = Published()
    for key in keys or ():
        if key not in published:
            raise ScenarioError(f"claim = {key!r}: must be {Choices(key, published)}")
    runs = runs or ThesisRuns()
    for claim in CLAIMS:
        if keys is not None and claim.key not in keys:
            continue
        begin = time.perf_counter()
        found = Outcome(claim.Judge(runs))
        seconds = time.perf_counter() - begin
        expected = published[claim.key]
        passes = Agree(expected, found)
        yield Checked(claim.key, expected, found, seconds, passes)

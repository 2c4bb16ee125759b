"""The claims of chapters 3 to 6, each measured on runs and given a verdict.

So are claims of our own on what section 6.3 leaves to future work.

A claim with a number is `reproduced` if our number is within the tolerance, and
`refuted` if not. It is `reproduced in kind` if what the number stands for holds
although the number is another, or if fields of the scenario were fitted to it. A claim
without a number is turned into a criterion that can be measured; it is `reproduced` if
the criterion holds and `refuted` if not. Where no run can decide, it is `not
determinable`. No verdict is written down anywhere: each follows from recordings and
linear models.
"""

from collections.abc import Sequence

from teleop_drake.thesis.claims.alternatives import Alternatives
from teleop_drake.thesis.claims.chapter3 import Chapter3
from teleop_drake.thesis.claims.chapter4 import Chapter4
from teleop_drake.thesis.claims.chapter5 import Chapter5
from teleop_drake.thesis.claims.claim import Row
from teleop_drake.thesis.claims.conclusions import Conclusions
from teleop_drake.thesis.claims.evidence import Evidence
from teleop_drake.thesis.claims.future_work import (
    EXTENSION_REQUESTS,
    LEARNING_REQUESTS,
    Extensions,
    Learning,
)
from teleop_drake.thesis.claims.requests import REQUESTS, Alike
from teleop_drake.thesis.runs import ThesisRuns


def Ledger(runs: ThesisRuns) -> list[Row]:
    """Returns a row for each claim of chapters 3 to 6, in the thesis's order.

    The rows of plain alternatives come last; their keys begin with "A-".
    """
    runs.Prefetch([*REQUESTS, *Alike()])
    evidence = Evidence(runs)
    return [
        *Chapter3(evidence),
        *Chapter4(evidence),
        *Chapter5(evidence),
        *Conclusions(evidence),
        *Alternatives(evidence),
    ]


def FutureWork(runs: ThesisRuns) -> list[Row]:
    """Returns a row for each claim on future work; their keys begin with "F-"."""
    runs.Prefetch([*REQUESTS, *LEARNING_REQUESTS, *EXTENSION_REQUESTS])
    evidence = Evidence(runs)
    return [*Learning(evidence), *Extensions(evidence)]


_SHORT_KEYS = (
    "4-direct-overshoot",
    "4-adaptive-overshoot",
    "4-direct-largest-force",
    "4-no-start-overshoot",
    "4-settling",
    "5-I-direct-diverges",
    "5-II-lower-first-impact",
    "5-III-lower-first-impact",
    "6-higher-delays",
    "A-adaptation-matters",
)


def ShortLedger(rows: Sequence[Row]) -> str:
    """Returns the ten most telling rows as a Markdown table.

    Args:
        rows: The whole ledger.

    Raises:
        KeyError: If one of the ten is missing.
    """
    by_key = {row.key: row for row in rows}
    lines = ["| thesis | claim | printed | here | verdict |", "|---|---|---|---|---|"]
    for key in _SHORT_KEYS:
        row = by_key[key]
        cells = (row.place, row.claim, row.thesis, row.ours, row.verdict)
        lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    return "\n".join(lines) + "\n"

"""The claims of chapters 3 to 6, each measured on runs and given a verdict.

A claim with a number is `reproduced` if our number is within the tolerance, and
`refuted` if not. It is `reproduced in kind` if what the number stands for holds
although the number is another, or if fields of the scenario were fitted to it. A claim
without a number is turned into a criterion that can be measured; it is `reproduced` if
the criterion holds and `refuted` if not. Where no run can decide, it is `not
determinable`. No verdict is written down anywhere: each follows from recordings and
linear models.
"""

from collections.abc import Sequence

from teleop_drake.thesis.claims import chapter3, chapter4, chapter5, conclusions
from teleop_drake.thesis.claims.claim import LoadClaims, Row
from teleop_drake.thesis.runs import ThesisRuns

MODULES = (chapter3, chapter4, chapter5, conclusions)
"""What measures the claims, in the thesis's order."""


def Ledger(runs: ThesisRuns, only: str = "") -> list[Row]:
    """Returns a row for each claim, in the thesis's order.

    Args:
        only: The beginning of the keys of the claims, such as "4-"; empty: all.
    """
    claims = (claim for claim in LoadClaims() if claim.key.startswith(only))
    return [claim.Judge(runs) for claim in claims]


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
    "6-adaptation-matters",
)


def ShortLedger(rows: Sequence[Row]) -> str:
    """Returns the ten most telling rows of a whole ledger as a Markdown table."""
    by_key = {row.key: row for row in rows}
    lines = ["| thesis | claim | printed | here | verdict |", "|---|---|---|---|---|"]
    for key in _SHORT_KEYS:
        row = by_key[key]
        cells = (row.place, row.claim, row.thesis, row.ours, row.verdict)
        lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    return "\n".join(lines) + "\n"

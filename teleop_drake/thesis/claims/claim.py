"""A claim of the thesis, what was measured, and the verdict."""

import math
from dataclasses import dataclass

import numpy as np

REPRODUCED = "reproduced"
IN_KIND = "reproduced in kind"
REFUTED = "refuted"
NOT_DETERMINABLE = "not determinable"
VERDICTS = (REPRODUCED, IN_KIND, REFUTED, NOT_DETERMINABLE)
"""Every verdict, the best first."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One claim. Every field is text.

    Attributes:
        key: Short name, unique.
        place: Where the thesis makes the claim.
        claim: The claim, in our words.
        criterion: What is measured, and what it must be for the claim to hold.
        thesis: The thesis's value, or "no number".
        ours: Our value.
        tolerance: By how much ours may differ; for a criterion "as stated".
        verdict: One of VERDICTS.
        reason: Why, where the numbers alone do not tell.
    """

    key: str
    place: str
    claim: str
    criterion: str
    thesis: str
    ours: str
    tolerance: str
    verdict: str
    reason: str


def Truth(
    key: str,
    place: str,
    claim: str,
    criterion: str,
    holds: bool | np.bool_ | None,
    ours: str,
    reason: str,
) -> Row:
    """Returns the row of a claim without a number; None: no run can decide."""
    verdict = REPRODUCED if holds else REFUTED
    if holds is None:
        verdict = NOT_DETERMINABLE
    return Row(
        key=key,
        place=place,
        claim=claim,
        criterion=criterion,
        thesis="no number",
        ours=ours,
        tolerance="as stated",
        verdict=verdict,
        reason=reason,
    )


def Number(
    key: str,
    place: str,
    claim: str,
    thesis: float,
    ours: float,
    tolerance: float,
    unit: tuple[float, str],
    in_kind: tuple[bool | np.bool_, str],
    reason: str,
    *,
    is_absolute: bool = False,
) -> Row:
    """Returns the row of a number.

    Args:
        key: See Row.
        place: See Row.
        claim: See Row.
        thesis: The thesis's value.
        ours: Our value.
        tolerance: Relative, or absolute in the unit shown.
        unit: (how many of the unit shown there are in one SI unit, its symbol).
        in_kind: Whether the statement that the number stands for holds, and it.
        reason: See Row.
        is_absolute: Whether the tolerance is absolute.
    """
    scale, symbol = unit
    width = tolerance / scale if is_absolute else tolerance * abs(thesis)
    if abs(ours - thesis) <= width:
        verdict = REPRODUCED
    else:
        verdict = IN_KIND if in_kind[0] else REFUTED
    shown = f"{tolerance:g} points" if is_absolute else f"{100 * tolerance:g} %"
    return Row(
        key=key,
        place=place,
        claim=claim,
        criterion=f"the number within the tolerance; in kind: {in_kind[1]}",
        thesis=f"{scale * thesis:.4g} {symbol}",
        ours=f"{scale * ours:.4g} {symbol}" if math.isfinite(ours) else "none",
        tolerance=shown,
        verdict=verdict,
        reason=reason,
    )

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


def Statement(
    *,
    key: str,
    place: str,
    claim: str,
    criterion: str,
    holds: bool | np.bool_ | None,
    ours: str,
    reason: str = "",
) -> Row:
    """Returns the row of a claim without a number.

    `holds` says whether our runs meet the criterion; None: no run can decide.
    """
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


def PrintedNumber(
    *,
    key: str,
    place: str,
    claim: str,
    printed: float,
    ours: float,
    unit: tuple[float, str],
    tolerance: float,
    in_kind: str,
    is_in_kind: bool | np.bool_,
    reason: str = "",
    is_absolute: bool = False,
    is_fitted: bool = False,
) -> Row:
    """Returns the row of a number that the thesis prints.

    `printed` and `ours` are in SI units; `unit` is how many of the unit shown there are
    in one SI unit, and its symbol. The tolerance is relative, or absolute in the unit
    shown. `in_kind` is the statement that the number stands for, and `is_in_kind`
    whether it holds. A number to which fields of the scenario were fitted is
    reproduced in kind at best.
    """
    scale, symbol = unit
    width = tolerance / scale if is_absolute else tolerance * abs(printed)
    verdict = IN_KIND if is_in_kind else REFUTED
    if abs(ours - printed) <= width:
        verdict = IN_KIND if is_fitted else REPRODUCED
    return Row(
        key=key,
        place=place,
        claim=claim,
        criterion="the number within the tolerance"
        + (", to which fields were fitted" if is_fitted else "")
        + f"; in kind: {in_kind}",
        thesis=f"{scale * printed:.4g} {symbol}",
        ours=f"{scale * ours:.4g} {symbol}" if math.isfinite(ours) else "none",
        tolerance=f"{tolerance:g} points" if is_absolute else f"{100 * tolerance:g} %",
        verdict=verdict,
        reason=reason,
    )

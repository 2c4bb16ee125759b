"""A claim of the thesis, its measurement and its verdict.

The claims themselves are in the modules of the chapters, beside their measures.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from teleop_drake.thesis.claims.measures import UnlearnedShare
from teleop_drake.thesis.claims.relation import SCALES, Axes, Compare, Relation
from teleop_drake.thesis.runs import ADAPTIVE, Both, ThesisRuns

REPRODUCED = "reproduced"
IN_KIND = "reproduced in kind"
REFUTED = "refuted"
NOT_DETERMINABLE = "not determinable"
VERDICTS = (REPRODUCED, IN_KIND, REFUTED, NOT_DETERMINABLE)
"""Every verdict, the best first."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One claim and its verdict. Every field is text.

    Attributes:
        key: Short name, unique.
        place: Where the thesis makes the claim.
        claim: The claim, in our words.
        criterion: The condition on measured values under which the claim holds.
        thesis: The thesis's value, or "no number".
        ours: Our value.
        difference: How far our number is from the thesis's; empty without a number.
        tolerance: The allowed difference of our value; "as stated" for a criterion.
        verdict: One of VERDICTS.
        reason: An explanation, where the numbers are not enough.
        runs: The commands of the runs that were measured, a line each.
    """

    key: str
    place: str
    claim: str
    criterion: str
    thesis: str
    ours: str
    difference: str
    tolerance: str
    verdict: str
    reason: str
    runs: str


class Found(NamedTuple):
    """The result of a measure.

    Attributes:
        holds: Whether the criterion holds or, if the thesis prints a number, the
            relation Claim.in_kind. None: no run can decide.
        ours: Our value: text, or a number in SI units if the thesis prints a number.
        reason: A text to add to the claim's own reason.
    """

    holds: bool | np.bool_ | None
    ours: str | float
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A claim before it is measured; see Row.

    Its relations are evaluated here and in the executable thesis. With a measure of its
    own, it is judged here only.

    Attributes:
        task: The scenario whose runs with both controllers the relations compare.
        relations: The relations that all have to hold.
        measure: The function that measures the claim in the place of relations.
        remark: A function that returns a text to add to the reason.
        shown: Of a printed number, what stands for it in the first relation: the metric
            of the run `direct` or `adaptive`, or the `reduction` by the latter.
        printed: The thesis's number, in `unit`; None: there is a criterion instead.
        tolerance: The tolerance of the number: "5 %" of it, or "5 points" of the unit.
        in_kind: The relation for which the number stands, in words.
        fitted: Whether fields of the scenario were fitted to it, so that it is
            reproduced in kind at best.
    """

    key: str
    place: str
    claim: str
    task: str = ""
    relations: Sequence[Relation] = ()
    measure: Callable[[ThesisRuns], Found] | None = None
    remark: Callable[[ThesisRuns], str] | None = None
    shown: str = ""
    criterion: str = ""
    reason: str = ""
    printed: float | None = None
    unit: str = ""
    tolerance: str = "as stated"
    in_kind: str = ""
    fitted: bool = False

    def Measure(self, runs: ThesisRuns) -> Found:
        """Measures the claim on runs."""
        if self.measure is not None:
            return self.measure(runs)
        both = Compared(runs, self.task)
        holds = all(relation.Holds(both) for relation in self.relations)
        ours: str | float = Compare(self.relations, both)
        if self.printed is not None:
            direct, adaptive = both.Numbers(self.relations[0].metric)
            reduction = 1 - adaptive / direct
            values = {"direct": direct, "adaptive": adaptive, "reduction": reduction}
            ours = values[self.shown]
        return Found(holds, ours, "" if self.remark is None else self.remark(runs))

    def Judge(self, runs: ThesisRuns) -> Row:
        """Measures the claim on runs, and returns its row of the ledger."""
        runs.used.clear()
        found = self.Measure(runs)
        verdict = REPRODUCED if found.holds else REFUTED
        if found.holds is None:
            verdict = NOT_DETERMINABLE
        criterion = self.criterion
        thesis = "no number"
        ours = str(found.ours)
        difference = ""
        # If the thesis prints a number, its tolerance is decisive before `holds`.
        if self.printed is not None:
            number = SCALES[self.unit] * float(found.ours)
            verdict = IN_KIND if found.holds else REFUTED
            if abs(number - self.printed) <= self.width:
                verdict = IN_KIND if self.fitted else REPRODUCED
            criterion = "the number within the tolerance"
            criterion += ", to which fields were fitted" if self.fitted else ""
            criterion += f"; in kind: {self.in_kind}"
            thesis = f"{self.printed:.4g} {self.unit}"
            ours = f"{number:.4g} {self.unit}" if math.isfinite(number) else "none"
            difference = self.Difference(number) + ", fitted" * self.fitted
        return Row(
            key=self.key,
            place=self.place,
            claim=self.claim,
            criterion=criterion,
            thesis=thesis,
            ours=ours,
            difference=difference,
            tolerance=self.tolerance,
            verdict=verdict,
            reason=" ".join(filter(None, (self.reason, found.reason))),
            runs="\n".join(runs.used),
        )

    def Difference(self, number: float) -> str:
        """Returns how far a number in `unit` is from the thesis's, in words."""
        assert self.printed is not None
        if not math.isfinite(number):
            return "no number"
        if self.unit == "%":
            return f"{number - self.printed:+.2g} points"
        ratio = number / self.printed
        if ratio <= 0:
            return "of the other sign"
        if 0.5 < ratio < 2:
            return f"{100 * (ratio - 1):+.2g} %"
        return f"{ratio:.2g} times the thesis's"

    @property
    def width(self) -> float:
        """The allowed difference of our number from the thesis's, in `unit`."""
        assert self.printed is not None
        size, kind = self.tolerance.split()
        return float(size) * (abs(self.printed) / 100 if kind == "%" else 1.0)


def Compared(runs: ThesisRuns, task: str) -> Both:
    """Returns both runs of a task; in case I their parts inside the workspace."""
    both = runs.OfBoth(task)
    if task != "two_dof_puncture":
        return both
    return Both(both.direct.inside, both.adaptive.inside)


def NetworksLearn(runs: ThesisRuns, task: str) -> Found:
    """Measures whether the third network leaves less than half of dF_e/dt unlearned."""
    share = UnlearnedShare(runs(task, ADAPTIVE).recording)
    return Found(share < 0.5, f"{share:.1%} unlearned")


# The text of numbers in the rows.


def Shares(values: np.ndarray, axes: str = "xy") -> str:
    """Returns one share per axis in per cent."""
    return Axes(values, axes, ".1%")


def Seconds(time: float | None) -> str:
    """Returns a time in seconds, "never" if there is none."""
    return "never" if time is None else f"{time:.3g} s"


def Listed(values: Iterable[float]) -> str:
    """Returns numbers with commas between them."""
    return ", ".join(f"{value:.3g}" for value in values)

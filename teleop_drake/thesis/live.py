"""The data of the report's live figures: for simulating, and for judging claims.

The figures of a task share three modules of WebAssembly: those of the thesis's two
controllers, and that of a plain damper, which the thesis does not have.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from teleop_drake.loops.framework.arrays import Interval, Record
from teleop_drake.study.page.page import MakePage
from teleop_drake.thesis.claims.claim import Claim

_BONE_DAMPING = "environment.layers.bone.damping"
_END_OF_TISSUE = "environment.layers.free.start"

SLIDERS: dict[str, dict[str, Interval]] = {
    "one_dof": {
        "controller.initial_psi": (0.5, 8.0),
        "controller.adaptation_rate": (0.0, 20.0),
        "robot.damping": (0.0, 1.0),
    },
    "two_dof_puncture": {
        "controller.G1": (1.0, 10.0),
        "controller.adaptation_rate": (0.0, 20.0),
        _END_OF_TISSUE: (1.0, 1.25),
    },
    "two_dof_collision": {
        "controller.G1": (1.0, 10.0),
        "controller.G2": (5.0, 80.0),
        _BONE_DAMPING: (0.0, 5.0),
    },
    "two_dof_combined": {
        "controller.adaptation_rate": (0.0, 20.0),
        _END_OF_TISSUE: (0.9, 1.08),
        _BONE_DAMPING: (0.0, 5.0),
    },
}
"""The numbers of each task, beside the delays, that have a slider, with their ranges.

The verdicts on the claims of the task depend on them.
"""

# The thesis's controllers, by which claims are judged, and the plainest other one.
_KINDS = ("direct_force", "adaptive_backstepping", "damped_force")

_AGAINST_COMMAND = {"controller.damped_force.against": "command"}

# The titles of the controllers that are not called by their kinds.
_TITLES = {"damped_force": "damper"}

# The figure beside which a claim is shown that names no figure, by the first letters of
# the claim's key.
_FIRST_FIGURES = {"4-": "4.1", "5-II-": "5.7", "5-III-": "5.14", "5-": "5.1"}


def FigureOf(claim: Claim) -> str:
    """Returns the number of the figure beside which a claim is shown; "" if none."""
    named = re.search(r"Fig\. (\d\.\d+)", claim.place)
    if named is not None:
        return named[1]
    firsts = (x for key, x in _FIRST_FIGURES.items() if claim.key.startswith(key))
    return next(firsts, "")


def Laboratory(task: str, claims: Sequence[Claim]) -> Record:
    """Returns the data of a task for the report's script.

    These are its inputs and controllers, see DataOfRuns(), and the
    claims beside its figures.
    """
    page = MakePage(
        task, controllers=_KINDS, vary=SLIDERS[task], overrides=_AGAINST_COMMAND
    )
    data = page.data
    sliders = [x for x in data["inputs"] if not x["isField"]]
    names = {x["name"] for x in sliders}
    return {
        "name": task,
        "inputs": sliders,
        # The report shows no block diagrams, and so no fields.
        "controllers": [
            {
                **loop,
                "levels": [],
                "title": _TITLES.get(loop["kind"], loop["title"]),
                "changes": {x: y for x, y in loop["changes"].items() if x in names},
            }
            for loop in data["controllers"]
        ],
        "claims": [*map(_Criterion, claims)],
    }


def _Criterion(claim: Claim) -> Mapping[str, Any]:
    """Returns the data of a claim for judge.js; without relations it is judged here."""
    relations = () if claim.measure else claim.relations
    return {
        "key": claim.key,
        "unit": claim.unit,
        "printed": claim.printed,
        "shown": claim.shown,
        "in_kind": claim.in_kind,
        "relations": [relation._asdict() for relation in relations],
    }

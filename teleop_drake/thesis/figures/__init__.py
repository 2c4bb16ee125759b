"""The figures of the thesis, made anew from simulations that run then and there.

Each has the number that it has in the thesis and shows the same quantities. Units have
SI prefixes where that makes them readable.
"""

from teleop_drake.thesis.figures import chapter2, chapter3
from teleop_drake.thesis.figures.comparisons import QUANTITIES, ComparisonFigure
from teleop_drake.thesis.figures.figure import ThesisFigure
from teleop_drake.thesis.figures.learned import LearnedFigure

# By the number of the first figure of a task of chapters 4 and 5: its name, and what
# happens in it.
_TASKS = {
    "4.1": (
        "one_dof",
        "The slider of chapter 4 goes through tissue into free space and on to bone.",
    ),
    "5.1": (
        "two_dof_puncture",
        "Planar arm, case I: through tissue into free space.",
    ),
    "5.7": (
        "two_dof_collision",
        "Planar arm, case II: through free space on to bone.",
    ),
    "5.14": (
        "two_dof_combined",
        "Planar arm, case III: through tissue into free space and on to bone.",
    ),
}


def _TaskFigures(first: str) -> list[ThesisFigure]:
    """Returns the figures of a task, whose numbers follow one another."""
    task, about = _TASKS[first]
    chapter, start = map(int, first.split("."))
    # The position is shown of the tasks of the arm with a collision.
    comparisons = [
        name for name in QUANTITIES if name != "position" or first in ("5.7", "5.14")
    ]
    return [
        (ComparisonFigure if quantity in QUANTITIES else LearnedFigure)(
            number=f"{chapter}.{start + i}", task=task, about=about, quantity=quantity
        )
        for i, quantity in enumerate([*comparisons, "weights_1", "psi", "weights_3"])
    ]


FIGURES: dict[str, ThesisFigure] = {
    figure.number: figure
    for figure in [
        *chapter2.FIGURES,
        *chapter3.FIGURES,
        *(figure for first in _TASKS for figure in _TaskFigures(first)),
    ]
}
"""All figures by their number, in the thesis's order."""

"""The figures of the thesis, made anew from simulations that run then and there.

Each has the number that it has in the thesis and shows the same quantities. Units have
SI prefixes where that makes them readable. Chapter 6 of the thesis has no figures;
those with its number are ours.
"""

from teleop_drake.thesis.figures import chapter2, chapter3, future_work
from teleop_drake.thesis.figures.comparisons import ComparisonFigure
from teleop_drake.thesis.figures.figure import ThesisFigure
from teleop_drake.thesis.figures.learned import LearnedFigure

# What happens in each task of chapters 4 and 5.
_TASKS = {
    "one_dof": "The slider of chapter 4 goes through tissue into free space and on to "
    "bone.",
    "two_dof_puncture": "Planar arm, case I: through tissue into free space.",
    "two_dof_collision": "Planar arm, case II: through free space on to bone.",
    "two_dof_combined": "Planar arm, case III: through tissue into free space and on "
    "to bone.",
}

# By task of chapters 4 and 5: number of the figure for each quantity.
_NUMBERS = {
    "one_dof": {
        "velocity": "4.1",
        "sensed_force": "4.2",
        "control_force": "4.3",
        "weights_1": "4.4",
        "psi": "4.5",
        "weights_3": "4.6",
    },
    "two_dof_puncture": {
        "velocity": "5.1",
        "sensed_force": "5.2",
        "control_force": "5.3",
        "weights_1": "5.4",
        "psi": "5.5",
        "weights_3": "5.6",
    },
    "two_dof_collision": {
        "velocity": "5.7",
        "sensed_force": "5.8",
        "position": "5.9",
        "control_force": "5.10",
        "weights_1": "5.11",
        "psi": "5.12",
        "weights_3": "5.13",
    },
    "two_dof_combined": {
        "velocity": "5.14",
        "sensed_force": "5.15",
        "position": "5.16",
        "control_force": "5.17",
        "weights_1": "5.18",
        "psi": "5.19",
        "weights_3": "5.20",
    },
}

_LEARNED = ("weights_1", "psi", "weights_3")

FIGURES: dict[str, ThesisFigure] = {
    figure.number: figure
    for figure in [
        *chapter2.FIGURES,
        *chapter3.FIGURES,
        *(
            (LearnedFigure if quantity in _LEARNED else ComparisonFigure)(
                number=number, task=task, about=_TASKS[task], quantity=quantity
            )
            for task, numbers in _NUMBERS.items()
            for quantity, number in numbers.items()
        ),
        *future_work.FIGURES,
    ]
}
"""All figures by their number, in the thesis's order."""

"""Gains by search, each generation of which is a sweep.

Gains are tried together on all training runs: every run of a study, several scenarios,
delays, values and seeds. For each metric that is minimised, a set of gains has a score,

    the mean over all runs of (metric)/(mean over the scenario's runs of it, with the
    reference gains),

and the reference gains are the scenario's own, or, if these are not accepted, the first
that are. With weights, the goal is the weighted sum of the scores. Without, several
goals in turn look for a Pareto front: the largest score, and then the largest with one
score weighing five times as much as the others.

Gains are accepted if every run with them goes on to its end and has a value of each
metric. A time that a run does not have, because it never settles for example, counts as
the run's duration. With a margin, every loop of every training run also has to stay
stable, by analysis, if the round trip becomes that much longer.

The search is differential evolution from a Sobol' sequence (scipy), on logarithmic
ranges where these are positive. Gains are rounded to four digits.
"""

from teleop_drake.sweep.tuning.analyses import STIFFNESS_LOSS
from teleop_drake.sweep.tuning.plan import PlanTuning, TuningPlan
from teleop_drake.sweep.tuning.result import TuningResult
from teleop_drake.sweep.tuning.search import RunTuning, Tune
from teleop_drake.sweep.tuning.trials import Trial

__all__ = [
    "STIFFNESS_LOSS",
    "PlanTuning",
    "RunTuning",
    "Trial",
    "Tune",
    "TuningPlan",
    "TuningResult",
]

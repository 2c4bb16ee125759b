"""The search for gains, in which each generation of gains is a sweep.

Each set of gains is tried in all training runs: every run of a study, with its
scenarios, delays, values and seeds. A set of gains has a score for each metric that is
minimised. The score is the mean, over all runs, of the metric divided by its mean over
the runs of the same scenario with the reference gains. The reference gains are the
scenario's own or, if these are not accepted, the first accepted gains.

With weights, the goal is the weighted sum of the scores. Without weights, the search
looks for a Pareto front by several goals in turn: first the largest score, then for
each metric the largest score when its own is multiplied by five.

Gains are accepted if every run reaches its end and has a value of each metric. A time
that a run does not have, for example because it never settles, counts as the run's
duration. With a margin, every loop of every training run also has to remain stable, by
analysis, if the round trip becomes longer by the margin.

The search is differential evolution from a Sobol' sequence (scipy), on logarithmic
ranges where these are positive. Gains are rounded to four digits.
"""

from teleop_drake.study.sweep.tuning.plan import STIFFNESS_LOSS, PlanTuning, TuningPlan
from teleop_drake.study.sweep.tuning.result import TuningResult
from teleop_drake.study.sweep.tuning.search import RunTuning, Tune
from teleop_drake.study.sweep.tuning.trials import Trial

__all__ = [
    "STIFFNESS_LOSS",
    "PlanTuning",
    "RunTuning",
    "Trial",
    "Tune",
    "TuningPlan",
    "TuningResult",
]

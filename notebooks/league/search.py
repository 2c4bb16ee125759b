"""The search for gains in the league of architectures, by a cost common to all.

A set of gains is tried in the seven training runs of the study `league`. Its cost is
the sum of four terms, each a mean over the runs and at most 10, as in a run that
diverges, never comes to the bone or never rests:

    rest     time from the contact until tool and force are at rest, in s
    late     time by which the tool comes to the bone later than commanded, or earlier,
             which is an overshoot, in s
    impact   largest force on the bone, in multiples of that of a free mass which meets
             the bone with the commanded speed
    loss     share of the bone's stiffness that the hand does not feel, mean of
             |1 - k(w)/k_e| over frequencies of 0.3 to 10 rad/s and three bones

One point is thus a second of waiting, the impact of a free mass, or the bone's whole
stiffness. Half of the budget is a Halton sequence over the ranges of the gains, on
logarithmic scales, and half is differential evolution from the best of these. The front
are the sets that no other set dominates in the four terms.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from league.entries import Entry, Gains
from league.felt import Loss
from league.runs import Runs
from teleop_drake.loops.framework.arrays import Array

WORST = 10.0
"""The largest value of a term of the cost."""

CORNER_BOX = (10.0, 5.0, 3.0, 1.5)
"""The corner of the box of which a front dominates a share, a value for each term."""


class Terms(NamedTuple):
    """The terms of a cost, which are numbers from 0 to WORST."""

    rest: float
    late: float
    impact: float
    loss: float


@dataclass(frozen=True)
class Trial:
    """A set of gains and what it costs in training.

    Attributes:
        gains: The gains by their paths; empty: those by rule.
        terms: The terms of the cost.
    """

    gains: Gains
    terms: Terms

    @property
    def cost(self) -> float:
        """The sum of the terms."""
        return sum(self.terms)


def TryGains(entry: Entry, runs: Runs, gains: Gains) -> Trial:
    """Returns a set of gains with its cost in the training runs."""
    outcomes = list(runs.Simulate(gains).values())

    def Mean(values: Iterable[float]) -> float:
        return float(np.mean([min(max(x, 0.0), WORST) for x in values]))

    is_bounded = all(outcome.is_bounded for outcome in outcomes)
    loss = min(Loss(entry, gains), WORST) if is_bounded else WORST
    terms = Terms(
        rest=Mean(outcome.rest for outcome in outcomes),
        late=Mean(outcome.late for outcome in outcomes),
        impact=Mean(outcome.impact for outcome in outcomes),
        loss=loss,
    )
    return Trial(gains, terms)


def Search(entry: Entry, runs: Runs, budget: int, seed: int) -> list[Trial]:
    """Searches for gains; returns all trials, first that of the gains by rule.

    Args:
        runs: The training runs of the entry.
        budget: How many sets of gains are tried for each gain.
        seed: The seed of the search.
    """
    rule = TryGains(entry, runs, {})
    n = len(entry.gains)
    if n == 0:
        return [rule]
    tried: dict[tuple[float, ...], Trial] = {}
    places: dict[tuple[float, ...], Array] = {}

    def Cost(place: Array) -> float:
        gains = entry.GainsAt(place)
        key = tuple(gains.values())
        if key not in tried:
            tried[key] = TryGains(entry, runs, gains)
            places[key] = place
        return tried[key].cost

    half = budget * n // 2
    sequence = qmc.Halton(n, rng=np.random.default_rng(seed))
    for place in sequence.random(half):
        Cost(place)
    size = max(5, min(8 * n, half // 2))
    ranked = sorted(tried, key=lambda key: tried[key].cost)[:size]
    if len(ranked) >= 5:
        differential_evolution(
            Cost,
            [(0.0, 1.0)] * n,
            init=np.array([places[key] for key in ranked]),
            maxiter=max((budget * n - half) // len(ranked), 1),
            rng=np.random.default_rng(seed),
            tol=0,
            polish=False,
        )
    return [rule, *tried.values()]


def FindFront(trials: Sequence[Trial]) -> list[Trial]:
    """Returns the trials that no other trial dominates in the terms of the cost."""
    terms = np.array([trial.terms for trial in trials])
    front = []
    for trial, own in zip(trials, terms, strict=True):
        is_better = np.all(terms <= own, axis=1) & np.any(terms < own, axis=1)
        if not is_better.any():
            front.append(trial)
    return front


def Members(trials: Sequence[Trial]) -> dict[str, Trial]:
    """Returns the named members of a search: rule, and compromise of the least cost."""
    rule, *_ = trials
    if len(trials) == 1:
        return {"compromise": rule}
    return {"rule": rule, "compromise": min(trials, key=lambda trial: trial.cost)}


def Hypervolume(front: Sequence[Trial]) -> float:
    """Returns the share of the box up to CORNER_BOX that a front dominates.

    It is counted at the 4096 points of a Sobol' sequence.
    """
    points = qmc.Sobol(len(CORNER_BOX), scramble=False).random(4096) * CORNER_BOX
    is_dominated = np.zeros(len(points), dtype=bool)
    for trial in front:
        is_dominated |= (points >= np.array(trial.terms)).all(axis=1)
    return float(is_dominated.mean())

"""Trials of sets of gains: their runs, their metrics and their comparison."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.model.tasks.metrics import MetricUnits
from teleop_drake.study.sweep.plan import SweepPlan
from teleop_drake.study.sweep.result import SweepError
from teleop_drake.study.sweep.task_result import TaskSweepResult
from teleop_drake.study.sweep.tuning.plan import STIFFNESS_LOSS, Gains, TuningPlan

# Gains whose scores differ by less than this factor count as one member of a front.
_EQUAL = 1.02


@dataclass(kw_only=True)
class Trial:
    """The outcome of a set of gains.

    Attributes:
        gains: The gains by their paths; empty: the scenario's own.
        values: The metrics (P, M) of the P runs of each scenario. A value is infinite
            if the run does not reach its end or has no such metric.
        reason: Why the gains are not accepted; empty: they are accepted.
    """

    gains: Gains
    values: dict[str, Array] = field(default_factory=dict)
    reason: str = ""

    def Scores(self, reference: "Trial") -> Array:
        """Returns the score of each metric (M), in multiples of the reference."""
        ratios = [
            self.values[name] / values.mean(axis=0)
            for name, values in reference.values.items()
        ]
        return np.asarray(np.concatenate(ratios).mean(axis=0))


def WithGains(
    sweeps: Mapping[str, SweepPlan], sets: Sequence[Gains]
) -> dict[str, SweepPlan]:
    """Returns sweeps in which each run is simulated with each set of gains."""
    axis = [list(gains.values()) for gains in sets]
    return {
        name: replace(
            sweep,
            axes={"gains": axis, **sweep.axes},
            points=[{**gains, **point} for gains in sets for point in sweep.points],
        )
        for name, sweep in sweeps.items()
    }


def TrialsOf(
    plan: TuningPlan,
    sweeps: Mapping[str, SweepPlan],
    sets: Sequence[Gains],
    results: Mapping[str, TaskSweepResult],
) -> list[Trial]:
    """Returns the trials of sets of gains from the results of WithGains()."""
    trials = [Trial(gains=gains) for gains in sets]
    for name, result in results.items():
        num_runs = len(sweeps[name].points)
        values = _Values(plan, result).reshape(len(sets), num_runs, -1)
        for i, trial in enumerate(trials):
            trial.values[name] = values[i]
            if trial.reason:
                continue
            bad = np.flatnonzero(~np.isfinite(values[i]).all(axis=1))
            if len(bad) > 0:
                record = result.records[i * num_runs + bad[0]]
                trial.reason = (
                    f"a run of {name}: {record['reason'] or 'lacks a metric'}"
                )
            else:
                _AddAnalyses(plan, sweeps[name], name, trial)
    return trials


def _Values(plan: TuningPlan, result: TaskSweepResult) -> Array:
    """Returns the metrics (runs, M), with 0 for the metric that an analysis adds."""
    units = MetricUnits(result.scenario)
    values = np.full((len(result.records), len(plan.weights)), math.inf)
    for i, row in enumerate(result.Table()):
        if row["status"] != "completed":
            continue
        for k, metric in enumerate(plan.weights):
            value = 0.0 if metric == STIFFNESS_LOSS else row[metric]
            if value is None and units[metric] == "s":
                value = result.records[i]["duration"]
            if value is not None:
                values[i, k] = value
    return values


def _AddAnalyses(plan: TuningPlan, sweep: SweepPlan, name: str, trial: Trial) -> None:
    """Adds the analyses of a sweep's runs to a trial."""
    if STIFFNESS_LOSS not in plan.weights and plan.margin is None:
        return
    is_loss = [metric == STIFFNESS_LOSS for metric in plan.weights]
    known: dict[str, tuple[float, str]] = {}
    for i, point in enumerate(sweep.points):
        # The linear model does not depend on the seed.
        given = {key: value for key, value in point.items() if key != "seed"}
        key = str(given)
        if key not in known:
            known[key] = plan.Analyze(sweep.Load({**trial.gains, **given}))
        loss, reason = known[key]
        trial.values[name][i, is_loss] = loss
        trial.reason = trial.reason or reason


def FindReference(plan: TuningPlan, trials: Sequence[Trial]) -> Trial:
    """Returns the first trial that is accepted; refuses one with a metric of 0."""
    accepted = [trial for trial in trials if not trial.reason]
    if not accepted:
        raise SweepError(
            f"gains: none of the first {plan.size} within their ranges is accepted "
            f"({trials[-1].reason})"
        )
    for name, values in accepted[0].values.items():
        for metric, mean in zip(plan.weights, values.mean(axis=0), strict=True):
            if not mean > 0:
                raise SweepError(
                    f"minimize = {metric!r}: must be > 0 with the reference gains for "
                    f"{name}, and is {mean:g}"
                )
    return accepted[0]


def FindFront(accepted: Sequence[Trial], reference: Trial) -> list[Trial]:
    """Returns the trials that no other dominates, ascending in the first metric.

    Of trials that differ by less than 2 % in every score, only one is returned.
    """
    scores = np.array([trial.Scores(reference) for trial in accepted])
    kept: list[int] = []
    for i in sorted(range(len(accepted)), key=lambda i: tuple(scores[i])):
        # Whatever dominates these gains, or something kept that resembles it, is
        # earlier in this order.
        limits = np.maximum(scores[i], _EQUAL * scores[i])
        if not np.all(scores[kept] <= limits, axis=1).any():
            kept.append(i)
    return [accepted[i] for i in kept]

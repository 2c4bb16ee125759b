"""The search for gains by differential evolution."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.model.scenario.loading import CheckScenarioLike
from teleop_drake.model.scenario.overrides import Overrides
from teleop_drake.study.sweep.plan import PlanSweep, SweepPlan
from teleop_drake.study.sweep.run import HERE, Execution, RunSweeps
from teleop_drake.study.sweep.study import IsStudy, LoadStudy, Study
from teleop_drake.study.sweep.tuning.plan import Gains, PlanTuning, TuningPlan
from teleop_drake.study.sweep.tuning.result import TuningResult
from teleop_drake.study.sweep.tuning.trials import (
    FindFront,
    FindReference,
    Trial,
    TrialsOf,
    WithGains,
)
from teleop_drake.study.sweep.values import File, GivenGrid, Notice, Progress

# The weight of one score relative to the others, in a goal of a Pareto front.
_EMPHASIS = 5.0

# The goal of gains that are not accepted, and what each bad run adds to it.
_REJECTED = 1e6


def Tune(
    scenario: File,
    *,
    controller: str,
    gains: Iterable[str],
    minimize: Iterable[str],
    grid: GivenGrid | None = None,
    held_out: GivenGrid | Study | None = None,
    overrides: Overrides = (),
    margin: float | None = None,
    evaluations: int = 64,
    seed: int = 0,
    executor: Executor | None = None,
    jobs: int | None = None,
    out: File | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    notice: Notice | None = None,
) -> TuningResult:
    """Searches for gains of a controller.

        Tune("two_dof_combined", controller="wave_variables", gains=["impedance"],
             minimize=["collision.settling_time"], grid={"delay": [0.05, 0.1]})

    Args:
        scenario: A built-in name, a YAML file, or a study. With a study, grid and
            overrides are left out.
        controller: The kind of the controller.
        gains: The fields to search, as in PlanTuning(), which also describes minimize,
            margin, evaluations and seed.
        minimize: The metrics to minimise, as METRIC or METRIC:WEIGHT.
        grid: The values of the training runs, as in Sweep().
        held_out: Values that replace those of the grid in the held-out runs, or a study
            with the held-out runs; None: there are none.
        overrides: Overrides of all runs.
        margin: Least delay margin of the round trip, in s.
        evaluations: Number of sets of gains to try.
        seed: The seed of the search.
        executor: Where to simulate; Execution describes this and the other arguments.
        jobs: Number of worker processes.
        out: Folder to write to, as in RunTuning().
        resume: Whether to continue the search in `out`.
        progress: Called with the number of finished training runs and of all of them.
        notice: Called with a line of text.

    Raises:
        ScenarioError: If an argument is not allowed, or no gains are accepted.
    """
    CheckScenarioLike(scenario)
    if IsStudy(str(scenario)):
        if grid or overrides:
            Refuse("scenario", scenario, "a scenario, as a grid or overrides are given")
        training = LoadStudy(scenario)
    else:
        all_values = {"controller": [controller], **(grid or {})}
        plan = PlanSweep(scenario, all_values, overrides=overrides)
        training = Study(plans={"": plan})
    search = PlanTuning(
        training,
        controller=controller,
        gains=gains,
        minimize=minimize,
        held_out=held_out,
        margin=margin,
        evaluations=evaluations,
        seed=seed,
    )
    execution = Execution(
        executor=executor,
        jobs=jobs,
        out=out,
        resume=resume,
        progress=progress or HERE.progress,
        notice=notice or HERE.notice,
    )
    return RunTuning(search, execution)


def RunTuning(plan: TuningPlan, execution: Execution = HERE) -> TuningResult:
    """Searches for gains, and simulates the held-out runs.

    The subfolder `runs` of the execution's folder has a sweep for each generation.
    Progress counts the training runs.

    Raises:
        SweepError: If no gains of the first generation are accepted, or the folder
            cannot be used.
    """
    return _Search(plan, execution).Run()


class _Search:
    """The state of a search.

    The trials and the places of sets of gains are keyed by the gains' values. A place
    (n) is the position of each gain in its range, from 0 to 1.
    """

    def __init__(self, plan: TuningPlan, execution: Execution):
        self._plan = plan
        self._execution = execution
        self._num_finished = 0
        self._num_generations = 0
        self._places: dict[tuple[float, ...], Array] = {}
        self._trials: dict[tuple[float, ...], Trial] = {}

    def Run(self) -> TuningResult:
        """Searches, and simulates the held-out runs."""
        plan = self._plan
        (own,) = self._Try(plan.training, [{}], "own")
        sequence = qmc.Sobol(len(plan.ranges), scramble=False).random(plan.size)
        first = self._TryPlaces(sequence + 0.5 / plan.size)
        reference = FindReference(plan, [own, *first])
        self._Evolve(reference)

        tried = [own, *self._trials.values()]
        front = [trial for trial in tried if not trial.reason]
        if not plan.has_weights:
            front = FindFront(front, reference)
        weights = self._Weights()[0]
        best = min(front, key=lambda trial: self._Goal(trial, reference, weights))
        if plan.has_weights:
            front = [best]
        return TuningResult(
            plan=plan,
            own=own,
            reference=reference,
            best=best,
            front=front,
            held_out=self._TryHeldOut(front),
            tried=tried,
        )

    def _Try(
        self, sweeps: Mapping[str, SweepPlan], sets: Sequence[Gains], folder: str
    ) -> list[Trial]:
        """Returns the trials of gains in sweeps, whose runs have their own folder."""
        if not sets:
            return []
        training = self._plan.training.values()
        total = (self._plan.evaluations + 1) * sum(len(x.points) for x in training)

        def Report(num_finished: int, _: int) -> None:
            finished = self._num_finished + num_finished
            self._execution.progress(min(finished, total), total)

        plans = WithGains(sweeps, sets)
        out = self._execution.out and Path(self._execution.out, "runs", folder)
        execution = replace(self._execution, out=out, progress=Report)
        results = RunSweeps(plans, execution)
        self._num_finished += sum(len(plan.points) for plan in plans.values())
        return TrialsOf(self._plan, sweeps, sets, results)

    def _Weights(self) -> list[Array]:
        """Returns the weights (M) of the metrics in each goal of the search."""
        if self._plan.has_weights:
            return [np.array(list(self._plan.weights.values()), dtype=float)]
        M = len(self._plan.weights)
        return [np.ones(M), *(1 + (_EMPHASIS - 1) * np.eye(M))]

    def _Goal(self, trial: Trial, reference: Trial, weights: Array) -> float:
        """Returns the sum of the weighted scores or, for a Pareto front, the largest.

        If the gains are not accepted, the goal is a large number instead.
        """
        if trial.reason:
            rows = np.concatenate(list(trial.values.values()))
            num_bad = np.sum(~np.isfinite(rows).all(axis=1))
            return float(_REJECTED * (1.0 + num_bad))
        combine = np.sum if self._plan.has_weights else np.max
        return float(combine(weights * trial.Scores(reference)))

    def _Evolve(self, reference: Trial) -> None:
        """Minimises each goal in turn, from the best gains that were tried."""
        plan = self._plan
        num_left = plan.evaluations // plan.size - 1
        goals = self._Weights()
        for k, weights in enumerate(goals):
            # The goals share the generations that follow the first one.
            num_generations = (num_left + len(goals) - 1 - k) // len(goals)
            if num_generations == 0:
                continue
            goal = partial(self._Goal, reference=reference, weights=weights)
            tried = {key: goal(trial) for key, trial in self._trials.items()}
            best = sorted(tried, key=tried.__getitem__)[: plan.size]
            differential_evolution(
                partial(self._Minimized, goal),
                [(0.0, 1.0)] * len(plan.ranges),
                init=np.array([self._places[key] for key in best]),
                rng=plan.seed + k,
                maxiter=num_generations,
                tol=0,
                polish=False,
                vectorized=True,
                updating="deferred",
            )

    def _Minimized(self, goal: Callable[[Trial], float], places: Array) -> Array:
        """Returns a goal (S) at places (n, S), in the shapes of SciPy."""
        return np.array([goal(trial) for trial in self._TryPlaces(places.T)])

    def _TryPlaces(self, places: Array) -> list[Trial]:
        """Returns the trials of gains at places (S, n); simulates the missing ones."""
        keys = [tuple(self._plan.Gains(place).values()) for place in places]
        new = {
            key: np.array(place)
            for key, place in zip(keys, places, strict=True)
            if key not in self._trials
        }
        if new:
            sets = [dict(zip(self._plan.ranges, key, strict=True)) for key in new]
            folder = f"generation-{self._num_generations:02d}"
            self._num_generations += 1
            trials = self._Try(self._plan.training, sets, folder)
            self._places |= new
            self._trials.update(zip(new, trials, strict=True))
        return [self._trials[key] for key in keys]

    def _TryHeldOut(self, front: Sequence[Trial]) -> list[Trial]:
        """Returns the held-out runs of the scenario's own gains and of a front."""
        sweeps = self._plan.held_out
        if not sweeps:
            return []
        (own,) = self._Try(sweeps, [{}], "held_out-own")
        sets = [trial.gains for trial in front if trial.gains]
        others = iter(self._Try(sweeps, sets, "held_out"))
        return [own, *(next(others) if trial.gains else own for trial in front)]

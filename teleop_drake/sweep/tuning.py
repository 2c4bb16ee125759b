"""Gains by search, each generation of which is a sweep.

Gains are tried together on all training runs: every run of a study, several scenarios,
delays, values and seeds. For each metric that is minimised the runs of a set of gains
make one number,

    the mean over all runs of (metric)/(mean over the scenario's runs of it, with the
    reference gains),

and the reference gains are the scenario's own, or, if these are not accepted, the first
that are. With weights the weighted sum of these numbers is the goal. Without, several
goals in turn look for a Pareto front: the largest of the numbers, and then the largest
with one of them weighing five times as much as the others.

Gains are accepted if every run of theirs goes on to its end and has a value of each
metric. A time that a run does not have, because it never settles say, counts as the
run's duration. With a margin, every loop of every training run also has to stay stable,
by analysis, if the round trip becomes that much longer.

The search is differential evolution from a Sobol' sequence (scipy), on logarithmic
ranges where these are positive. Gains are rounded to four digits.
"""

import itertools
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from teleop_drake.analysis.stability import AnalyzeStability
from teleop_drake.analysis.transparency import FeltStiffnessLoss
from teleop_drake.arrays import Array
from teleop_drake.files import Replacing
from teleop_drake.scenario import AsTeleoperation, Scenario
from teleop_drake.scenario.overrides import GetPath
from teleop_drake.scenario.tree import ToTree
from teleop_drake.scenario.yaml_text import DumpYaml
from teleop_drake.stations import ResolveController
from teleop_drake.sweep.folder import WriteCsv
from teleop_drake.sweep.plan import PlanSweep, PointOverrides, SweepPlan
from teleop_drake.sweep.result import SweepError, SweepResult
from teleop_drake.sweep.run import RunSweep
from teleop_drake.sweep.study import IsStudy, LoadStudy, Study
from teleop_drake.tasks import TaskOf
from teleop_drake.tasks.metrics import MetricUnits
from teleop_drake.validation import CheckChoice, CheckNumber, Refuse

Gains = dict[str, float]

STIFFNESS_LOSS = "felt_stiffness_loss"
"""What FeltStiffnessLoss() returns of a scenario, among the metrics."""

_MAX_GAINS = 6

# A range that is not given: a tenth to ten times the scenario's own value.
_DECADE = 10.0

# How much more one number weighs than the others, in a goal of a Pareto front.
_EMPHASIS = 5.0

# Numbers that differ by less do not make two members of a front.
_EQUAL = 1.02

# The goal of gains that are not accepted, for each run that is not.
_REJECTED = 1e6


@dataclass(frozen=True, kw_only=True)
class TuningPlan:
    """A search that was checked, see PlanTuning.

    Attributes:
        training: Sweep of each scenario, the controller being one of its overrides.
        held_out: The same for the runs that the search does not see.
        ranges: Lower and upper bound of each gain by its path.
        weights: Of the metrics that are minimised, by their names; None for each: a
            Pareto front is looked for.
        margin: Of the round-trip delay, in s; None: no margin is asked for.
        evaluations: How many sets of gains are tried, the scenario's own apart.
        seed: Of the search.
    """

    training: dict[str, SweepPlan]
    held_out: dict[str, SweepPlan]
    ranges: dict[str, tuple[float, float]]
    weights: dict[str, float | None]
    margin: float | None
    evaluations: int
    seed: int

    @property
    def size(self) -> int:
        """Number of sets of gains in a generation, a power of 2."""
        return int(8 * 2 ** (len(self.ranges).bit_length() - 1))

    def Gains(self, share: Iterable[float]) -> dict[str, float]:
        """Returns gains from where they lie in their ranges, 0 to 1 each."""
        gains = {}
        for (path, (low, high)), x in zip(self.ranges.items(), share, strict=True):
            value = low * (high / low) ** x if low > 0 else low + x * (high - low)
            gains[path] = float(f"{value:.4g}")
        return gains


@dataclass(kw_only=True)
class Trial:
    """What came out for a set of gains.

    Attributes:
        gains: By their paths; empty: the scenario's own.
        values: The metrics (P, M) of the P runs of each scenario; infinite of a run
            that does not go on to its end, and where it has none.
        reason: Why the gains are not accepted; empty: they are.
    """

    gains: Gains
    values: dict[str, Array] = field(default_factory=dict)
    reason: str = ""

    def Scores(self, reference: "Trial") -> Array:
        """Returns the number of each metric (M); see the top of this file."""
        shares = [
            self.values[name] / values.mean(axis=0)
            for name, values in reference.values.items()
        ]
        return np.asarray(np.concatenate(shares).mean(axis=0))


@dataclass(kw_only=True)
class TuningResult:
    """What came out of a search.

    Attributes:
        plan: The search.
        own: The scenario's own gains.
        reference: The reference gains.
        best: Of the front those with the smallest goal: the weighted sum, or without
            weights the largest of the numbers.
        front: The accepted gains that none is better than in every metric, ascending in
            the first one; with weights only the best.
        held_out: The held-out runs of the scenario's own gains and of the front.
        tried: All that was tried in the training runs.
    """

    plan: TuningPlan
    own: Trial
    reference: Trial
    best: Trial
    front: list[Trial]
    held_out: list[Trial]
    tried: list[Trial] = field(repr=False)

    def Scores(self, trial: Trial) -> Array:
        """Returns the number of each metric (M), in multiples of the reference."""
        return trial.Scores(self.reference)

    def Table(self) -> list[dict[str, Any]]:
        """Returns the rows of tuning.csv: one for each set of gains and scenario.

        `bounded` is the number of runs that go on to their end and have every metric;
        the mean and the largest value over these follow for each metric.
        """
        rows = []
        sets = {"training": [self.own, *self.front], "held out": self.held_out}
        for runs, trials in sets.items():
            for i, trial in enumerate(trials):
                name = f"front-{i}" if len(self.front) > 1 else "best"
                row: dict[str, Any] = {"gains": name if i else "own", "runs": runs}
                row |= dict.fromkeys(self.plan.ranges) | trial.gains
                for scenario, values in trial.values.items():
                    good = values[np.isfinite(values).all(axis=1)]
                    row |= {"scenario": scenario, "count": len(values)}
                    row |= {"bounded": len(good)}
                    for metric, x in zip(self.plan.weights, good.T, strict=True):
                        row[f"{metric} mean"] = float(x.mean()) if len(x) else None
                        row[f"{metric} worst"] = float(x.max()) if len(x) else None
                    rows.append(dict(row))
        return rows

    def Write(self, folder: Path) -> list[Path]:
        """Writes the gains and the table; returns the files.

        `gains.yaml` has the best ones, `front-N.yaml` those of a front: mappings of
        paths to values, which --set and the `overrides` of a study take.
        """
        trials = {"gains": self.best}
        if len(self.front) > 1:
            trials |= {f"front-{i + 1}": trial for i, trial in enumerate(self.front)}
        kind = next(iter(self.plan.training.values())).scenario.controller.kind
        for name, trial in trials.items():
            text = DumpYaml({"controller.kind": kind} | trial.gains)
            with Replacing(folder / f"{name}.yaml") as temporary:
                temporary.write_text(text, encoding="utf-8")
        files = [folder / f"{name}.yaml" for name in trials]
        return [*files, WriteCsv(folder / "tuning.csv", self.Table())]


def Tune(
    scenario: str | os.PathLike[str],
    *,
    controller: str,
    grid: Mapping[str, Iterable[Any]] | None = None,
    held_out: Mapping[str, Iterable[Any]] | Study | None = None,
    overrides: Mapping[str, Any] | Iterable[str] = (),
    out: str | os.PathLike[str] | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | None = None,
    **search: Any,
) -> TuningResult:
    """Searches for gains of a controller.

        Tune("two_dof_combined", controller="wave_variables", gains=["impedance"],
             minimize=["collision.settling_time"], grid={"delay": [0.05, 0.1]})

    Args:
        scenario: A built-in name, a YAML file, or a study: then grid and overrides are
            left out.
        controller: Its kind.
        grid: Training runs, as Sweep() takes it.
        held_out: Values of the grid that replace others in the held-out runs, or a
            study of these; None: there are none.
        overrides: For all runs.
        out: As RunTuning() takes it, and so are resume and progress.
        **search: The rest of what PlanTuning() takes.

    Raises:
        ScenarioError: If anything is not allowed, or no gains are accepted.
    """

    def Plan(values: Mapping[str, Iterable[Any]]) -> Study:
        plan = PlanSweep(scenario, values, overrides=overrides)
        return Study(plans={"": plan}, metrics=None)

    is_study = IsStudy(str(scenario))
    if is_study and (grid or overrides or isinstance(held_out, Mapping)):
        Refuse("scenario", scenario, "a scenario, as a grid or overrides are given")
    grid = {"controller": [controller], **(grid or {})}
    training = LoadStudy(scenario) if is_study else Plan(grid)
    if isinstance(held_out, Mapping):
        held_out = Plan({**grid, **held_out})
    plan = PlanTuning(training, controller=controller, held_out=held_out, **search)
    return RunTuning(plan, out=out, resume=resume, progress=progress)


def PlanTuning(
    training: Study,
    *,
    controller: str,
    gains: Iterable[str],
    minimize: Iterable[str],
    held_out: Study | None = None,
    margin: float | None = None,
    evaluations: int = 64,
    seed: int = 0,
) -> TuningPlan:
    """Checks everything about a search that can be wrong before it runs.

    Args:
        gains: One to six, NAME or NAME=LOW:HIGH. A name is the path of a field of the
            scenario, or of one of the controller's, `impedance` for
            `controller.wave_variables.impedance`. A range that is not given is a tenth
            to ten times what the first training scenario has.
        minimize: METRIC or METRIC:WEIGHT.
        margin: Of the round-trip delay, in s.
        evaluations: How many sets of gains are tried, the scenario's own apart.
        seed: Of the search: with the same one, the same gains are found.

    Raises:
        ScenarioError: If something is not allowed.
    """
    trained, tested = (
        {
            name or plan.scenario.name: _OfController(plan, controller)
            for name, plan in (study.plans if study else {}).items()
        }
        for study in (training, held_out)
    )
    sweeps = [*trained.values(), *tested.values()]
    ranges = dict(_Range(AsTeleoperation(sweeps[0].scenario), text) for text in gains)
    if not 1 <= len(ranges) <= _MAX_GAINS:
        Refuse("gains", list(ranges), f"1 to {_MAX_GAINS} different ones")
    if margin is not None:
        CheckNumber("margin", margin, "s", minimum=0)
    plan = TuningPlan(
        training=trained,
        held_out=tested,
        ranges=ranges,
        weights=_Weights(minimize, sweeps),
        margin=margin,
        evaluations=evaluations,
        seed=seed,
    )
    if evaluations < plan.size:
        allowed = f"{plan.size} or more with {len(ranges)} gains"
        Refuse("evaluations", evaluations, allowed)
    for sweep in sweeps:
        for path, bounds in ranges.items():
            if path in sweep.axes:
                Refuse(f"gains.{path}", bounds, "a field that no run varies")
            for bound in bounds:
                _Load(sweep, {**sweep.points[0], path: bound})
        # It says if there is no linear model.
        _Analyze(plan, AsTeleoperation(sweep.scenario))
    return plan


def _OfController(plan: SweepPlan, controller: str) -> SweepPlan:
    """Returns a sweep with a controller for all of its runs."""
    axes = dict(plan.axes)
    if axes.pop("controller", [controller]) != [controller]:
        Refuse("controllers", plan.axes["controller"], f"left out, or {controller!r}")
    overrides = [*plan.overrides, *PointOverrides({"controller": controller})]
    points = [{key: x[key] for key in axes} for x in plan.points]
    plan = replace(plan, overrides=overrides, axes=axes, points=points)
    return replace(plan, scenario=_Load(plan, points[0]))


def _Load(sweep: SweepPlan, point: Mapping[str, Any]) -> Any:
    """Returns the scenario of a run, after the checks of its task."""
    scenario = sweep.source.Load([*sweep.overrides, *PointOverrides(point)])
    TaskOf(scenario).Check(scenario)
    return scenario


def _Range(scenario: Scenario, text: str) -> tuple[str, tuple[float, float]]:
    """Returns the path and the range that NAME or NAME=LOW:HIGH stands for."""
    name, equals, given = text.strip().partition("=")
    own = f"{scenario.controller.path}."
    path = name if hasattr(scenario, name.partition(".")[0]) else own + name
    value = GetPath(ToTree(scenario), path)
    if equals:
        try:
            low, high = map(float, given.split(":"))
        except ValueError:
            low = high = math.nan
        if not -math.inf < low < high < math.inf:
            Refuse(f"gains.{name}", given, "LOW:HIGH, two numbers, the larger one last")
        return path, (low, high)
    if value is None and path.startswith(own):
        value = ResolveController(scenario)
        for part in path.removeprefix(own).split("."):
            value = getattr(value, part)
    matrix = np.atleast_2d(np.asarray(math.nan if value is None else value))
    x, is_number = matrix.flat[0], matrix.dtype.kind in "if"
    if not (is_number and x > 0 and np.array_equal(matrix, x * np.eye(len(matrix)))):
        Refuse(f"gains.{name}", text, "NAME=LOW:HIGH; its own value is no number > 0")
    return path, (float(f"{x / _DECADE:.4g}"), float(f"{x * _DECADE:.4g}"))


def _Weights(
    texts: Iterable[str], sweeps: Iterable[SweepPlan]
) -> dict[str, float | None]:
    """Returns the weights of the metrics, None for all if none has one."""
    pairs = [text.partition(":") for text in texts]
    try:
        weights = {name: float(x) if colon else None for name, colon, x in pairs}
    except ValueError:
        weights = {}
    for plan, name in itertools.product(sweeps, weights):
        CheckChoice("minimize", name, [STIFFNESS_LOSS, *MetricUnits(plan.scenario)])
    given = [x for x in weights.values() if x is not None]
    is_valid = weights and len(given) in (0, len(pairs))
    if not (is_valid and all(0 < x < math.inf for x in given)):
        allowed = "METRIC or METRIC:WEIGHT, weights > 0 for all or none"
        Refuse("minimize", ["".join(pair) for pair in pairs], allowed)
    return weights if len(weights) > 1 else dict.fromkeys(weights, 1.0)


def RunTuning(
    plan: TuningPlan,
    *,
    out: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> TuningResult:
    """Does what a plan says.

    Args:
        out: Folder to write to, of which `runs` has a sweep for each generation; None
            writes nothing.
        progress: Called with the number of finished training runs and that of all.
        **options: resume, jobs and notice, as RunSweep() takes them.

    Raises:
        SweepError: If no gains of the first generation are accepted, or the folder
            cannot be used.
    """
    search = _Search(plan, out, progress or (lambda finished, runs: None), options)
    return search.Run()


@dataclass
class _Search:
    """The search, with all that was tried, and where it lies, by the gains."""

    _plan: TuningPlan
    _out: str | os.PathLike[str] | None
    _progress: Callable[[int, int], None]
    _options: dict[str, Any]
    _finished: int = 0
    _generations: int = 0
    _tried: dict[tuple[float, ...], tuple[Array, Trial]] = field(default_factory=dict)

    def Run(self) -> TuningResult:
        """Searches, and simulates the held-out runs."""
        plan = self._plan
        (own,) = self._Evaluate(plan.training, [{}], "own")
        sequence = qmc.Sobol(len(plan.ranges), scramble=False).random(plan.size)
        first = self._TryAll(sequence + 0.5 / plan.size)
        self._reference = _Reference(plan, [own, *first])
        goals = self._Goals()
        steps = plan.evaluations // plan.size - 1
        for k, weights in enumerate(goals):

            def Goal(shares: Array, weights: Array = weights) -> Array:
                trials = self._TryAll(shares.T)
                return np.array([self._Goal(trial, weights) for trial in trials])

            if num_steps := (steps + len(goals) - 1 - k) // len(goals):
                differential_evolution(
                    Goal,
                    [(0.0, 1.0)] * len(plan.ranges),
                    init=self._Best(weights),
                    rng=plan.seed + k,
                    maxiter=num_steps,
                    tol=0,
                    polish=False,
                    vectorized=True,
                    updating="deferred",
                )
        trials = [own, *(trial for _, trial in self._tried.values())]
        front = [trial for trial in trials if not trial.reason]
        if len(goals) > 1:
            front = _Front(front, self._reference)
        best = min(front, key=lambda trial: self._Goal(trial, goals[0]))
        front = front if len(goals) > 1 else [best]
        held_out = []
        if plan.held_out:
            (own_again,) = self._Evaluate(plan.held_out, [{}], "held_out-own")
            sets = [trial.gains for trial in front if trial.gains]
            others = iter(self._Evaluate(plan.held_out, sets, "held_out"))
            again = (next(others) if trial.gains else own_again for trial in front)
            held_out = [own_again, *again]
        return TuningResult(
            plan=plan,
            own=own,
            reference=self._reference,
            best=best,
            front=front,
            held_out=held_out,
            tried=trials,
        )

    def _Goals(self) -> list[Array]:
        """Returns the weights of the metrics in each of the goals."""
        if given := [x for x in self._plan.weights.values() if x is not None]:
            return [np.array(given)]
        M = len(self._plan.weights)
        return [np.ones(M), *(np.ones(M) + (_EMPHASIS - 1) * np.eye(M))]

    def _Goal(self, trial: Trial, weights: Array) -> float:
        if trial.reason:
            rows = np.concatenate(list(trial.values.values()))
            return _REJECTED * (1.0 + np.sum(~np.isfinite(rows).all(axis=1)))
        parts = weights * trial.Scores(self._reference)
        has_weights = None not in self._plan.weights.values()
        return float(parts.sum() if has_weights else parts.max())

    def _Best(self, weights: Array) -> Array:
        """Returns where the best gains that were tried lie, a generation of them."""
        tried = self._tried.values()
        order = sorted(tried, key=lambda pair: self._Goal(pair[1], weights))
        return np.array([share for share, _ in order[: self._plan.size]])

    def _TryAll(self, shares: Array) -> list[Trial]:
        """Returns the trials of gains (S, n) from where they lie; runs what is new."""
        sets = [self._plan.Gains(share) for share in shares]
        keys = [tuple(gains.values()) for gains in sets]
        new = dict(zip(keys, zip(sets, shares, strict=True), strict=True))
        new = {key: x for key, x in new.items() if key not in self._tried}
        if new:
            unknown = [gains for gains, _ in new.values()]
            folder = f"generation-{self._generations:02d}"
            self._generations += 1
            trials = self._Evaluate(self._plan.training, unknown, folder)
            for (key, (_, share)), trial in zip(new.items(), trials, strict=True):
                self._tried[key] = np.array(share), trial
        return [self._tried[key][1] for key in keys]

    def _Evaluate(
        self, sweeps: Mapping[str, SweepPlan], sets: Sequence[Gains], folder: str
    ) -> list[Trial]:
        """Simulates all runs with each set of gains."""
        trials = [Trial(gains=gains) for gains in sets]
        runs = sum(len(sweep.points) for sweep in self._plan.training.values())
        total = (self._plan.evaluations + 1) * runs
        for name, sweep in sweeps.items() if sets else ():

            def Report(finished: int, _: int, before: int = self._finished) -> None:
                self._progress(min(before + finished, total), total)

            axes = {"gains": [list(gains.values()) for gains in sets], **sweep.axes}
            points = [{**gains, **point} for gains in sets for point in sweep.points]
            result = RunSweep(
                replace(sweep, axes=axes, points=points),
                out=self._out and Path(self._out, "runs", folder, name),
                progress=Report,
                **self._options,
            )
            self._finished += len(points)
            values = _Values(self._plan, result)
            for i, trial in enumerate(trials):
                span = slice(i * len(sweep.points), (i + 1) * len(sweep.points))
                trial.values[name] = x = values[span]
                bad = np.flatnonzero(~np.isfinite(x).all(axis=1))
                if len(bad):
                    why = result.records[span][bad[0]]["reason"] or "lacks a metric"
                    trial.reason = trial.reason or f"a run of {name}: {why}"
                elif not trial.reason:
                    self._AnalyzeAll(sweep, trial, x)
        return trials

    def _AnalyzeAll(self, sweep: SweepPlan, trial: Trial, values: Array) -> None:
        """Adds to the trial of a scenario's runs what analyses say."""
        known: dict[str, tuple[float, str]] = {}
        for point, row in zip(sweep.points, values, strict=True):
            # A seed changes no linear model.
            given = {key: x for key, x in point.items() if key != "seed"}
            if (key := str(given)) not in known:
                scenario = _Load(sweep, {**trial.gains, **given})
                known[key] = _Analyze(self._plan, AsTeleoperation(scenario))
            loss, reason = known[key]
            row[[metric == STIFFNESS_LOSS for metric in self._plan.weights]] = loss
            trial.reason = trial.reason or reason


def _Values(plan: TuningPlan, result: SweepResult) -> Array:
    """Returns the metrics (runs, M), 0 where an analysis says them."""
    units = MetricUnits(result.scenario)
    values = np.full((len(result.records), len(plan.weights)), math.inf)
    for i, (record, row) in enumerate(zip(result.records, result.Table(), strict=True)):
        for k, metric in enumerate(plan.weights):
            x = 0.0 if metric == STIFFNESS_LOSS else row.get(metric)
            if x is None and units[metric] == "s":
                x = record["duration"]
            if row["status"] == "completed" and x is not None:
                values[i, k] = x
    return values


def _Analyze(plan: TuningPlan, scenario: Scenario) -> tuple[float, str]:
    """Returns the loss of stiffness, and why the margin is too small; each if asked."""
    loss = FeltStiffnessLoss(scenario) if STIFFNESS_LOSS in plan.weights else 0.0
    if plan.margin is not None:
        trip = scenario.forward_channel.delay + scenario.return_channel.delay
        found = AnalyzeStability(scenario, max_delay=trip + plan.margin + 1e-3)
        for loop in found.Loops():
            ends = loop.delay, loop.delay + plan.margin
            if not any(a <= ends[0] and ends[1] <= b for a, b in loop.stable_delays):
                return loss, f"{loop.label}: a delay margin below {plan.margin:g} s"
    return loss, ""


def _Reference(plan: TuningPlan, trials: Sequence[Trial]) -> Trial:
    """Returns the first trial that is accepted, and whose numbers are a measure."""
    for trial in [trial for trial in trials if not trial.reason][:1]:
        for name, values in trial.values.items():
            for metric, x in zip(plan.weights, values.mean(axis=0), strict=True):
                if not x > 0:
                    raise SweepError(
                        f"minimize = {metric!r}: must be > 0 with the reference gains "
                        f"for {name}, and is {x:g}"
                    )
        return trial
    raise SweepError(
        f"gains: none of the first {plan.size} within their ranges is accepted "
        f"({trials[-1].reason})"
    )


def _Front(accepted: Sequence[Trial], reference: Trial) -> list[Trial]:
    """Returns the trials that none is better than, by the first metric.

    Of trials that differ by less than 2 % in every number one is enough.
    """
    scores = np.array([trial.Scores(reference) for trial in accepted])
    kept: list[int] = []
    for i in sorted(range(len(accepted)), key=lambda i: tuple(scores[i])):
        x, rivals = scores[i], scores[kept]
        is_beaten = np.all(scores <= x, axis=1) & np.any(scores < x, axis=1)
        if not is_beaten.any() and not np.all(rivals <= _EQUAL * x, axis=1).any():
            kept.append(i)
    return [accepted[i] for i in kept]

"""The plan of a search for gains: its runs, ranges and metrics, checked."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Interval
from teleop_drake.loops.framework.validation import CheckChoice, CheckNumber, Refuse
from teleop_drake.model.scenario import AnyScenario, AsTeleoperation, Scenario
from teleop_drake.model.stations import ResolveController
from teleop_drake.model.tasks.metrics import MetricUnits
from teleop_drake.study.analysis.stability import AnalyzeStability
from teleop_drake.study.analysis.transparency import FeltStiffnessLoss
from teleop_drake.study.sweep.plan import PlanSweep, SweepPlan
from teleop_drake.study.sweep.study import Study
from teleop_drake.study.sweep.values import GivenGrid

Gains = dict[str, float]
"""Values of the gains by their paths."""

STIFFNESS_LOSS = "felt_stiffness_loss"
"""The name of the metric that FeltStiffnessLoss() computes."""

_MAX_GAINS = 6

# The default range is a tenth to ten times the scenario's own value.
_DECADE = 10.0


@dataclass(frozen=True, kw_only=True)
class TuningPlan:
    """A checked search for gains; see PlanTuning.

    Attributes:
        training: The sweep of each scenario, with the controller among its overrides.
        held_out: The sweeps of the runs that the search does not use.
        ranges: The lower and upper bound of each gain, by its path.
        weights: The weights of the minimised metrics, by their names. If all are None,
            the search looks for a Pareto front.
        margin: Least delay margin of the round trip, in s; None: it is not checked.
        evaluations: Number of sets of gains to try, besides the scenario's own.
        seed: The seed of the search.
    """

    training: dict[str, SweepPlan]
    held_out: dict[str, SweepPlan]
    ranges: dict[str, Interval]
    weights: dict[str, float | None]
    margin: float | None
    evaluations: int
    seed: int

    @property
    def size(self) -> int:
        """Number of sets of gains in a generation, a power of 2."""
        return int(8 * 2 ** (len(self.ranges).bit_length() - 1))

    @property
    def has_weights(self) -> bool:
        """Whether the metrics have weights."""
        return None not in self.weights.values()

    def Gains(self, place: Array) -> Gains:
        """Returns the gains at a place, which is 0 to 1 along each range."""
        return {
            path: float(f"{_Between(*bounds, share):.4g}")
            for (path, bounds), share in zip(self.ranges.items(), place, strict=True)
        }

    def Analyze(self, scenario: AnyScenario) -> tuple[float, str]:
        """Performs the analyses of a scenario that the metrics or the margin need.

        Returns:
            The felt stiffness loss, 0 if it is not one of the metrics; and why a delay
            margin is too small, empty if none is.
        """
        teleoperation = AsTeleoperation(scenario)
        loss = 0.0
        if STIFFNESS_LOSS in self.weights:
            loss = FeltStiffnessLoss(teleoperation)
        margin = self.margin
        if margin is None:
            return loss, ""
        forward = teleoperation.forward_channel.delay
        trip = forward + teleoperation.return_channel.delay
        found = AnalyzeStability(teleoperation, max_delay=trip + margin + 1e-3)
        for loop in found.Loops():
            longest = loop.delay + margin
            if not any(a <= loop.delay and longest <= b for a, b in loop.stable_delays):
                return loss, f"{loop.label}: a delay margin below {margin:g} s"
        return loss, ""


def _Between(low: float, high: float, share: float) -> float:
    """Returns a number between two others; on a logarithmic scale if they are > 0."""
    if low > 0:
        return low * (high / low) ** share
    return low + share * (high - low)


def PlanTuning(
    training: Study,
    *,
    controller: str,
    gains: Iterable[str],
    minimize: Iterable[str],
    held_out: Study | GivenGrid | None = None,
    margin: float | None = None,
    evaluations: int = 64,
    seed: int = 0,
) -> TuningPlan:
    """Makes the plan of a search for gains, and checks it before anything runs.

    Args:
        training: The runs with which gains are tried.
        controller: Kind of the controller.
        gains: One to six gains, as NAME or NAME=LOW:HIGH. A name is the path of a field
            of the scenario or of its controller: `impedance` stands for
            `controller.wave_variables.impedance`. The default range is a tenth to ten
            times the value in the first training scenario.
        minimize: The metrics to minimise, as METRIC or METRIC:WEIGHT.
        held_out: Runs that the search does not use, as a study, or as values in the
            place of those of the training runs; None: there are none.
        margin: Least delay margin of the round trip, in s; None: it is not checked.
        evaluations: Number of sets of gains to try, besides the scenario's own.
        seed: The seed of the search. Equal seeds give equal gains.

    Raises:
        ScenarioError: If something is not allowed.
    """
    trained = _WithController(training, controller)
    tested = _WithController(_HeldOut(training, held_out), controller)
    sweeps = [*trained.values(), *tested.values()]
    scenario = AsTeleoperation(sweeps[0].scenario)
    ranges = dict(_Range(scenario, text) for text in gains)
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
    # Both bounds of each range have to be valid in every sweep.
    for sweep in sweeps:
        for path, bounds in ranges.items():
            if path in sweep.axes:
                Refuse(f"gains.{path}", bounds, "a field that no run varies")
            for bound in bounds:
                sweep.Load({**sweep.points[0], path: bound})
        # This call refuses a scenario without a linear model, if one is needed.
        plan.Analyze(sweep.scenario)
    return plan


def _HeldOut(training: Study, held_out: Study | GivenGrid | None) -> Study:
    """Returns the study of the held-out runs, which may have no runs."""
    if isinstance(held_out, Study):
        return held_out
    if not held_out:
        return Study(plans={})
    if "" not in training.plans:
        Refuse("held_out", list(held_out), "one study, as the training runs are")
    plan = training.plans[""]
    grid = {**plan.axes, **held_out}
    return Study(plans={"": PlanSweep(plan.file, grid, overrides=plan.overrides)})


def _WithController(study: Study, controller: str) -> dict[str, SweepPlan]:
    """Returns the sweeps of a study with one controller; refuses one that varies it."""
    sweeps = {}
    for name, plan in study.plans.items():
        axes = dict(plan.axes)
        varied = axes.pop("controller", [controller])
        if varied != [controller]:
            Refuse("controllers", varied, f"left out, or {controller!r}")
        fixed = replace(
            plan,
            overrides=[*plan.overrides, ("controller.kind", controller)],
            axes=axes,
            points=[{key: point[key] for key in axes} for point in plan.points],
        )
        first = fixed.Load(fixed.points[0])
        sweeps[name or plan.scenario.name] = replace(fixed, scenario=first)
    return sweeps


def _Range(scenario: Scenario, text: str) -> tuple[str, Interval]:
    """Returns the path and the range that NAME or NAME=LOW:HIGH stands for."""
    name, equals, given = text.strip().partition("=")
    of_controller = f"{scenario.controller.path}."
    path = name
    if not hasattr(scenario, name.partition(".")[0]):
        path = of_controller + name
    value = scenario.Value(path)  # Refuses a path that does not exist.
    if equals:
        return path, _ParseRange(name, given)
    if value is None and path.startswith(of_controller):
        get_field = attrgetter(path.removeprefix(of_controller))
        value = get_field(ResolveController(scenario))
    x = _ScalarOf(value)
    if x is None or not x > 0:
        Refuse(f"gains.{name}", text, "NAME=LOW:HIGH; its own value is not > 0")
    return path, (float(f"{x / _DECADE:.4g}"), float(f"{x * _DECADE:.4g}"))


def _ParseRange(name: str, text: str) -> Interval:
    """Returns the bounds of LOW:HIGH."""
    try:
        low, high = map(float, text.split(":"))
    except ValueError:
        low = high = math.nan
    if not -math.inf < low < high < math.inf:
        Refuse(f"gains.{name}", text, "LOW:HIGH, two numbers, the larger one last")
    return low, high


def _ScalarOf(value: object) -> float | None:
    """Returns a number, or x if the value is a matrix x I; None for other values."""
    matrix = np.atleast_2d(np.asarray(math.nan if value is None else value))
    x = matrix.flat[0]
    if matrix.dtype.kind in "if" and np.array_equal(matrix, x * np.eye(len(matrix))):
        return float(x)
    return None


def _Weights(
    texts: Iterable[str], sweeps: Sequence[SweepPlan]
) -> dict[str, float | None]:
    """Returns the weights of the metrics, None for all if none has one."""
    items = list(texts)
    weights: dict[str, float | None] = {}
    for text in items:
        name, colon, weight = text.partition(":")
        for plan in sweeps:
            CheckChoice("minimize", name, [STIFFNESS_LOSS, *MetricUnits(plan.scenario)])
        try:
            weights[name] = float(weight) if colon else None
        except ValueError:
            weights[name] = math.nan
    given = [x for x in weights.values() if x is not None]
    has_all_or_none = len(given) in (0, len(items))
    if not (weights and has_all_or_none and all(0 < x < math.inf for x in given)):
        Refuse(
            "minimize", items, "METRIC or METRIC:WEIGHT, weights > 0 for all or none"
        )
    return weights if len(weights) > 1 else dict.fromkeys(weights, 1.0)

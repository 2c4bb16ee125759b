"""Chapter 6 and the abstract: what the thesis concludes."""

from dataclasses import replace

import numpy as np

from teleop_drake.analysis.stability import AnalyzeStability
from teleop_drake.architectures.adaptive_backstepping import AdaptiveBacksteppingConfig
from teleop_drake.linear_model.operating_point import OperatingPoints
from teleop_drake.scenario import AsTeleoperation, LoadScenario
from teleop_drake.scenario.tree import ToTree
from teleop_drake.thesis.claims.claim import Axes, Found, Measures, Pair, Seconds
from teleop_drake.thesis.claims.learning import (
    INSIDE,
    PathDistance,
    UnlearnedWeight,
    WeightDrift,
)
from teleop_drake.thesis.claims.measures import Rms
from teleop_drake.thesis.claims.separate_updates import SeparateUpdatesConfig
from teleop_drake.thesis.runs import (
    ADAPTIVE,
    DIRECT,
    LEARNING,
    NO_ADAPTATION,
    TASKS,
    Change,
    Delay,
    Run,
    ThesisRuns,
)

_THIRD = "two_dof_combined"
_OVERSHOOT = "puncture.velocity_overshoot"
_FIRST = "collision.initial_impact_force"
_LARGEST = "collision.peak_force"
_SETTLING = "collision.settling_time"
_COMPARED = ("start_velocity_overshoot", _OVERSHOOT, _FIRST, _LARGEST)
"""The metrics that the thesis compares and in which lower is better."""

_DAMPER: Change = {
    "controller.kind": "damped_force",
    "controller.damped_force.against": "command",
}
"""Direct force with a damper against the command, as the plain baseline."""

_BONE = "environment.layers.bone.stiffness"
_TISSUE = "environment.layers.tissue.damping"
_ENVIRONMENTS: dict[str, tuple[str, Change]] = {
    "case II, bone of 1500 N/m": ("two_dof_collision", {_BONE: 1500.0}),
    "case II, Psi0 = 2": ("two_dof_collision", {"controller.initial_psi": 2.0}),
    "case III, bone of 15 N/m": (_THIRD, {_BONE: 15.0}),
    "case III, bone of 1500 N/m": (_THIRD, {_BONE: 1500.0}),
    "case III, tissue of 0.1 N s/m": (_THIRD, {_TISSUE: 0.1}),
    "case III, tissue of 2.5 N s/m": (_THIRD, {_TISSUE: 2.5}),
    "case III, Psi0 = 8": (_THIRD, {"controller.initial_psi": 8.0}),
}
"""Environments and estimates that the design of chapter 5 does not know."""


@Measures("6-comparable-without-delay")
def _ComparableWithoutDelay(runs: ThesisRuns) -> Found:
    both = runs.ShortOfBoth(_THIRD, Delay(0.0))
    overshoot, largest = both.Numbers(_OVERSHOOT), both.Numbers(_LARGEST)
    text = f"overshoot: {Pair(*overshoot, 'm/s')}; force: {Pair(*largest, 'N')}"
    return Found(all(0.5 < d / a < 2.0 for d, a in (overshoot, largest)), text)


@Measures("6-rest-without-delay")
def _RestWithoutDelay(runs: ThesisRuns) -> Found:
    direct, adaptive = (run[_SETTLING] for run in runs.ShortOfBoth(_THIRD, Delay(0.0)))
    text = f"direct {Seconds(direct)}, adaptive {Seconds(adaptive)}"
    return Found(direct is not None and adaptive is not None, text)


@Measures("6-delay-causes-overshoot")
def _DelayCausesOvershoot(runs: ThesisRuns) -> Found:
    tried = (runs("one_dof", DIRECT), runs.Short("one_dof", DIRECT, Delay(0.0)))
    overshoots = [1e3 * run.Number(_OVERSHOOT) for run in tried]
    hits = [1e3 * run.Number(_FIRST) for run in tried]
    return Found(
        overshoots[1] < overshoots[0] / 2 and hits[1] < hits[0] / 2,
        f"overshoot {overshoots[0]:.3g} to {overshoots[1]:.3g} mm/s, "
        f"first impact {hits[0]:.3g} to {hits[1]:.3g} mN",
    )


@Measures("6-outperforms")
def _Outperforms(runs: ThesisRuns) -> Found:
    worse = []
    compared = 0
    damper_better = 0
    for task in TASKS:
        for metric in _COMPARED:
            direct, adaptive = runs.OfBoth(task).Numbers(metric)
            # Not every task has every metric.
            if np.isnan(adaptive):
                continue
            compared += 1
            damper_better += runs(task, _DAMPER).Number(metric) < adaptive
            if adaptive > direct:
                worse.append(f"{task} {metric.split('.')[-1]}")
    return Found(
        not worse,
        "larger: " + (", ".join(worse) or "none"),
        f"Direct force with a damper against the command has {damper_better} of these "
        f"{compared} numbers smaller than the adaptive controller.",
    )


@Measures("6-higher-delays")
def _HigherDelays(runs: ThesisRuns) -> Found:
    direct, adaptive = runs.ShortOfBoth(_THIRD, Delay(0.2))
    fourfold = runs.Short(_THIRD, ADAPTIVE, Delay(0.4), {"duration": 6.0})
    overshoots = [run.Number(_OVERSHOOT) / 0.1 for run in (adaptive, fourfold)]
    settling = adaptive[_SETTLING]
    return Found(
        direct["diverged"]
        and not adaptive["diverged"]
        and settling is not None
        and overshoots[0] < 1.0,
        f"direct diverged at {Seconds(direct['diverged_at'])}; adaptive settled after "
        f"{Seconds(settling)}, overshoot {overshoots[0]:.0%} of v_d",
        "At 0.4 s each way adaptive still settles, with an overshoot of "
        f"{overshoots[1]:.0%} of v_d and a first impact of "
        f"{fourfold.Number(_FIRST):.3g} N.",
    )


@Measures("6-tuning-the-haptic-device")
def _TuningTheHapticDevice(runs: ThesisRuns) -> Found:
    change = {"haptic_device.numerator": [25.0, 5.0]}
    tried = (runs(_THIRD, ADAPTIVE), runs.Short(_THIRD, ADAPTIVE, change))
    overshoots = {
        metric.split(".")[0]: [run.Number(metric) for run in tried]
        for metric in _COMPARED[:2]
    }
    return Found(
        all(after < before / 2 for before, after in overshoots.values()),
        "; ".join(
            f"{name} {a:.3g} to {b:.3g} m/s" for name, (a, b) in overshoots.items()
        ),
    )


@Measures("6-slows-down")
def _SlowsDown(runs: ThesisRuns) -> Found:
    not_slower = []
    for task in TASKS:
        for metric in ("puncture.velocity", "collision.velocity"):
            direct, adaptive = runs.OfBoth(task).Numbers(metric)
            if adaptive >= 0.999 * direct:
                not_slower.append(f"{metric.split('.')[0]} in {task}")
    return Found(not not_slower, "not slower at: " + (", ".join(not_slower) or "none"))


@Measures("6-guarantees-stability")
def _GuaranteesStability(runs: ThesisRuns) -> Found:
    scenario = AsTeleoperation(LoadScenario(_THIRD, {**ADAPTIVE, **Delay(0.4)}))
    (moving,) = (x for x in OperatingPoints(scenario) if x.name == "free")
    at_rest = replace(moving, velocity=np.zeros_like(moving.velocity))
    loop = AnalyzeStability(scenario, points=[at_rest])["free"]
    root = loop.RightmostRoot(loop.delay)
    assert root is not None
    never = {"surgeon.contact_force": None, "duration": 16.0}
    ends = [
        runs(name, ADAPTIVE, Delay(0.5), never)["diverged_at"] for name in TASKS[2:]
    ]
    return Found(
        root.real < 0 and not any(ends),
        f"root {root.real:.3f} +- {abs(root.imag):.2f}j 1/s; case II diverged at "
        f"{Seconds(ends[0])}, case III at {Seconds(ends[1])}",
    )


@Measures("6-adds-robustness")
def _AddsRobustness(runs: ThesisRuns) -> Found:
    ratios = {}
    for title, (name, change) in _ENVIRONMENTS.items():
        tried = [runs(name, ADAPTIVE, change, x) for x in ({}, NO_ADAPTATION)]
        for metric in (*_COMPARED, _SETTLING):
            # NaN where neither has the metric, infinity where only one is 0 or never.
            values = [_OrNever(run, metric) for run in tried]
            if max(values) > 0 and min(values) < np.inf:
                label = f"{title}: {metric.split('.')[-1].replace('_', ' ')}"
                ratios[label] = values[0] / max(values[1], 1e-300)
    best, worst = (choose(ratios, key=lambda x: ratios[x]) for choose in (min, max))
    return Found(
        ratios[best] <= 0.9,
        f"best {ratios[best] - 1:+.1%} ({best}), worst {ratios[worst] - 1:+.1%} "
        f"({worst})",
    )


def _OrNever(run: Run, metric: str) -> float:
    """Returns a metric, infinity for a settling time that a run never reaches."""
    value = run.Number(metric)
    is_never = np.isnan(value) and metric.endswith("time") and run["collision"]
    return np.inf if is_never else value


@Measures("6-adaptation-matters")
def _AdaptationMatters(runs: ThesisRuns) -> Found:
    changes = {}
    for name in TASKS:
        silent, run = runs.Short(name, ADAPTIVE, NO_ADAPTATION), runs(name, ADAPTIVE)
        for metric in (*_COMPARED, "collision.rebound_velocity", _SETTLING):
            if silent[metric] is not None:
                ratio = silent.Number(metric) / run.Number(metric)
                changes[f"{name} {metric.split('.')[-1]}"] = ratio - 1
    largest = max(changes, key=lambda key: abs(changes[key]))
    text = f"largest change {changes[largest]:+.1%} ({largest})"
    return Found(max(changes.values()) >= 0.1, text)


def _Separate(name: str) -> Change:
    """Returns what takes the tuning functions out of a task's controller."""
    scenario = AsTeleoperation(LoadScenario(name))
    config = AdaptiveBacksteppingConfig.Of(scenario.controller)
    return {
        "controller.kind": SeparateUpdatesConfig.kind,
        "controller.parameters": dict(ToTree(config)),
    }


@Measures("6-tuning-functions-learn")
def _TuningFunctionsLearn(runs: ThesisRuns) -> Found:
    tried = [runs(LEARNING, x).recording for x in ({}, _Separate(LEARNING))]
    drift = WeightDrift(tried[0].teleoperation, INSIDE)
    left = [UnlearnedWeight(recording, INSIDE, drift) for recording in tried]
    beside = [1e3 * Rms(x, PathDistance(x)) for x in tried]
    return Found(
        left[0] <= 0.9 * left[1],
        f"{left[0]:.1%} with, {left[1]:.1%} without",
        "The tool is nearer to its path with them, though: "
        f"{beside[0]:.3g} against {beside[1]:.3g} mm (rms).",
    )


@Measures("6-tuning-functions-filter")
def _TuningFunctionsFilter(runs: ThesisRuns) -> Found:
    tuned, separate, silent = (
        runs(_THIRD, *changes)["control_force_variation"]
        for changes in ([ADAPTIVE], [_Separate(_THIRD)], [ADAPTIVE, NO_ADAPTATION])
    )
    return Found(
        all(a < b for a, b in zip(tuned, separate, strict=True)),
        f"with {Axes(tuned)}; without {Axes(separate)} N",
        f"It is lowest without any adaptation: {Axes(silent)} N.",
    )

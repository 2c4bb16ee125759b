"""Chapter 6 and the abstract: what the thesis concludes."""

from dataclasses import replace

import numpy as np

from teleop_drake.model.blocks.architectures.adaptive_backstepping import (
    AdaptiveBacksteppingConfig,
)
from teleop_drake.model.scenario import AsTeleoperation, LoadScenario
from teleop_drake.model.scenario.tree import ToTree
from teleop_drake.study.analysis.operating_point import OperatingPoints
from teleop_drake.study.analysis.stability import AnalyzeStability
from teleop_drake.thesis.claims.claim import Claim, Found, Seconds
from teleop_drake.thesis.claims.learning import (
    INSIDE,
    PathDistance,
    UnlearnedWeight,
    WeightDrift,
)
from teleop_drake.thesis.claims.measures import Rms
from teleop_drake.thesis.claims.relation import SETTLING, Axes, Pair, ValuesOf
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
"""Environments and initial estimates for which chapter 5 was not designed."""


def _ComparableWithoutDelay(runs: ThesisRuns) -> Found:
    both = runs.ShortOfBoth(_THIRD, Delay(0.0))
    overshoot = both.Numbers(_OVERSHOOT)
    largest = both.Numbers(_LARGEST)
    text = f"overshoot: {Pair(*overshoot, 'm/s')}; force: {Pair(*largest, 'N')}"
    return Found(all(0.5 < d / a < 2.0 for d, a in (overshoot, largest)), text)


def _RestWithoutDelay(runs: ThesisRuns) -> Found:
    both = runs.ShortOfBoth(_THIRD, Delay(0.0))
    direct, adaptive = (ValuesOf(both, x, SETTLING)[0] for x in both._fields)
    return Found(max(direct, adaptive) < np.inf, Pair(direct, adaptive, "s"))


def _DelayCausesOvershoot(runs: ThesisRuns) -> Found:
    tried = (runs("one_dof", DIRECT), runs.Short("one_dof", DIRECT, Delay(0.0)))
    overshoots = [1e3 * run.Number(_OVERSHOOT) for run in tried]
    hits = [1e3 * run.Number(_FIRST) for run in tried]
    return Found(
        overshoots[1] < overshoots[0] / 2 and hits[1] < hits[0] / 2,
        f"overshoot {overshoots[0]:.3g} to {overshoots[1]:.3g} mm/s, "
        f"first impact {hits[0]:.3g} to {hits[1]:.3g} mN",
    )


def _Outperforms(runs: ThesisRuns) -> Found:
    """Measures whether no compared metric is larger with the adaptive controller."""
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


def _HigherDelays(runs: ThesisRuns) -> Found:
    """Measures whether at 0.2 s each way adaptive settles and direct force diverges."""
    direct, adaptive = runs.ShortOfBoth(_THIRD, Delay(0.2))
    fourfold = runs.Short(_THIRD, ADAPTIVE, Delay(0.4), {"duration": 6.0})
    overshoots = [run.Number(_OVERSHOOT) / 0.1 for run in (adaptive, fourfold)]
    settling = adaptive[SETTLING]
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


def _SlowsDown(runs: ThesisRuns) -> Found:
    not_slower = []
    for task in TASKS:
        for metric in ("puncture.velocity", "collision.velocity"):
            direct, adaptive = runs.OfBoth(task).Numbers(metric)
            change = adaptive / direct - 1
            if change >= 0.01:  # Less is a tie.
                event = metric.split(".")[0]
                not_slower.append(f"{event} in {task} ({change:+.1%})")
    return Found(not not_slower, "faster at: " + (", ".join(not_slower) or "none"))


def _GuaranteesStability(runs: ThesisRuns) -> Found:
    """Measures whether the loop is stable at 0.4 s each way, and bounded at 0.5 s."""
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


def _AddsRobustness(runs: ThesisRuns) -> Found:
    """Measures whether adaptation lowers a metric in unknown environments."""
    ratios = {}
    for title, (name, change) in _ENVIRONMENTS.items():
        tried = [runs(name, ADAPTIVE, change, x) for x in ({}, NO_ADAPTATION)]
        for metric in (*_COMPARED, SETTLING):
            # A metric is skipped if no run has it (NaN), if it is 0 in both runs, or if
            # no run settles (infinity).
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
    """Returns a metric; infinity for the settling time of a run that never settles."""
    value = run.Number(metric)
    is_never = np.isnan(value) and metric.endswith("time") and run["collision"]
    return np.inf if is_never else value


def _AdaptationMatters(runs: ThesisRuns) -> Found:
    changes = {}
    for name in TASKS:
        silent = runs.Short(name, ADAPTIVE, NO_ADAPTATION)
        run = runs(name, ADAPTIVE)
        for metric in (*_COMPARED, "collision.rebound_velocity", SETTLING):
            if silent[metric] is not None:
                ratio = silent.Number(metric) / run.Number(metric)
                changes[f"{name} {metric.split('.')[-1]}"] = ratio - 1
    largest = max(changes, key=lambda key: abs(changes[key]))
    text = f"largest change {changes[largest]:+.1%} ({largest})"
    return Found(max(changes.values()) >= 0.1, text)


def _Separate(name: str) -> Change:
    """Returns the change that removes tuning functions from a task's controller."""
    scenario = AsTeleoperation(LoadScenario(name))
    config = AdaptiveBacksteppingConfig.Of(scenario.controller)
    return {
        "controller.kind": SeparateUpdatesConfig.kind,
        "controller.parameters": dict(ToTree(config)),
    }


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


CLAIMS = [
    Claim(
        key="6-comparable-without-delay",
        place="section 6.2",
        claim="Without delay both are comparable (case III): motion and forces.",
        criterion=(
            "puncture overshoot and largest force of one are less than twice "
            "those of the other"
        ),
        measure=_ComparableWithoutDelay,
    ),
    Claim(
        key="6-rest-without-delay",
        place="section 6.2",
        claim="Without delay both are comparable (case III): rest on the bone.",
        criterion="both come to rest (5 % of v_d)",
        reason="The bouncing of direct force is no effect of the delay.",
        measure=_RestWithoutDelay,
    ),
    Claim(
        key="6-delay-causes-overshoot",
        place="section 6.2",
        claim=(
            "Overshoot and collision force of direct force are effects of the "
            "delay (one axis)."
        ),
        criterion="without delay both fall to less than half",
        reason=(
            "Most of the overshoot is the haptic device's integrator, which "
            "still pushes against tissue that is no longer there. Without delay"
            " the constant force arrives during the first impact and adds to "
            "it."
        ),
        measure=_DelayCausesOvershoot,
    ),
    Claim(
        key="6-outperforms",
        place="section 6.2",
        claim=(
            "At 0.1 s each way the adaptive controller outperforms direct force"
            " completely."
        ),
        criterion=(
            "start overshoot, puncture overshoot, first impact and largest "
            "force are not larger in any of the four tasks"
        ),
        reason=(
            "A damper at the tool, against the commanded velocity, does most of it "
            "without a force sensor and without networks (docs/why_adaptive.md)."
        ),
        measure=_Outperforms,
    ),
    Claim(
        key="6-higher-delays",
        place="abstract",
        claim=(
            "At higher delays the adaptive controller still performs "
            "reasonably, while direct force is destabilised (case III, 0.2 s "
            "each way)."
        ),
        criterion=(
            "direct force diverges; adaptive ends, settles, and overshoots by "
            "less than v_d"
        ),
        measure=_HigherDelays,
    ),
    Claim(
        key="6-tuning-the-haptic-device",
        place="section 6.2",
        claim=(
            "Tuning the gains of the haptic device makes the adaptive "
            "controller more robust (case III)."
        ),
        criterion=(
            "with the integral gain at a tenth, start and puncture overshoot "
            "fall to less than half"
        ),
        measure=_TuningTheHapticDevice,
    ),
    Claim(
        key="6-slows-down",
        place="section 6.2",
        claim="The auxiliary error slows the tool down at puncture and collision.",
        criterion=(
            "slower than with direct force at every puncture and every first "
            "contact where the two differ by 1 % or more"
        ),
        reason=(
            "Before the contact there is no force error to speak of in s, and "
            "free motion is a matter of the surgeon's loop."
        ),
        measure=_SlowsDown,
    ),
    Claim(
        key="6-guarantees-stability",
        place="abstract; (4.44), (5.43)",
        claim="The design guarantees stability.",
        criterion=(
            "no root of the loop of case III, linearised at rest in free space "
            "with 0.4 s each way, lies right of the imaginary axis; and with "
            "0.5 s each way neither case II nor III diverges if the operator "
            "never switches to force"
        ),
        reason=(
            "The proof takes F_h and v_d as given signals that do not jump. The"
            " loop that the delay closes through the surgeon is not part of it."
        ),
        measure=_GuaranteesStability,
    ),
    Claim(
        key="6-adds-robustness",
        place="abstract",
        claim=(
            "The neural networks inherently add robustness to an unknown environment."
        ),
        criterion=(
            "in some of seven variations of bone, tissue and Psi0 an overshoot,"
            " a force on the bone or the settling time is lower by 10 % than "
            "without adaptation"
        ),
        reason="What the law bears, it bears with fixed gains.",
        measure=_AddsRobustness,
    ),
    Claim(
        key="6-adaptation-matters",
        place="abstract, 6.1",
        claim="The adapting networks bring about the improvement.",
        criterion=(
            "without adaptation some overshoot, force on the bone, rebound or "
            "settling time grows by 10 % or more"
        ),
        reason=(
            "The same law with all weights at 0 and Psi at Psi0, a linear "
            "controller with fixed gains, does as well."
        ),
        measure=_AdaptationMatters,
    ),
    Claim(
        key="6-tuning-functions-learn",
        place="section 2.6",
        claim="The tuning functions reduce the networks' approximation error.",
        criterion=(
            "in two_dof_learning, where the networks learn, less is unlearned, "
            "by 10 %, than where W1 and Psi adapt by s and W3 by z alone"
        ),
        measure=_TuningFunctionsLearn,
    ),
    Claim(
        key="6-tuning-functions-filter",
        place="abstract",
        claim=(
            "The tuning functions filter high frequencies and smooth the control force."
        ),
        criterion=(
            "in case III its total variation is lower on both axes than where "
            "W1 and Psi adapt by s and W3 by z alone"
        ),
        reason="The force is smooth because it is a state.",
        measure=_TuningFunctionsFilter,
    ),
]

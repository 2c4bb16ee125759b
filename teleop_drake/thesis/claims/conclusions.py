"""Chapter 6 and the abstract: what the thesis concludes."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from teleop_drake.analysis.operating_point import OperatingPoints
from teleop_drake.analysis.stability import AnalyzeStability
from teleop_drake.thesis.claims.claim import Row, Statement
from teleop_drake.thesis.claims.evidence import Both, Evidence, Run
from teleop_drake.thesis.claims.learning import (
    INSIDE,
    PathDistance,
    UnlearnedWeight,
    WeightDrift,
)
from teleop_drake.thesis.claims.measures import Rms
from teleop_drake.thesis.claims.requests import (
    ADAPTIVE,
    DIRECT,
    DOUBLE_DELAY,
    ENVIRONMENTS,
    FOURFOLD_DELAY,
    LEARNING,
    NEVER_SWITCHING,
    NO_ADAPTATION,
    NO_DELAY,
    RETUNED,
    TASKS,
    Separate,
)
from teleop_drake.thesis.claims.wording import Axes, Pair, Seconds

COMPARED = (
    "start_velocity_overshoot",
    "puncture.velocity_overshoot",
    "collision.initial_impact_force",
    "collision.peak_force",
)
"""The metrics that the thesis compares and in which lower is better."""


def Conclusions(evidence: Evidence) -> list[Row]:
    """Returns the rows of chapter 6 and of the abstract."""
    by_task = {name: evidence.Both(name) for name in TASKS}
    name = "two_dof_combined"
    no_delay = evidence.Both(name, NO_DELAY)
    double = evidence.Both(name, DOUBLE_DELAY)
    fourfold = evidence(name, ADAPTIVE, FOURFOLD_DELAY)
    return [
        *_WithoutDelay(no_delay),
        _DelayCausesOvershoot(
            by_task["one_dof"].direct, evidence("one_dof", DIRECT, NO_DELAY)
        ),
        _Outperforms(by_task),
        _HigherDelays(double, fourfold),
        _TuningTheHapticDevice(
            by_task[name].adaptive, evidence(name, ADAPTIVE, RETUNED)
        ),
        _SlowsDown(by_task),
        _GuaranteesStability(
            fourfold,
            [evidence(x, {**ADAPTIVE, **NEVER_SWITCHING}) for x in TASKS[2:]],
        ),
        _AddsRobustness(evidence),
        *_TuningFunctions(evidence),
    ]


def _WithoutDelay(both: Both) -> list[Row]:
    overshoot = both.Numbers("puncture.velocity_overshoot")
    peak = both.Numbers("collision.peak_force")
    settled = [run["collision.settling_time"] for run in both]
    return [
        Statement(
            key="6-comparable-without-delay",
            place="section 6.2",
            claim="Without delay both are comparable (case III): motion and forces.",
            criterion="puncture overshoot and largest force of one are less than twice "
            "those of the other",
            holds=all(0.5 < d / a < 2.0 for d, a in (overshoot, peak)),
            ours=f"overshoot: {Pair(*overshoot, unit='m/s')}; "
            f"force: {Pair(*peak, unit='N')}",
        ),
        Statement(
            key="6-rest-without-delay",
            place="section 6.2",
            claim="Without delay both are comparable (case III): rest on the bone.",
            criterion="both come to rest (5 % of v_d)",
            holds=all(time is not None for time in settled),
            ours=f"direct {Seconds(settled[0])}, adaptive {Seconds(settled[1])}",
            reason="The bouncing of direct force is no effect of the delay.",
        ),
    ]


def _DelayCausesOvershoot(delayed: Run, no_delay: Run) -> Row:
    runs = (delayed, no_delay)
    overshoots = [run.Number("puncture.velocity_overshoot") for run in runs]
    hits = [run.Number("collision.initial_impact_force") for run in runs]
    return Statement(
        key="6-delay-causes-overshoot",
        place="section 6.2",
        claim="Overshoot and collision force of direct force are effects of the delay "
        "(one axis).",
        criterion="without delay both fall to less than half",
        holds=overshoots[1] < overshoots[0] / 2 and hits[1] < hits[0] / 2,
        ours=f"overshoot {1e3 * overshoots[0]:.3g} to {1e3 * overshoots[1]:.3g} mm/s, "
        f"first impact {1e3 * hits[0]:.3g} to {1e3 * hits[1]:.3g} mN",
        reason="Most of the overshoot is the haptic device's integrator, which still "
        "pushes against tissue that is no longer there. Without delay the constant "
        "force arrives during the first impact and adds to it.",
    )


def _Outperforms(by_task: Mapping[str, Both]) -> Row:
    worse = [
        f"{task} {metric.split('.')[-1]}"
        for task, (direct, adaptive) in by_task.items()
        for metric in COMPARED
        if adaptive.Number(metric) > direct.Number(metric)
    ]
    return Statement(
        key="6-outperforms",
        place="section 6.2",
        claim="At 0.1 s each way the adaptive controller outperforms direct force "
        "completely.",
        criterion="start overshoot, puncture overshoot, first impact and largest force "
        "are not larger in any of the four tasks",
        holds=not worse,
        ours="larger: " + (", ".join(worse) or "none"),
        reason="See also the plain alternatives.",
    )


def _HigherDelays(double: Both, fourfold: Run) -> Row:
    direct, adaptive = double
    v_d = 0.1
    overshoots = [
        run.Number("puncture.velocity_overshoot") / v_d for run in (adaptive, fourfold)
    ]
    settling = adaptive["collision.settling_time"]
    return Statement(
        key="6-higher-delays",
        place="abstract",
        claim="At higher delays the adaptive controller still performs reasonably, "
        "while direct force is destabilised (case III, 0.2 s each way).",
        criterion="direct force diverges; adaptive ends, settles, and overshoots by "
        "less than v_d",
        holds=direct["diverged"]
        and not adaptive["diverged"]
        and settling is not None
        and overshoots[0] < 1.0,
        ours=f"direct diverged at {Seconds(direct['diverged_at'])}; adaptive settled "
        f"after {Seconds(settling)}, overshoot {overshoots[0]:.0%} of v_d",
        reason="At 0.4 s each way adaptive still settles, with an overshoot of "
        f"{overshoots[1]:.0%} of v_d and a first impact of "
        f"{fourfold.Number('collision.initial_impact_force'):.3g} N.",
    )


def _TuningTheHapticDevice(adaptive: Run, retuned: Run) -> Row:
    overshoots = {
        metric.split(".")[0]: (adaptive.Number(metric), retuned.Number(metric))
        for metric in COMPARED[:2]
    }
    return Statement(
        key="6-tuning-the-haptic-device",
        place="section 6.2",
        claim="Tuning the gains of the haptic device makes the adaptive controller "
        "more robust (case III).",
        criterion="with the integral gain at a tenth, start and puncture overshoot "
        "fall to less than half",
        holds=all(after < before / 2 for before, after in overshoots.values()),
        ours="; ".join(
            f"{name} {before:.3g} to {after:.3g} m/s"
            for name, (before, after) in overshoots.items()
        ),
    )


def _SlowsDown(by_task: Mapping[str, Both]) -> Row:
    not_slower = [
        f"{metric.split('.')[0]} in {task}"
        for task, (direct, adaptive) in by_task.items()
        for metric in ("puncture.velocity", "collision.velocity")
        if adaptive.Number(metric) >= 0.999 * direct.Number(metric)
    ]
    return Statement(
        key="6-slows-down",
        place="section 6.2",
        claim="The auxiliary error slows the tool down at puncture and collision.",
        criterion="slower than with direct force, by 0.1 % or more, at every puncture "
        "and every first contact",
        holds=not not_slower,
        ours="not slower at: " + (", ".join(not_slower) or "none"),
        reason="Before the contact there is no force error to speak of in s, and free "
        "motion is a matter of the surgeon's loop.",
    )


def _GuaranteesStability(fourfold: Run, never_switching: Sequence[Run]) -> Row:
    scenario = fourfold.recording.teleoperation
    (moving,) = (x for x in OperatingPoints(scenario) if x.name == "free")
    at_rest = replace(moving, velocity=np.zeros_like(moving.velocity))
    loop = AnalyzeStability(scenario, points=[at_rest])["free"]
    root = loop.RightmostRoot(loop.delay)
    assert root is not None
    ends = [run["diverged_at"] for run in never_switching]
    return Statement(
        key="6-guarantees-stability",
        place="abstract; (4.44), (5.43)",
        claim="The design guarantees stability.",
        criterion="no root of the loop of case III, linearised at rest in free space "
        "with 0.4 s each way, lies right of the imaginary axis; and with 0.5 s each "
        "way neither case II nor III diverges if the operator never switches to force",
        holds=root.real < 0 and not any(run["diverged"] for run in never_switching),
        ours=f"root {root.real:.3f} +- {abs(root.imag):.2f}j 1/s; case II diverged at "
        f"{Seconds(ends[0])}, case III at {Seconds(ends[1])}",
        reason="The proof takes F_h and v_d as given signals that do not jump. The "
        "loop that the delay closes through the surgeon is not part of it.",
    )


def _AddsRobustness(evidence: Evidence) -> Row:
    metrics = (*COMPARED, "collision.settling_time")
    ratios = {}
    for title, (name, change) in ENVIRONMENTS.items():
        with_, without = (
            evidence(name, {**ADAPTIVE, **change, **learning})
            for learning in ({}, NO_ADAPTATION)
        )
        for metric in metrics:
            # NaN where neither has the metric, infinity where only one is 0 or never.
            values = [_OrNever(run, metric) for run in (with_, without)]
            if max(values) > 0 and min(values) < np.inf:
                label = f"{title}: {metric.split('.')[-1].replace('_', ' ')}"
                ratios[label] = values[0] / max(values[1], 1e-300)
    best, worst = (choose(ratios, key=lambda x: ratios[x]) for choose in (min, max))
    return Statement(
        key="6-adds-robustness",
        place="abstract",
        claim="The neural networks inherently add robustness to an unknown "
        "environment.",
        criterion="in some of seven variations of bone, tissue and Psi0 an overshoot, "
        "a force on the bone or the settling time is lower by 10 % than without "
        "adaptation",
        holds=ratios[best] <= 0.9,
        ours=f"best {ratios[best] - 1:+.1%} ({best}), worst {ratios[worst] - 1:+.1%} "
        f"({worst})",
        reason="What the law bears, it bears with fixed gains.",
    )


def _OrNever(run: Run, metric: str) -> float:
    """Returns a metric, infinity for a settling time that a run never reaches."""
    value = run.Number(metric)
    is_never = np.isnan(value) and metric.endswith("time") and run["collision"]
    return np.inf if is_never else value


def _TuningFunctions(evidence: Evidence) -> list[Row]:
    name = TASKS[-1]
    tuned, separate, silent = (
        evidence(name, change)["control_force_variation"]
        for change in (ADAPTIVE, Separate(name), {**ADAPTIVE, **NO_ADAPTATION})
    )
    learned = [evidence(LEARNING, x).recording for x in ({}, Separate(LEARNING))]
    drift = WeightDrift(learned[0].teleoperation, INSIDE)
    left = [UnlearnedWeight(recording, INSIDE, drift) for recording in learned]
    beside = [1e3 * Rms(x, PathDistance(x)) for x in learned]
    return [
        Statement(
            key="6-tuning-functions-learn",
            place="section 2.6",
            claim="The tuning functions reduce the networks' approximation error.",
            criterion=f"in {LEARNING}, where the networks learn, less is unlearned, by "
            "10 %, than where W1 and Psi adapt by s and W3 by z alone",
            holds=left[0] <= 0.9 * left[1],
            ours=f"{left[0]:.1%} with, {left[1]:.1%} without",
            reason="The tool is nearer to its path with them, though: "
            f"{beside[0]:.3g} against {beside[1]:.3g} mm (rms).",
        ),
        Statement(
            key="6-tuning-functions-filter",
            place="abstract",
            claim="The tuning functions filter high frequencies and smooth the control "
            "force.",
            criterion="in case III its total variation is lower on both axes than "
            "where W1 and Psi adapt by s and W3 by z alone",
            holds=all(a < b for a, b in zip(tuned, separate, strict=True)),
            ours=f"with {Axes(tuned)}; without {Axes(separate)} N",
            reason=f"It is lowest without any adaptation: {Axes(silent)} N. The force "
            "is smooth because it is a state.",
        ),
    ]

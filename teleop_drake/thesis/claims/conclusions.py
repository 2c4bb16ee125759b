"""Chapter 6 and the abstract: what the thesis concludes."""

from collections.abc import Mapping

from teleop_drake.thesis.claims.claim import Row, Statement
from teleop_drake.thesis.claims.evidence import Both, Evidence, Run
from teleop_drake.thesis.claims.requests import (
    ADAPTIVE,
    DIRECT,
    DOUBLE_DELAY,
    FOURFOLD_DELAY,
    NO_DELAY,
    RETUNED,
    TASKS,
)
from teleop_drake.thesis.claims.wording import Pair, Seconds

COMPARED = (
    "start_velocity_overshoot",
    "puncture.velocity_overshoot",
    "collision.initial_impact_force",
    "collision.peak_force",
)
"""The metrics that the thesis compares and in which lower is better."""


def Conclusions(evidence: Evidence) -> list[Row]:
    """Returns the rows of chapter 6 and of the abstract.

    Args:
        evidence: Where the runs come from.
    """
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
            [
                *(both.adaptive for both in by_task.values()),
                no_delay.adaptive,
                double.adaptive,
                fourfold,
            ]
        ),
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


def _GuaranteesStability(runs: list[Run]) -> Row:
    diverged = sum(bool(run["diverged"]) for run in runs)
    return Statement(
        key="6-guarantees-stability",
        place="abstract; (4.44), (5.43)",
        claim="The design guarantees stability.",
        criterion="refuted if any run of the adaptive controller diverges; a run "
        "cannot prove it",
        holds=False if diverged else None,
        ours=f"{diverged} of {len(runs)} runs diverge",
        reason="The proof takes F_h and v_d as given signals that do not jump. The "
        "loop that the delay closes through the surgeon is not part of it.",
    )

"""Chapter 6 and the abstract: what the thesis concludes."""

from teleop_drake.thesis.claims.claim import Row, Truth
from teleop_drake.thesis.claims.evidence import Evidence
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

# What the thesis compares, and where lower is better.
COMPARED = (
    "start_velocity_overshoot",
    "puncture.velocity_overshoot",
    "collision.initial_impact_force",
    "collision.peak_force",
)


def Conclusions(evidence: Evidence) -> list[Row]:
    """Returns the rows of chapter 6 and of the abstract.

    Args:
        evidence: Where the runs come from.
    """
    base = {
        name: tuple(evidence(name, kind) for kind in (DIRECT, ADAPTIVE))
        for name in TASKS
    }
    name = "two_dof_combined"
    still_direct, still_adaptive = (
        evidence(name, kind, NO_DELAY) for kind in (DIRECT, ADAPTIVE)
    )
    slow_direct, slow_adaptive = (
        evidence(name, kind, DOUBLE_DELAY) for kind in (DIRECT, ADAPTIVE)
    )
    slower = evidence(name, ADAPTIVE, FOURFOLD_DELAY)
    retuned = evidence(name, ADAPTIVE, RETUNED)
    adaptive = base[name][1]
    worse = [
        f"{task} {metric.split('.')[-1]}"
        for task, (a, b) in base.items()
        for metric in COMPARED
        if b.Number(metric) > a.Number(metric)
    ]
    not_slower = [
        f"{metric.split('.')[0]} in {task}"
        for task, (a, b) in base.items()
        for metric in ("puncture.velocity", "collision.velocity")
        if b.Number(metric) >= 0.999 * a.Number(metric)
    ]
    d_over, a_over = (
        run.Number("puncture.velocity_overshoot")
        for run in (still_direct, still_adaptive)
    )
    d_peak, a_peak = (
        run.Number("collision.peak_force") for run in (still_direct, still_adaptive)
    )
    ratios = [d_over / a_over, d_peak / a_peak]
    settled = [run["collision.settling_time"] for run in (still_direct, still_adaptive)]
    one = base["one_dof"][0]
    one_still = evidence("one_dof", DIRECT, NO_DELAY)
    overs = [run.Number("puncture.velocity_overshoot") for run in (one, one_still)]
    hits = [run.Number("collision.initial_impact_force") for run in (one, one_still)]
    everything = [
        *(runs[1] for runs in base.values()),
        still_adaptive,
        slow_adaptive,
        slower,
    ]
    return [
        Truth(
            "6-comparable-without-delay",
            "section 6.2",
            "Without delay both are comparable (case III): motion and forces.",
            "puncture overshoot and largest force of one are less than twice those of "
            "the other",
            all(0.5 < ratio < 2.0 for ratio in ratios),
            f"overshoot: {Pair(d_over, a_over, unit='m/s')}; "
            f"force: {Pair(d_peak, a_peak, unit='N')}",
            "",
        ),
        Truth(
            "6-rest-without-delay",
            "section 6.2",
            "Without delay both are comparable (case III): rest on the bone.",
            "both come to rest (5 % of v_d)",
            all(time is not None for time in settled),
            f"direct {Seconds(settled[0])}, adaptive {Seconds(settled[1])}",
            "The bouncing of direct force is no effect of the delay.",
        ),
        Truth(
            "6-delay-causes-overshoot",
            "section 6.2",
            "Overshoot and collision force of direct force are effects of the delay "
            "(one axis).",
            "without delay both fall to less than half",
            overs[1] < overs[0] / 2 and hits[1] < hits[0] / 2,
            f"overshoot {1e3 * overs[0]:.3g} to {1e3 * overs[1]:.3g} mm/s, "
            f"first impact {1e3 * hits[0]:.3g} to {1e3 * hits[1]:.3g} mN",
            "Most of the overshoot is the haptic device's integrator, which still "
            "pushes against tissue that is no longer there. Without delay the "
            "constant force arrives during the first impact and adds to it.",
        ),
        Truth(
            "6-outperforms",
            "section 6.2",
            "At 0.1 s each way the adaptive controller outperforms direct force "
            "completely.",
            "start overshoot, puncture overshoot, first impact and largest force are "
            "not larger in any of the four tasks",
            not worse,
            "larger: " + (", ".join(worse) or "none"),
            "See also the plain alternatives.",
        ),
        Truth(
            "6-higher-delays",
            "abstract",
            "At higher delays the adaptive controller still performs reasonably, "
            "while direct force is destabilised (case III, 0.2 s each way).",
            "direct force diverges; adaptive ends, settles, and overshoots by less "
            "than v_d",
            slow_direct["diverged"]
            and not slow_adaptive["diverged"]
            and slow_adaptive["collision.settling_time"] is not None
            and slow_adaptive.Number("puncture.velocity_overshoot") < 0.1,
            f"direct diverged at {Seconds(slow_direct['diverged_at'])}; adaptive "
            f"settled after {Seconds(slow_adaptive['collision.settling_time'])}, "
            "overshoot "
            f"{slow_adaptive.Number('puncture.velocity_overshoot') / 0.1:.0%} of v_d",
            "At 0.4 s each way adaptive still settles, with an overshoot of "
            f"{slower.Number('puncture.velocity_overshoot') / 0.1:.0%} of v_d and a "
            "first impact of "
            f"{slower.Number('collision.initial_impact_force'):.3g} N.",
        ),
        Truth(
            "6-tuning-the-haptic-device",
            "section 6.2",
            "Tuning the gains of the haptic device makes the adaptive controller more "
            "robust (case III).",
            "with the integral gain at a tenth, start and puncture overshoot fall to "
            "less than half",
            all(
                retuned.Number(metric) < adaptive.Number(metric) / 2
                for metric in COMPARED[:2]
            ),
            "; ".join(
                f"{metric.split('.')[0]} {adaptive.Number(metric):.3g} to "
                f"{retuned.Number(metric):.3g} m/s"
                for metric in COMPARED[:2]
            ),
            "",
        ),
        Truth(
            "6-slows-down",
            "section 6.2",
            "The auxiliary error slows the tool down at puncture and collision.",
            "slower than with direct force, by 0.1 % or more, at every puncture and "
            "every first contact",
            not not_slower,
            "not slower at: " + (", ".join(not_slower) or "none"),
            "Before the contact there is no force error to speak of in s, and free "
            "motion is a matter of the surgeon's loop.",
        ),
        Truth(
            "6-guarantees-stability",
            "abstract; (4.44), (5.43)",
            "The design guarantees stability.",
            "refuted if any run of the adaptive controller diverges; a run cannot "
            "prove it",
            False if any(run["diverged"] for run in everything) else None,
            f"{sum(bool(run['diverged']) for run in everything)} of "
            f"{len(everything)} runs diverge",
            "The proof takes F_h and v_d as given signals that do not jump. The loop "
            "that the delay closes through the surgeon is not part of it.",
        ),
    ]

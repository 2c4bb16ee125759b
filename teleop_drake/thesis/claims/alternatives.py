"""Plain alternatives to the adaptive controller, in fairness."""

from teleop_drake.thesis.claims.claim import Row, Truth
from teleop_drake.thesis.claims.conclusions import COMPARED
from teleop_drake.thesis.claims.evidence import Evidence, Run
from teleop_drake.thesis.claims.measures import EarlyError
from teleop_drake.thesis.claims.requests import (
    ADAPTIVE,
    DIRECT,
    NO_ADAPTATION,
    RETUNED,
    TASKS,
)
from teleop_drake.thesis.claims.wording import Pair, Seconds


def Alternatives(evidence: Evidence) -> list[Row]:
    """Returns the rows of the alternatives; their keys begin with "A-".

    Args:
        evidence: Where the runs come from.
    """
    rows = []
    without = {
        name: evidence(name, ADAPTIVE, NO_ADAPTATION)
        for name in TASKS
        if name != "two_dof_puncture"
    }
    names = (*COMPARED[1:], "collision.rebound_velocity", "collision.settling_time")
    changes = {
        f"{name} {metric.split('.')[-1]}": abs(
            run.Number(metric) / evidence(name, ADAPTIVE).Number(metric) - 1
        )
        for name, run in without.items()
        for metric in names
        if run[metric] is not None
    }
    largest = max(changes, key=lambda key: changes[key])
    rows.append(
        Truth(
            "A-adaptation-matters",
            "plain alternative to chapters 4 and 5: no adaptation",
            "The adapting networks bring about the improvement.",
            "without adaptation some number of the collision tasks changes by 10 % or "
            "more",
            changes[largest] >= 0.1,
            f"largest change {changes[largest]:.1%} ({largest})",
            "The same law with all weights at 0 and Psi at Psi0, a linear controller "
            "with fixed gains, does as well.",
        )
    )
    for case, name in zip(("I", "II", "III"), TASKS[1:], strict=True):
        tuned, adaptive = evidence(name, DIRECT, RETUNED), evidence(name, ADAPTIVE)
        pairs = {
            metric: (tuned.Number(metric), adaptive.Number(metric))
            for metric in COMPARED[:3]
            if adaptive[metric] is not None
        }
        rows.append(
            Truth(
                f"A-{case}-retuned",
                f"plain alternative to section 5.2, case {case}: retuned haptic gain",
                "Direct force cannot do up to the first impact what the adaptive "
                "controller does.",
                "with the haptic device's integral gain at a tenth (25 s + 5), direct "
                "force diverges or is worse by 15 % or more in start overshoot, "
                "puncture overshoot or first impact",
                tuned["diverged"] or any(a >= 1.15 * b for a, b in pairs.values()),
                "; ".join(
                    f"{metric.split('.')[-1].replace('_', ' ')}: {Pair(a, b)}"
                    for metric, (a, b) in pairs.items()
                )
                + " (SI)",
                "Its price is the weaker integral action; rms of v_x - v_d(t - T_f) up "
                "to puncture or contact: "
                + Pair(EarlyError(tuned), EarlyError(adaptive), unit="m/s."),
            )
        )
    tuned_runs = [evidence(name, DIRECT, RETUNED) for name in TASKS]
    times = [run["collision.settling_time"] for run in tuned_runs if run["collision"]]
    rows.append(
        Truth(
            "A-rest-on-bone",
            "plain alternative to sections 4.2 and 5.2: retuned haptic gain",
            "Coming to rest on the bone needs the adaptive controller's law.",
            "direct force with the retuned haptic device does not come to rest either",
            all(time is None for time in times),
            ", ".join(Seconds(time) for time in times),
            "This advantage stands: the law feeds back the sensed force and the "
            "velocity at the slave, without delay. Nothing at the master can.",
        )
    )
    tuned, adaptive = tuned_runs[0], evidence("one_dof", ADAPTIVE)
    direct = evidence("one_dof", DIRECT)
    overshoots = [
        run.Number("puncture.velocity_overshoot") for run in (direct, tuned, adaptive)
    ]
    rows.append(
        Truth(
            "A-one-axis-overshoot",
            "plain alternative to section 4.2: retuned haptic gain",
            "The reduction of the overshoot needs the adaptive controller (one axis).",
            "direct force with the retuned haptic device overshoots by 15 % more or "
            "worse",
            overshoots[1] >= 1.15 * overshoots[2],
            f"direct {1e3 * overshoots[0]:.3g}, retuned {1e3 * overshoots[1]:.3g}, "
            f"adaptive {1e3 * overshoots[2]:.3g} mm/s",
            "The retuned device has no start overshoot, but reaches only "
            f"{tuned.Number('puncture.velocity') / 1e-3:.0%} of v_d by the puncture.",
        )
    )
    signs = [
        (
            direct.Number(f"collision.{metric}")
            - adaptive.Number(f"collision.{metric}"),
            printed,
        )
        for metric, printed in (
            ("initial_impact_force", 7.78e-3 - 9.42e-3),
            ("peak_force", 0.0113 - 9.42e-3),
            ("rebound_velocity", -0.72e-3 + 0.658e-3),
        )
    ]
    rows.append(
        Truth(
            "A-converged-solver",
            "plain alternative to section 4.2: a converged solver",
            "What the thesis concludes from its collision numbers does not hinge on "
            "its solver's tolerance.",
            "with the converged numbers first impact, largest force and rebound "
            "compare the same way",
            all(ours * printed > 0 for ours, printed in signs),
            f"first impact {Pair(*_Metric(direct, adaptive, 'initial_impact_force'))}"
            f" mN; largest {Pair(*_Metric(direct, adaptive, 'peak_force'))} mN; "
            f"rebound {Pair(*_Metric(direct, adaptive, 'rebound_velocity'))} mm/s",
            "",
        )
    )
    return rows


def _Metric(direct: Run, adaptive: Run, name: str) -> tuple[float, float]:
    """Returns a collision metric of both, times 1000."""
    return (
        1e3 * direct.Number(f"collision.{name}"),
        1e3 * adaptive.Number(f"collision.{name}"),
    )

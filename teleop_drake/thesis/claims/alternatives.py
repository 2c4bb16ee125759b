"""Plain alternatives to the adaptive controller, in fairness."""

from collections.abc import Mapping

from teleop_drake.thesis.claims.claim import Row, Statement
from teleop_drake.thesis.claims.conclusions import COMPARED
from teleop_drake.thesis.claims.evidence import Both, Evidence, Run
from teleop_drake.thesis.claims.measures import EarlyError
from teleop_drake.thesis.claims.requests import (
    ADAPTIVE,
    DAMPED,
    DAMPER,
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
    retuned = {name: evidence(name, DIRECT, RETUNED) for name in TASKS}
    one = evidence.Both("one_dof")
    return [
        _AdaptationMatters(evidence),
        *(
            _Retuned(case, retuned[name], evidence(name, ADAPTIVE))
            for case, name in zip(("I", "II", "III"), TASKS[1:], strict=True)
        ),
        _RestOnBone(evidence, retuned),
        _OneAxisOvershoot(one, retuned["one_dof"]),
        _ConvergedSolver(one),
    ]


def _AdaptationMatters(evidence: Evidence) -> Row:
    metrics = (*COMPARED, "collision.rebound_velocity", "collision.settling_time")
    changes = {}
    for name in TASKS:
        without, with_ = (
            evidence(name, ADAPTIVE, NO_ADAPTATION),
            evidence(name, ADAPTIVE),
        )
        for metric in metrics:
            if without[metric] is not None:
                ratio = without.Number(metric) / with_.Number(metric)
                changes[f"{name} {metric.split('.')[-1]}"] = ratio - 1
    largest = max(changes, key=lambda key: abs(changes[key]))
    return Statement(
        key="A-adaptation-matters",
        place="plain alternative to chapters 4 and 5: no adaptation",
        claim="The adapting networks bring about the improvement.",
        criterion="without adaptation some overshoot, force on the bone, rebound or "
        "settling time grows by 10 % or more",
        holds=max(changes.values()) >= 0.1,
        ours=f"largest change {changes[largest]:+.1%} ({largest})",
        reason="The same law with all weights at 0 and Psi at Psi0, a linear "
        "controller with fixed gains, does as well.",
    )


def _Retuned(case: str, retuned: Run, adaptive: Run) -> Row:
    pairs = {
        metric.split(".")[-1].replace("_", " "): (
            retuned.Number(metric),
            adaptive.Number(metric),
        )
        for metric in COMPARED[:3]
        if adaptive[metric] is not None
    }
    return Statement(
        key=f"A-{case}-retuned",
        place=f"plain alternative to section 5.2, case {case}: retuned haptic gain",
        claim="Direct force cannot do up to the first impact what the adaptive "
        "controller does.",
        criterion="with the haptic device's integral gain at a tenth (25 s + 5), "
        "direct force diverges or is worse by 15 % or more in start overshoot, "
        "puncture overshoot or first impact",
        holds=retuned["diverged"] or any(a >= 1.15 * b for a, b in pairs.values()),
        ours="; ".join(f"{name}: {Pair(a, b)}" for name, (a, b) in pairs.items())
        + " (SI)",
        reason="Its price is the weaker integral action; rms of v_x - v_d(t - T_f) up "
        "to puncture or contact: "
        f"{Pair(EarlyError(retuned), EarlyError(adaptive), unit='m/s')}.",
    )


def _RestOnBone(evidence: Evidence, retuned: Mapping[str, Run]) -> Row:
    tasks = [name for name, run in retuned.items() if run["collision"]]
    runs = {
        "retuned": [retuned[name] for name in tasks],
        "damped": [evidence(name, DAMPED, DAMPER) for name in tasks],
        "adaptive": [evidence(name, ADAPTIVE) for name in tasks],
    }
    times = {
        which: [run["collision.settling_time"] for run in group]
        for which, group in runs.items()
    }
    later = [
        damped.Number("collision.time") - adaptive.Number("collision.time")
        for damped, adaptive in zip(runs["damped"], runs["adaptive"], strict=True)
    ]
    return Statement(
        key="A-rest-on-bone",
        place="plain alternatives to sections 4.2 and 5.2: retuned haptic gain, local "
        "damper",
        claim="Coming to rest on the bone needs the adaptive controller's law.",
        criterion="direct force comes to rest in none of the collision tasks, neither "
        "with the retuned haptic device nor with a damper at the tool, "
        "F_c = F_h(t - T_f) - b v with b = 2 N s/m",
        holds=all(time is None for time in (*times["retuned"], *times["damped"])),
        ours="; ".join(
            f"{which} {', '.join(map(Seconds, group))}"
            for which, group in times.items()
        ),
        reason="The damper explains it: it feeds back the velocity at the slave, "
        "without delay, and needs neither a force sensor nor a network. With it the "
        f"tool gets to the bone {min(later):.2g} to {max(later):.2g} s later than with "
        "the adaptive controller. The retuned haptic device, which is at the master, "
        "does not help.",
    )


def _OneAxisOvershoot(one: Both, retuned: Run) -> Row:
    direct, tuned, adaptive = (
        run.Number("puncture.velocity_overshoot")
        for run in (one.direct, retuned, one.adaptive)
    )
    return Statement(
        key="A-one-axis-overshoot",
        place="plain alternative to section 4.2: retuned haptic gain",
        claim="The reduction of the overshoot needs the adaptive controller (one "
        "axis).",
        criterion="direct force with the retuned haptic device overshoots by 15 % more "
        "or worse",
        holds=tuned >= 1.15 * adaptive,
        ours=f"direct {1e3 * direct:.3g}, retuned {1e3 * tuned:.3g}, "
        f"adaptive {1e3 * adaptive:.3g} mm/s",
        reason="The retuned device has no start overshoot, but reaches only "
        f"{retuned.Number('puncture.velocity') / 1e-3:.0%} of v_d by the puncture.",
    )


def _ConvergedSolver(one: Both) -> Row:
    first = one.Numbers("collision.initial_impact_force")
    largest = one.Numbers("collision.peak_force")
    rebound = one.Numbers("collision.rebound_velocity")
    printed = ((7.78e-3, 9.42e-3), (0.0113, 9.42e-3), (-0.72e-3, -0.658e-3))
    return Statement(
        key="A-converged-solver",
        place="plain alternative to section 4.2: a converged solver",
        claim="What the thesis concludes from its collision numbers does not hinge on "
        "its solver's tolerance.",
        criterion="with the converged numbers first impact, largest force and rebound "
        "compare the same way",
        holds=all(
            (direct - adaptive) * (d_printed - a_printed) > 0
            for (direct, adaptive), (d_printed, a_printed) in zip(
                (first, largest, rebound), printed, strict=True
            )
        ),
        ours=f"first impact {Pair(*first, 1e3, 'mN')}; "
        f"largest {Pair(*largest, 1e3, 'mN')}; rebound {Pair(*rebound, 1e3, 'mm/s')}",
    )

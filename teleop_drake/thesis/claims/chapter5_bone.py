"""Chapter 5, two degrees of freedom: cases II and III, in which the tool meets bone."""

import itertools
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from teleop_drake.thesis.claims.chapter5_tissue import CASES, V_D
from teleop_drake.thesis.claims.claim import (
    Claim,
    Compared,
    Found,
    Listed,
    Seconds,
    Shares,
)
from teleop_drake.thesis.claims.measures import (
    During,
    FirstEvent,
    ImpactForces,
    LargestJump,
    PathError,
    RiseTime,
)
from teleop_drake.thesis.claims.relation import NEVER, SETTLING, Pair, Relation
from teleop_drake.thesis.runs import ADAPTIVE, Delay, ThesisRuns


def _SpeedAtContact(runs: ThesisRuns, task: str) -> str:
    speeds = Compared(runs, task).Numbers("collision.velocity")
    return f"Speed at the contact: {Pair(*speeds, 'm/s')}."


def _NoJumps(runs: ThesisRuns, task: str) -> Found:
    direct, adaptive = (LargestJump(run) for run in Compared(runs, task))
    return Found(adaptive < 0.01 * direct, Pair(direct, adaptive, "N"))


def _DirectPosition(runs: ThesisRuns, task: str) -> Found:
    direct, adaptive = (PathError(run.recording) for run in Compared(runs, task))
    return Found(
        (direct < 0.15).all(),
        Shares(direct),
        f"Adaptive: {Shares(adaptive)}.",
    )


def _DirectUnstable(runs: ThesisRuns, task: str, axis: str) -> Found:
    recording = Compared(runs, task).direct.recording
    contact = FirstEvent(recording, "contact")
    end = float(recording.time[-1])
    p = recording["tool_position"][:, "xy".index(axis)]
    away = np.abs(p - p[np.searchsorted(recording.time, contact)])
    early = away[During(recording, contact, contact + 2.0)].max()
    late = away[During(recording, end - 2.0, end)].max()
    return Found(late >= 1.1 * early, f"first {early:.3g}, last {late:.3g} m")


def _Sluggish(runs: ThesisRuns, task: str) -> Found:
    direct, adaptive = (RiseTime(run.recording) for run in Compared(runs, task))
    return Found(adaptive > direct, Pair(direct, adaptive, "s"))


def _StableOnBone(runs: ThesisRuns, task: str) -> Found:
    recording = Compared(runs, task).adaptive.recording
    asked = float(np.asarray(recording.teleoperation.surgeon.contact_force)[0])
    force = float(recording["environment_force"][-1, 0])
    speed = float(np.linalg.norm(recording["tool_velocity"][-1]))
    text = f"{force:.4g} N of {asked:g} N, {speed:.2g} m/s"
    return Found(abs(force / asked - 1) < 0.01 and speed < 0.01 * V_D, text)


def _DampsOut(runs: ThesisRuns) -> Found:
    run = Compared(runs, CASES["II"]).adaptive
    hits = ImpactForces(run.recording)
    settling = run[SETTLING]
    return Found(
        settling is not None and all(b < a for a, b in itertools.pairwise(hits)),
        f"{Listed(hits)} N; settled after {Seconds(settling)}",
    )


def _DirectImpactsGrow(runs: ThesisRuns) -> Found:
    hits = ImpactForces(Compared(runs, CASES["II"]).direct.recording)
    holds = len(hits) > 1 and min(hits[1:]) > hits[0]
    return Found(holds, f"{Listed(hits)} N")


def _LargerGains(runs: ThesisRuns) -> Found:
    gains = [{"controller.G1": 4.0 * x, "controller.G2": 30.0 * x} for x in (1.5, 2)]
    times = []
    errors = []
    for delay in ({}, Delay(0.0)):
        tried = [runs(CASES["II"], ADAPTIVE, x, delay) for x in ({}, *gains)]
        times.append(", ".join(Seconds(x[SETTLING]) for x in tried))
        errors.append([run["velocity_rms_error"][0] for run in tried])
    return Found(
        (np.diff(errors[0]) < 0).all(),
        f"{Listed(errors[0])} m/s; settled after {times[0]}",
        f"It is not the delay: without it the error is {Listed(errors[1])} m/s, and "
        f"the tool settles after {times[1]}.",
    )


# Texts of several claims.
_HALF_THE_ERROR = (
    "less than half the rms of v - v_d(t - T_f) of direct force on both axes"
)
_BOUNCES = (
    "Once the force is constant nothing feeds energy and nothing takes it: the "
    "tool goes on bouncing."
)
_FREE = "Nothing holds the tool there, with a delay or without."


def _InBothCases(
    key: str,
    figures: Sequence[str],
    *relations: Relation,
    claim: str,
    criterion: str,
    reason: str = "",
    measure: Callable[..., Found] | None = None,
    remark: Callable[..., str] | None = None,
) -> list[Claim]:
    """Returns two equal claims, for case II and for case III.

    Args:
        figures: The numbers of the figures in either case.
        relations: The relations of the runs of a case.
        measure: The measure, which takes the runs and the `task` of a case.
        remark: The remark, which takes the same.
    """
    return [
        Claim(
            key=f"5-{case}-{key}",
            place=f"section 5.2, case {case}, Fig. {figure}",
            claim=claim,
            criterion=criterion,
            reason=reason,
            task=CASES[case],
            relations=relations,
            measure=measure and partial(measure, task=CASES[case]),
            remark=remark and partial(remark, task=CASES[case]),
        )
        for case, figure in zip(("II", "III"), figures, strict=True)
    ]


CLAIMS = [
    Claim(
        key="5-II-tracking",
        place="section 5.2, case II, Fig. 5.7",
        claim=(
            "Adaptive tracks the velocity well on both axes, before and after "
            "the collision."
        ),
        criterion=_HALF_THE_ERROR,
        task=CASES["II"],
        relations=[Relation("velocity_rms_error", "m/s", factor=0.5)],
    ),
    Claim(
        key="5-III-tracking",
        place="section 5.2, case III, Fig. 5.14",
        claim="Adaptive tracks the velocity well on both axes.",
        criterion=_HALF_THE_ERROR,
        task=CASES["III"],
        relations=[Relation("velocity_rms_error", "m/s", factor=0.5)],
    ),
    *_InBothCases(
        "direct-never-converges",
        ("5.7", "5.14"),
        Relation(SETTLING, "s", factor=NEVER),
        claim="Direct force never converges; the adaptive controller does.",
        criterion="only the latter comes to rest (5 % of v_d) before the end",
        reason=(
            "A constant force on a spring without damping cannot come to "
            "rest, whatever the delay."
        ),
    ),
    *_InBothCases(
        "lower-first-impact",
        ("5.8", "5.15"),
        Relation("collision.initial_impact_force", "N", factor=0.75),
        remark=_SpeedAtContact,
        claim="The first impact is much weaker with the adaptive controller.",
        criterion="by at least a quarter",
        reason=(
            "Direct force swings, and where in its swing it meets the bone "
            "is a matter of the task."
        ),
    ),
    Claim(
        key="5-II-damps-out",
        place="section 5.2, case II, Fig. 5.8",
        claim="With the adaptive controller the impacts die out quickly.",
        criterion="each is weaker than the one before, and the tool settles",
        measure=_DampsOut,
    ),
    Claim(
        key="5-II-direct-impacts-grow",
        place="section 5.2, case II, Fig. 5.8",
        claim="With direct force the impacts grow with time.",
        criterion="every later one is stronger than the first",
        reason=(
            "They grow once, before the constant force has arrived. From then "
            "on the energy of arm and spring is constant: no growth for ever."
        ),
        measure=_DirectImpactsGrow,
    ),
    *_InBothCases(
        "direct-position",
        ("5.9", "5.16"),
        measure=_DirectPosition,
        claim="Direct force tracks the position well before the collision.",
        criterion="within 15 % of the way to the bone, on both axes",
        reason="The axes are coupled through M_r^-1, and the loop swings.",
    ),
    *(
        Claim(
            key=f"5-{case}-direct-unstable-{axis}",
            place=f"section 5.2, case {case}, Fig. {figure}",
            claim=f"Direct force is unstable along {axis} after the collision.",
            criterion=(
                "in the last two seconds the tool gets farther, by 10 % or "
                "more, from where it first touched the bone than in the first "
                "two"
            ),
            reason=reason,
            measure=partial(_DirectUnstable, task=CASES[case], axis=axis),
        )
        for case, axis, figure, reason in (
            ("II", "x", "5.9", _BOUNCES),
            ("II", "y", "5.9", _FREE),
            ("III", "x", "5.16", _BOUNCES),
            ("III", "y", "5.16", _FREE),
        )
    ),
    *_InBothCases(
        "sluggish",
        ("5.9", "5.16"),
        measure=_Sluggish,
        claim="The adaptive controller is sluggish at the start.",
        criterion="it takes longer to reach 90 % of v_d",
    ),
    *_InBothCases(
        "stable-on-bone",
        ("5.9", "5.16"),
        measure=_StableOnBone,
        claim="The adaptive controller reaches the bone and stays there.",
        criterion=(
            "in the end F_e is within 1 % of the commanded force, and the "
            "speed below 1 % of v_d"
        ),
    ),
    *_InBothCases(
        "less-force",
        ("5.10", "5.17"),
        Relation("control_force_peak", "N"),
        claim="Adaptive needs less control force.",
        criterion="lower peak on every axis",
        reason=(
            "The backstepping law pushes hard at the start and stops the "
            "bouncing with force."
        ),
    ),
    *_InBothCases(
        "less-variation",
        ("5.10", "5.17"),
        Relation("control_force_variation", "N"),
        claim="The adaptive controller's force is the smoother one: it moves less.",
        criterion="lower total variation on every axis",
    ),
    *_InBothCases(
        "no-jumps",
        ("5.10", "5.17"),
        measure=_NoJumps,
        claim=(
            "The adaptive controller's force is smooth; that of direct force is abrupt."
        ),
        criterion="its largest jump is below 1 % of that of direct force",
        reason="It is a state, so it cannot jump.",
    ),
    Claim(
        key="5-II-larger-gains",
        place="(4.51), (5.50)",
        claim="Larger gains G1 and G2 make the tracking error arbitrarily small.",
        criterion=(
            "in case II the rms of v_x - v_d(t - T_f) falls with 1.5 and again "
            "with twice the gains"
        ),
        reason=(
            "The law does not know dF_e/dt on the bone, and larger gains damp "
            "the tool less there."
        ),
        measure=_LargerGains,
    ),
]

"""Chapter 5: two degrees of freedom, cases I to III."""

import itertools

import numpy as np

from teleop_drake.thesis.claims.claim import Row, Statement
from teleop_drake.thesis.claims.evidence import Both, Evidence
from teleop_drake.thesis.claims.learning import UnrepresentedShare
from teleop_drake.thesis.claims.measures import (
    INSIDE_WORKSPACE,
    Amplitude,
    During,
    FirstEvent,
    ImpactForces,
    LargestJump,
    PathError,
    RiseTime,
    UnlearnedShare,
    WhileInside,
)
from teleop_drake.thesis.claims.requests import (
    ADAPTIVE,
    LARGER_GAINS,
    NO_DELAY,
    TASKS,
)
from teleop_drake.thesis.claims.wording import (
    BothAxes,
    BothSeconds,
    Listed,
    Pair,
    Seconds,
    Shares,
)

_V_D = 0.1
"""What the surgeon commands along x, m/s."""

_SECTION = "section 5.2, case"


def Chapter5(evidence: Evidence) -> list[Row]:
    """Returns the rows of chapter 5."""
    return [*CaseI(evidence), *CaseII(evidence), *CaseIII(evidence)]


def CaseI(evidence: Evidence) -> list[Row]:
    """Returns the rows of case I, the puncture."""
    full = evidence.Both("two_dof_puncture")
    inside = Both(*(WhileInside(run) for run in full))
    unlearned = UnlearnedShare(full.adaptive.recording)
    return [
        *_AdaptiveInTissue(inside),
        *_DirectInTissue(inside),
        _DirectDiverges(full, inside),
        Statement(
            key="5-I-tracking",
            place=f"{_SECTION} I, Fig. 5.1",
            claim="Adaptive tracks the velocity very well compared with direct force.",
            criterion="at most half the rms of v - v_d(t - T_f) on both axes, inside "
            "the workspace",
            holds=inside.IsBelow("velocity_rms_error", 0.5),
            ours=BothAxes(inside, "velocity_rms_error", "m/s"),
        ),
        *_LessForce(inside, "I", "Fig. 5.3", ", inside the workspace"),
        Statement(
            key="5-I-networks",
            place=f"{_SECTION} I, Fig. 5.4 to 5.6",
            claim="The networks work well and adapt quickly.",
            criterion="the third network leaves less than half of dF_e/dt (rms) "
            "unlearned",
            holds=unlearned < 0.5,
            ours=f"{unlearned:.1%} unlearned",
            reason="As with one axis, they stay almost silent.",
        ),
        _NoForceAlongY(evidence),
        _MoreFunctions(evidence),
    ]


def CaseII(evidence: Evidence) -> list[Row]:
    """Returns the rows of case II, the collision."""
    both = evidence.Both("two_dof_collision")
    return [
        *_Contact(both, "II", velocity="Fig. 5.7", force="Fig. 5.8"),
        *_Impacts(both),
        *_OnTheBone(both, "II", position="Fig. 5.9"),
        *_LessForce(both, "II", "Fig. 5.10"),
        _NoJumps(both, "II", "Fig. 5.10"),
        _LargerGains(evidence),
    ]


def CaseIII(evidence: Evidence) -> list[Row]:
    """Returns the rows of case III, puncture and collision."""
    both = evidence.Both("two_dof_combined")
    return [
        *_Contact(both, "III", velocity="Fig. 5.14", force="Fig. 5.15"),
        *_OnTheBone(both, "III", position="Fig. 5.16"),
        *_LessForce(both, "III", "Fig. 5.17"),
        _NoJumps(both, "III", "Fig. 5.17"),
    ]


# Case I.


def _AdaptiveInTissue(both: Both) -> list[Row]:
    run = both.adaptive
    puncture = run.Number("puncture.time")
    late = float(Amplitude(run.recording, puncture - 1.0, puncture)[0])
    start = float(run["start_velocity_overshoot"])
    return [
        Statement(
            key="5-I-smooth-start",
            place=f"{_SECTION} I, Fig. 5.1",
            claim="Adaptive reaches the commanded velocity in the tissue, smoothly.",
            criterion="|v_x - v_d| below 5 % of v_d in the last second before the "
            "puncture",
            holds=late < 0.05 * _V_D,
            ours=f"{late / _V_D:.1%}",
        ),
        Statement(
            key="5-I-no-overshoot",
            place=f"{_SECTION} I, Fig. 5.1",
            claim="Adaptive does so without any overshoot.",
            criterion="v_x exceeds v_d by less than 1 % of it before the puncture",
            holds=start < 0.01 * _V_D,
            ours=f"{start / _V_D:.1%}",
            reason="As with one axis, the surgeon's loop overshoots.",
        ),
    ]


def _DirectInTissue(both: Both) -> list[Row]:
    recording, puncture = both.direct.recording, both.direct.Number("puncture.time")
    v_x = recording["tool_velocity"][:, 0]
    is_above = v_x[During(recording, 0.0, puncture)] > _V_D
    crossings = int(np.count_nonzero(np.diff(is_above)))
    swing = float(np.ptp(v_x[During(recording, puncture - 1.0, puncture)]))
    d_speed, a_speed = both.Numbers("puncture.velocity")
    return [
        Statement(
            key="5-I-direct-oscillates",
            place=f"{_SECTION} I, Fig. 5.1",
            claim="Direct force oscillates about the commanded velocity in the tissue.",
            criterion="v_x crosses v_d three times or more, and still swings by 20 % "
            "of v_d in the last second before the puncture",
            holds=crossings >= 3 and swing > 0.2 * _V_D,
            ours=f"{crossings} crossings, {swing / _V_D:.0%} of v_d",
        ),
        Statement(
            key="5-I-direct-faster",
            place=f"{_SECTION} I, Fig. 5.1",
            claim="Direct force is faster at the puncture.",
            criterion="by more than 5 % of v_d",
            holds=d_speed > a_speed + 0.05 * _V_D,
            ours=Pair(d_speed, a_speed, unit="m/s"),
            reason="Where in its swing the puncture comes is a matter of the task.",
        ),
    ]


def _DirectDiverges(full: Both, inside: Both) -> Row:
    recording = inside.direct.recording
    puncture, end = inside.direct.Number("puncture.time"), float(recording.time[-1])
    early = float(Amplitude(recording, puncture, puncture + 1.0)[1])
    late = float(Amplitude(recording, end - 1.0, end)[1])
    return Statement(
        key="5-I-direct-diverges",
        place=f"{_SECTION} I, Fig. 5.1",
        claim="Direct force diverges after the puncture.",
        criterion="it exceeds five times v_d in the end, and |v_y| has at least "
        f"doubled before x = {INSIDE_WORKSPACE} m, one second against another",
        holds=full.direct["diverged"] and late > 2 * early,
        ours=f"amplitude of v_y {early:.3g} to {late:.3g} m/s, "
        f"ended at {Seconds(full.direct['diverged_at'])}",
        reason="The loop of haptic device and 0.2 s tolerates 4.7 1/kg in free space; "
        "M_r^-1 of the arm has an eigenvalue of 6. The stretched arm, at 1.5 m, ends "
        "either run soon after.",
    )


def _NoForceAlongY(evidence: Evidence) -> Row:
    forces = [
        run.recording["environment_force"][:, 1]
        for name in TASKS[1:]
        for run in evidence.Both(name)
    ]
    largest = max(float(np.abs(F).max()) for F in forces)
    return Statement(
        key="5-no-force-along-y",
        place="section 5.2, Fig. 5.2, 5.8, 5.15",
        claim="The sensed force along y is zero in all cases.",
        criterion="exactly, in all six runs",
        holds=largest == 0.0,
        ours=f"largest {largest:g} N",
        reason="By construction: the environment pushes along x only.",
    )


def _MoreFunctions(evidence: Evidence) -> Row:
    runs = [evidence(name, ADAPTIVE).recording for name in TASKS]
    shares = [[UnrepresentedShare(run, count=n) for run in runs] for n in (5, 9)]
    return Statement(
        key="5-more-functions",
        place="section 5.2, after (5.50)",
        claim="An appropriate number of basis functions reduces the approximation "
        "error.",
        criterion="with 9 functions per axis in the place of 5, constant weights "
        "chosen in hindsight leave less of dF_e/dt (rms), in cases I to III",
        holds=bool((np.diff(shares, axis=0)[0, 1:] < 0).all()),
        ours="; ".join(
            f"{case}: {', '.join(f'{x:.0%}' for x in left)}"
            for case, left in zip(
                ("I", "II", "III"), np.transpose(shares)[1:], strict=True
            )
        ),
        reason="What can be represented is not what is learned: see 5-I-networks. On "
        f"one axis {shares[-1][0]:.0%} is left with either, because dF_e/dt is no "
        "function of the position.",
    )


# Cases II and III.


def _Contact(both: Both, case: str, *, velocity: str, force: str) -> list[Row]:
    d_first, a_first = both.Numbers("collision.initial_impact_force")
    d_settling, a_settling = (run["collision.settling_time"] for run in both)
    return [
        Statement(
            key=f"5-{case}-tracking",
            place=f"{_SECTION} {case}, {velocity}",
            claim="Adaptive tracks the velocity well on both axes"
            + (", before and after the collision." if case == "II" else "."),
            criterion="at most half the rms of v - v_d(t - T_f) of direct force on "
            "both axes",
            holds=both.IsBelow("velocity_rms_error", 0.5),
            ours=BothAxes(both, "velocity_rms_error", "m/s"),
        ),
        Statement(
            key=f"5-{case}-direct-never-converges",
            place=f"{_SECTION} {case}, {velocity}",
            claim="Direct force never converges; the adaptive controller does.",
            criterion="only the latter comes to rest (5 % of v_d) before the end",
            holds=d_settling is None and a_settling is not None,
            ours=BothSeconds(both, "collision.settling_time"),
            reason="A constant force on a spring without damping cannot come to rest, "
            "whatever the delay.",
        ),
        Statement(
            key=f"5-{case}-lower-first-impact",
            place=f"{_SECTION} {case}, {force}",
            claim="The first impact is much weaker with the adaptive controller.",
            criterion="by at least a quarter",
            holds=a_first <= 0.75 * d_first,
            ours=Pair(d_first, a_first, unit="N"),
            reason="Speed at the contact: "
            f"{Pair(*both.Numbers('collision.velocity'), unit='m/s')}. Direct force "
            "swings, and where in its swing it meets the bone is a matter of the task.",
        ),
    ]


def _Impacts(both: Both) -> list[Row]:
    d_hits, a_hits = (ImpactForces(run.recording) for run in both)
    settling = both.adaptive["collision.settling_time"]
    return [
        Statement(
            key="5-II-damps-out",
            place=f"{_SECTION} II, Fig. 5.8",
            claim="With the adaptive controller the impacts die out quickly.",
            criterion="each is weaker than the one before, and the tool settles",
            holds=settling is not None
            and all(b < a for a, b in itertools.pairwise(a_hits)),
            ours=f"{Listed(a_hits)} N; settled after {Seconds(settling)}",
        ),
        Statement(
            key="5-II-direct-impacts-grow",
            place=f"{_SECTION} II, Fig. 5.8",
            claim="With direct force the impacts grow with time.",
            criterion="every later one is stronger than the first",
            holds=len(d_hits) > 1 and min(d_hits[1:]) > d_hits[0],
            ours=f"{Listed(d_hits)} N",
            reason="They grow once, before the constant force has arrived. From then "
            "on the energy of arm and spring is constant: no growth for ever.",
        ),
    ]


def _OnTheBone(both: Both, case: str, *, position: str) -> list[Row]:
    place = f"{_SECTION} {case}, {position}"
    d_way, a_way = (PathError(run.recording) for run in both)
    d_rise, a_rise = (RiseTime(run.recording) for run in both)
    adaptive = both.adaptive.recording
    contact_force = float(np.asarray(adaptive.teleoperation.surgeon.contact_force)[0])
    final_force = float(adaptive["environment_force"][-1, 0])
    final_speed = float(np.linalg.norm(adaptive["tool_velocity"][-1]))
    return [
        Statement(
            key=f"5-{case}-direct-position",
            place=place,
            claim="Direct force tracks the position well before the collision.",
            criterion="within 15 % of the way to the bone, on both axes",
            holds=bool((d_way < 0.15).all()),
            ours=Shares(d_way),
            reason="The axes are coupled through M_r^-1, and the loop swings. "
            f"Adaptive: {Shares(a_way)}.",
        ),
        *_DirectUnstable(both, case, place),
        Statement(
            key=f"5-{case}-sluggish",
            place=place,
            claim="The adaptive controller is sluggish at the start.",
            criterion="it takes longer to reach 90 % of v_d",
            holds=a_rise > d_rise,
            ours=Pair(d_rise, a_rise, unit="s"),
        ),
        Statement(
            key=f"5-{case}-stable-on-bone",
            place=place,
            claim="The adaptive controller reaches the bone and stays there.",
            criterion="in the end F_e is within 1 % of the commanded force, and the "
            "speed below 1 % of v_d",
            holds=abs(final_force / contact_force - 1) < 0.01
            and final_speed < 0.01 * _V_D,
            ours=f"{final_force:.4g} N of {contact_force:g} N, {final_speed:.2g} m/s",
        ),
    ]


def _DirectUnstable(both: Both, case: str, place: str) -> list[Row]:
    recording = both.direct.recording
    contact, end = FirstEvent(recording, "contact"), float(recording.time[-1])
    p = recording["tool_position"]
    away = np.abs(p - p[np.searchsorted(recording.time, contact)])
    windows = ((contact, contact + 2.0), (end - 2.0, end))
    early, late = (away[During(recording, *x)].max(axis=0) for x in windows)
    reasons = {
        "x": "Once the force is constant nothing feeds energy and nothing takes it: "
        "the tool goes on bouncing.",
        "y": "Nothing holds the tool there, with a delay or without.",
    }
    return [
        Statement(
            key=f"5-{case}-direct-unstable-{axis}",
            place=place,
            claim=f"Direct force is unstable along {axis} after the collision.",
            criterion="in the last two seconds the tool gets farther, by 10 % or more, "
            "from where it first touched the bone than in the first two",
            holds=late[i] >= 1.1 * early[i],
            ours=f"first {early[i]:.3g}, last {late[i]:.3g} m",
            reason=reasons[axis],
        )
        for i, axis in enumerate("xy")
    ]


def _LargerGains(evidence: Evidence) -> Row:
    name = "two_dof_collision"
    times, errors = [], []
    for delay in ({}, NO_DELAY):
        runs = [evidence(name, {**ADAPTIVE, **x, **delay}) for x in ({}, *LARGER_GAINS)]
        times.append(", ".join(Seconds(x["collision.settling_time"]) for x in runs))
        errors.append([run["velocity_rms_error"][0] for run in runs])
    return Statement(
        key="5-II-larger-gains",
        place="(4.51), (5.50)",
        claim="Larger gains G1 and G2 make the tracking error arbitrarily small.",
        criterion="in case II the rms of v_x - v_d(t - T_f) falls with 1.5 and again "
        "with twice the gains",
        holds=bool((np.diff(errors[0]) < 0).all()),
        ours=f"{Listed(errors[0])} m/s; settled after {times[0]}",
        reason="It is not the delay: without it the error is "
        f"{Listed(errors[1])} m/s, and the tool settles after {times[1]}. The law does "
        "not know dF_e/dt on the bone, and larger gains damp the tool less there.",
    )


# Every case.


def _LessForce(both: Both, case: str, figure: str, inside: str = "") -> list[Row]:
    return [
        Statement(
            key=f"5-{case}-less-force",
            place=f"{_SECTION} {case}, {figure}",
            claim="Adaptive needs less control force.",
            criterion=f"lower peak on every axis{inside}",
            holds=both.IsBelow("control_force_peak"),
            ours=BothAxes(both, "control_force_peak", "N"),
            reason="The backstepping law pushes hard at the start and stops the "
            "bouncing with force.",
        ),
        Statement(
            key=f"5-{case}-less-variation",
            place=f"{_SECTION} {case}, {figure}",
            claim="The adaptive controller's force is the smoother one: it moves less.",
            criterion=f"lower total variation on every axis{inside}",
            holds=both.IsBelow("control_force_variation"),
            ours=BothAxes(both, "control_force_variation", "N"),
        ),
    ]


def _NoJumps(both: Both, case: str, figure: str) -> Row:
    direct, adaptive = (LargestJump(run.recording) for run in both)
    return Statement(
        key=f"5-{case}-no-jumps",
        place=f"{_SECTION} {case}, {figure}",
        claim="The adaptive controller's force is smooth; that of direct force is "
        "abrupt.",
        criterion="its largest jump is below 1 % of that of direct force",
        holds=adaptive < 0.01 * direct,
        ours=Pair(direct, adaptive, unit="N"),
        reason="It is a state, so it cannot jump.",
    )

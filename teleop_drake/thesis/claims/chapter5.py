"""Chapter 5: two degrees of freedom, cases I to III."""

import itertools
from collections.abc import Sequence

import numpy as np

from teleop_drake.thesis.claims.claim import Row, Truth
from teleop_drake.thesis.claims.evidence import Evidence, Run
from teleop_drake.thesis.claims.measures import (
    INSIDE_WORKSPACE,
    Amplitude,
    During,
    FirstEvent,
    ImpactForces,
    IsBelow,
    LargestJump,
    PathError,
    RiseTime,
    UnlearnedShare,
    WhileInside,
)
from teleop_drake.thesis.claims.requests import ADAPTIVE, DIRECT, TASKS
from teleop_drake.thesis.claims.wording import Axes, BothAxes, Pair, Seconds, Shares


def Puncture(evidence: Evidence) -> list[Row]:
    """Returns the rows of case I.

    Args:
        evidence: Where the runs come from.
    """
    full_direct, full_adaptive = (
        evidence("two_dof_puncture", kind) for kind in (DIRECT, ADAPTIVE)
    )
    direct, adaptive = WhileInside(full_direct), WhileInside(full_adaptive)
    v_d = 0.1
    t_direct, t_adaptive = (run.Number("puncture.time") for run in (direct, adaptive))
    before = During(direct.recording, 0.0, t_direct)
    v_x = direct.recording["tool_velocity"][before, 0]
    crossings = int(np.count_nonzero(np.diff(v_x > v_d)))
    last = During(direct.recording, t_direct - 1.0, t_direct)
    swing = float(np.ptp(direct.recording["tool_velocity"][last, 0]))
    late = float(Amplitude(adaptive.recording, t_adaptive - 1.0, t_adaptive)[0])
    end = float(direct.recording.time[-1])
    early_y = float(Amplitude(direct.recording, t_direct, t_direct + 1.0)[1])
    late_y = float(Amplitude(direct.recording, end - 1.0, end)[1])
    d_speed, a_speed = (run.Number("puncture.velocity") for run in (direct, adaptive))
    forces = [
        evidence(name, kind).recording["environment_force"][:, 1]
        for name in TASKS[1:]
        for kind in (DIRECT, ADAPTIVE)
    ]
    largest_y = max(float(np.abs(F).max()) for F in forces)
    unlearned = UnlearnedShare(full_adaptive.recording)
    start = float(adaptive["start_velocity_overshoot"])
    section = "section 5.2, case I"
    return [
        Truth(
            "5-I-smooth-start",
            f"{section}, Fig. 5.1",
            "Adaptive reaches the commanded velocity in the tissue, smoothly.",
            "|v_x - v_d| below 5 % of v_d in the last second before the puncture",
            late < 0.05 * v_d,
            f"{late / v_d:.1%}",
            "",
        ),
        Truth(
            "5-I-no-overshoot",
            f"{section}, Fig. 5.1",
            "Adaptive does so without any overshoot.",
            "v_x exceeds v_d by less than 1 % of it before the puncture",
            start < 0.01 * v_d,
            f"{start / v_d:.1%}",
            "As with one axis, the surgeon's loop overshoots.",
        ),
        Truth(
            "5-I-direct-oscillates",
            f"{section}, Fig. 5.1",
            "Direct force oscillates about the commanded velocity in the tissue.",
            "v_x crosses v_d three times or more, and still swings by 20 % of v_d in "
            "the last second before the puncture",
            crossings >= 3 and swing > 0.2 * v_d,
            f"{crossings} crossings, {swing / v_d:.0%} of v_d",
            "",
        ),
        Truth(
            "5-I-direct-faster",
            f"{section}, Fig. 5.1",
            "Direct force is faster at the puncture.",
            "by more than 5 % of v_d",
            d_speed > a_speed + 0.05 * v_d,
            Pair(d_speed, a_speed, unit="m/s"),
            "Where in its swing the puncture comes is a matter of the task.",
        ),
        Truth(
            "5-I-direct-diverges",
            f"{section}, Fig. 5.1",
            "Direct force diverges after the puncture.",
            "it exceeds five times v_d in the end, and |v_y| has at least doubled "
            f"before x = {INSIDE_WORKSPACE} m, one second against another",
            full_direct["diverged"] and late_y > 2 * early_y,
            f"amplitude of v_y {early_y:.3g} to {late_y:.3g} m/s, "
            f"ended at {Seconds(full_direct['diverged_at'])}",
            "The loop of haptic device and 0.2 s tolerates 4.7 1/kg in free space; "
            "M_r^-1 of the arm has an eigenvalue of 6. The stretched arm, at 1.5 m, "
            "ends either run soon after.",
        ),
        Truth(
            "5-I-tracking",
            f"{section}, Fig. 5.1",
            "Adaptive tracks the velocity very well compared with direct force.",
            "at most half the rms of v - v_d(t - T_f) on both axes, inside the "
            "workspace",
            IsBelow(adaptive, direct, "velocity_rms_error", 0.5),
            BothAxes(direct, adaptive, "velocity_rms_error", "m/s"),
            "",
        ),
        *_ControlForce("I", section, "Fig. 5.3", direct, adaptive),
        Truth(
            "5-I-networks",
            f"{section}, Fig. 5.4 to 5.6",
            "The networks work well and adapt quickly.",
            "the third network leaves less than half of dF_e/dt (rms) unlearned",
            unlearned < 0.5,
            f"{unlearned:.1%} unlearned",
            "As with one axis, they stay almost silent.",
        ),
        Truth(
            "5-no-force-along-y",
            "section 5.2, Fig. 5.2, 5.8, 5.15",
            "The sensed force along y is zero in all cases.",
            "exactly, in all six runs",
            largest_y == 0.0,
            f"largest {largest_y:g} N",
            "By construction: the environment pushes along x only.",
        ),
    ]


def _ControlForce(
    case: str, section: str, figure: str, direct: Run, adaptive: Run
) -> list[Row]:
    """The claims that the thesis makes about the control force in every case."""
    inside = ", inside the workspace" if case == "I" else ""
    rows = [
        Truth(
            f"5-{case}-less-force",
            f"{section}, {figure}",
            "Adaptive needs less control force.",
            f"lower peak on every axis{inside}",
            IsBelow(adaptive, direct, "control_force_peak"),
            BothAxes(direct, adaptive, "control_force_peak", "N"),
            "The backstepping law pushes hard at the start and stops the bouncing "
            "with force.",
        ),
        Truth(
            f"5-{case}-less-variation",
            f"{section}, {figure}",
            "The adaptive controller's force is the smoother one: it moves less.",
            f"lower total variation on every axis{inside}",
            IsBelow(adaptive, direct, "control_force_variation"),
            BothAxes(direct, adaptive, "control_force_variation", "N"),
            "",
        ),
    ]
    if case != "I":
        d_jump, a_jump = (LargestJump(run.recording) for run in (direct, adaptive))
        rows.append(
            Truth(
                f"5-{case}-no-jumps",
                f"{section}, {figure}",
                "The adaptive controller's force is smooth; that of direct force is "
                "abrupt.",
                "its largest jump is below 1 % of that of direct force",
                a_jump < 0.01 * d_jump,
                Pair(d_jump, a_jump, unit="N"),
                "It is a state, so it cannot jump.",
            )
        )
    return rows


def Bone(evidence: Evidence, case: str, name: str, figures: Sequence[str]) -> list[Row]:
    """Returns the rows of case II or III: the collision.

    Args:
        evidence: Where the runs come from.
        case: "II" or "III".
        name: The task.
        figures: Numbers of the figures that show velocity, force, position and control
            force, without the chapter's.
    """
    direct, adaptive = (evidence(name, kind) for kind in (DIRECT, ADAPTIVE))
    velocity, force, position, control = (f"Fig. 5.{figure}" for figure in figures)
    section = f"section 5.2, case {case}"
    v_d = 0.1
    d_first, a_first = (
        run.Number("collision.initial_impact_force") for run in (direct, adaptive)
    )
    d_settling, a_settling = (
        run["collision.settling_time"] for run in (direct, adaptive)
    )
    d_hits, a_hits = (ImpactForces(run.recording) for run in (direct, adaptive))
    switch = FirstEvent(direct.recording, "surgeon_force")
    end = float(direct.recording.time[-1])
    v = np.abs(direct.recording["tool_velocity"])
    # From when the constant force has arrived at the slave.
    begin = switch + direct.recording.scenario.forward_channel.delay
    early, late = (
        v[During(direct.recording, a, b)].max(axis=0, initial=0.0)
        for a, b in ((begin, begin + 2.0), (end - 2.0, end))
    )
    way = PathError(direct.recording)
    d_rise, a_rise = (RiseTime(run.recording) for run in (direct, adaptive))
    contact_force = float(adaptive.recording.scenario.surgeon.contact_force[0])
    final_force = float(adaptive.recording["environment_force"][-1, 0])
    final_speed = float(np.linalg.norm(adaptive.recording["tool_velocity"][-1]))
    rows = [
        Truth(
            f"5-{case}-tracking",
            f"{section}, {velocity}",
            "Adaptive tracks the velocity well on both axes, before and after the "
            "collision.",
            "at most half the rms of v - v_d(t - T_f) of direct force on both axes",
            IsBelow(adaptive, direct, "velocity_rms_error", 0.5),
            BothAxes(direct, adaptive, "velocity_rms_error", "m/s"),
            "",
        ),
        Truth(
            f"5-{case}-direct-never-converges",
            f"{section}, {velocity}",
            "Direct force never converges; the adaptive controller does.",
            "only the latter comes to rest (5 % of v_d) before the end",
            d_settling is None and a_settling is not None,
            f"direct {Seconds(d_settling)}, adaptive {Seconds(a_settling)}",
            "A constant force on a spring without damping cannot come to rest, "
            "whatever the delay.",
        ),
        Truth(
            f"5-{case}-lower-first-impact",
            f"{section}, {force}",
            "The first impact is much weaker with the adaptive controller.",
            "by at least a quarter",
            a_first <= 0.75 * d_first,
            Pair(d_first, a_first, unit="N"),
            "Speed at the contact: "
            + Pair(
                direct.Number("collision.velocity"),
                adaptive.Number("collision.velocity"),
                unit="m/s.",
            )
            + " Direct force swings, and where in its swing it meets the bone is a "
            "matter of the task.",
        ),
    ]
    if case == "II":
        rows += [
            Truth(
                "5-II-damps-out",
                f"{section}, {force}",
                "With the adaptive controller the impacts die out quickly.",
                "each is weaker than the one before, and the tool settles",
                a_settling is not None
                and all(b < a for a, b in itertools.pairwise(a_hits)),
                ", ".join(f"{hit:.3g}" for hit in a_hits)
                + f" N; settled after {Seconds(a_settling)}",
                "",
            ),
            Truth(
                "5-II-direct-impacts-grow",
                f"{section}, {force}",
                "With direct force the impacts grow with time.",
                "every later one is stronger than the first",
                len(d_hits) > 1 and min(d_hits[1:]) > d_hits[0],
                ", ".join(f"{hit:.3g}" for hit in d_hits) + " N",
                "They grow once, before the constant force has arrived. From then on "
                "the energy of arm and spring is constant: no growth for ever.",
            ),
        ]
    rows += [
        Truth(
            f"5-{case}-direct-position",
            f"{section}, {position}",
            "Direct force tracks the position well before the collision.",
            "within 15 % of the way to the bone, on both axes",
            bool((way < 0.15).all()),
            Shares(way),
            "The axes are coupled through M_r^-1, and the loop swings. Adaptive: "
            f"{Shares(PathError(adaptive.recording))}.",
        ),
        Truth(
            f"5-{case}-direct-unstable",
            f"{section}, {position}",
            "Direct force is unstable on both axes after the collision.",
            "the largest speed of the last two seconds exceeds that of the first two "
            "after the constant force has arrived, on both axes",
            bool((late > early).all()),
            f"first {Axes(early)}; last {Axes(late)} m/s",
            "Once the force is constant nothing feeds energy and nothing takes it: the "
            "tool goes on bouncing, and off the line along y, to "
            f"{direct.recording['tool_position'][-1, 1]:.2g} m at the end, but its "
            "speed is bounded.",
        ),
        Truth(
            f"5-{case}-sluggish",
            f"{section}, {position}",
            "The adaptive controller is sluggish at the start.",
            "it takes longer to reach 90 % of v_d",
            a_rise > d_rise,
            Pair(d_rise, a_rise, unit="s"),
            "",
        ),
        Truth(
            f"5-{case}-stable-on-bone",
            f"{section}, {position}",
            "The adaptive controller reaches the bone and stays there.",
            "in the end F_e is within 1 % of the commanded force, and the speed below "
            "1 % of v_d",
            abs(final_force / contact_force - 1) < 0.01 and final_speed < 0.01 * v_d,
            f"{final_force:.4g} N of {contact_force:g} N, {final_speed:.2g} m/s",
            "",
        ),
        *_ControlForce(case, section, control, direct, adaptive),
    ]
    return rows

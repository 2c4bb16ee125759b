"""Chapter 4: one degree of freedom."""

import math

import numpy as np

from teleop_drake.thesis.claims.claim import Number, Row, Truth
from teleop_drake.thesis.claims.evidence import Evidence
from teleop_drake.thesis.claims.measures import FarShare, LargestJump, UnlearnedShare
from teleop_drake.thesis.claims.requests import ADAPTIVE, DIRECT, NO_DELAY
from teleop_drake.thesis.claims.wording import Pair, Seconds


def OneAxis(evidence: Evidence) -> list[Row]:
    """Returns the rows of chapter 4.

    Args:
        evidence: Where the runs come from.
    """
    direct, adaptive = (evidence("one_dof", kind) for kind in (DIRECT, ADAPTIVE))
    no_delay = evidence("one_dof", ADAPTIVE, NO_DELAY)
    mm_s, mN = (1e3, "mm/s"), (1e3, "mN")
    d_over, a_over = (
        run.Number("puncture.velocity_overshoot") for run in (direct, adaptive)
    )
    d_force, a_force = (run.Number("puncture.force") for run in (direct, adaptive))
    d_back, a_back = (
        run.Number("collision.rebound_velocity") for run in (direct, adaptive)
    )
    d_first, a_first = (
        run.Number("collision.initial_impact_force") for run in (direct, adaptive)
    )
    d_peak, a_peak = (run.Number("collision.peak_force") for run in (direct, adaptive))
    d_start, a_start = (run["start_velocity_overshoot"] for run in (direct, adaptive))
    d_rms, a_rms = (run["velocity_rms_error"][0] for run in (direct, adaptive))
    d_hits, a_hits = (
        len(run.recording.EventTimes("contact")) for run in (direct, adaptive)
    )
    d_jump, a_jump = (LargestJump(run.recording) for run in (direct, adaptive))
    d_speed, a_speed = (run.Number("puncture.velocity") for run in (direct, adaptive))
    d_settling, a_settling = (
        run["collision.settling_time"] for run in (direct, adaptive)
    )
    v_d = 1e-3
    fitted = "Psi0 is fitted to this number; see the sensitivity study."
    loose = (
        "Ours is converged and agrees with a second solver. Loose tolerances scatter "
        "widely here, see the solver study."
    )
    scenario = adaptive.recording.scenario
    weights = [adaptive.recording[f"weights_{i}"][0] for i in (1, 3)]
    unlearned = UnlearnedShare(adaptive.recording)
    far = FarShare(adaptive.recording)
    section = "section 4.2"
    fig1, fig2, fig3 = (f"{section}, Fig. 4.{i}" for i in (1, 2, 3))
    bone = scenario.environment.layers[-1].stiffness
    undamped = v_d * math.sqrt(bone * (scenario.robot.mass or 0.0))
    return [
        Number(
            "4-direct-overshoot",
            fig1,
            "Velocity overshoot after the puncture, direct force.",
            0.472e-3,
            d_over,
            0.01,
            mm_s,
            (d_over > 0, "there is one"),
            "No free parameter.",
        ),
        Number(
            "4-adaptive-overshoot",
            fig1,
            "Velocity overshoot after the puncture, adaptive.",
            0.26e-3,
            a_over,
            0.05,
            mm_s,
            (0 < a_over < d_over, "less than with direct force"),
            fitted,
        ),
        Number(
            "4-overshoot-reduction",
            f"{section}; 1 - 0.26/0.472 is 44.9 %",
            "The adaptive controller reduces that overshoot by 44 %.",
            0.44,
            1 - a_over / d_over,
            5.0,
            (1e2, "%"),
            (a_over < d_over, "there is a reduction"),
            fitted,
            is_absolute=True,
        ),
        Number(
            "4-direct-puncture-force",
            fig2,
            "Sensed force at the puncture, direct force.",
            5.72e-4,
            d_force,
            0.01,
            mN,
            (abs(d_force / a_force - 1) < 0.01, "the same in both"),
            "No free parameter.",
        ),
        Number(
            "4-adaptive-puncture-force",
            fig2,
            "Sensed force at the puncture, adaptive.",
            5.72e-4,
            a_force,
            0.01,
            mN,
            (abs(d_force / a_force - 1) < 0.01, "the same in both"),
            "Both arrive with almost v_d, and k x + d v is then the same.",
        ),
        Truth(
            "4-same-at-puncture",
            fig2,
            "Speed, and with it the sensed force, is the same in both at the puncture.",
            "both differ by less than 1 %",
            abs(d_force / a_force - 1) < 0.01 and abs(d_speed / a_speed - 1) < 0.01,
            f"speed: {Pair(d_speed, a_speed, 1e3, 'mm/s')}; "
            f"force: {Pair(d_force, a_force, 1e3, 'mN')}",
            "",
        ),
        Number(
            "4-direct-rebound",
            f"{section}, Fig. 4.1",
            "Most negative velocity at the collision, direct force.",
            -0.72e-3,
            d_back,
            0.05,
            mm_s,
            (d_back < a_back < 0, "it rebounds, faster than adaptive"),
            loose,
        ),
        Number(
            "4-adaptive-rebound",
            f"{section}, Fig. 4.1",
            "Most negative velocity at the collision, adaptive.",
            -0.658e-3,
            a_back,
            0.05,
            mm_s,
            (d_back < a_back < 0, "it rebounds, slower than direct force"),
            "Follows from the fit of Psi0 to the overshoot.",
        ),
        Number(
            "4-rebound-reduction",
            f"{section}; 1 - 0.658/0.72 is 8.6 %",
            "The adaptive controller reduces the rebound by 9 %.",
            0.09,
            1 - a_back / d_back,
            5.0,
            (1e2, "%"),
            (d_back < a_back < 0, "there is a reduction"),
            "With the converged value of direct force the reduction is larger.",
            is_absolute=True,
        ),
        Number(
            "4-direct-first-impact",
            fig2,
            "Largest force of the first impact, direct force.",
            7.78e-3,
            d_first,
            0.05,
            mN,
            (d_first < a_first, "less than that of the adaptive controller"),
            f"{loose} v_d sqrt(k m) is {1e3 * undamped:.3g} mN.",
        ),
        Number(
            "4-adaptive-first-impact",
            fig2,
            "Largest force of the first impact, adaptive.",
            9.42e-3,
            a_first,
            0.05,
            mN,
            (a_first < d_peak, "less than the largest force of direct force"),
            "Follows from the fit of Psi0 to the overshoot.",
        ),
        Number(
            "4-direct-largest-force",
            fig2,
            "Largest force of all, direct force.",
            0.0113,
            d_peak,
            0.05,
            mN,
            (d_peak > a_peak, "more than that of the adaptive controller"),
            loose,
        ),
        Number(
            "4-adaptive-largest-force",
            fig2,
            "Largest force of all, adaptive.",
            9.42e-3,
            a_peak,
            0.05,
            mN,
            (a_peak < d_peak, "less than that of direct force"),
            "",
        ),
        Number(
            "4-force-reduction",
            f"{section}; 1 - 9.42/11.3 is 16.6 %",
            "The adaptive controller reduces the largest force by 16 %.",
            0.16,
            1 - a_peak / d_peak,
            5.0,
            (1e2, "%"),
            (a_peak < d_peak, "there is a reduction"),
            "With the converged value of direct force the reduction is larger.",
            is_absolute=True,
        ),
        Truth(
            "4-first-impact-order",
            section,
            "The adaptive controller's first impact is harder than that of direct "
            "force, but its largest force is that of the first impact, and lower.",
            "direct first < adaptive first = adaptive largest < direct largest",
            d_first < a_first < d_peak and math.isclose(a_first, a_peak),
            f"first: {Pair(d_first, a_first, 1e3, 'mN')}; "
            f"largest: {Pair(d_peak, a_peak, 1e3, 'mN')}",
            "",
        ),
        Truth(
            "4-direct-start-overshoot",
            fig1,
            "Direct force overshoots the commanded velocity at the start.",
            "by more than 5 % of v_d before the puncture",
            d_start > 0.05 * v_d,
            f"{d_start / v_d:.1%}",
            "",
        ),
        Truth(
            "4-no-start-overshoot",
            f"{section}, 6.1",
            "The adaptive controller does not overshoot at the start.",
            "less than 1 % of v_d before the puncture",
            a_start < 0.01 * v_d,
            f"{a_start / v_d:.1%}",
            "The surgeon's loop overshoots, not the controller: the haptic device "
            "integrates the error for the 0.2 s until the tool's velocity is felt. "
            f"Without delay it is {no_delay['start_velocity_overshoot'] / v_d:.1%}.",
        ),
        Truth(
            "4-tracking",
            fig1,
            "The adaptive controller tracks the velocity much better.",
            "at most half the rms of v - v_d(t - T_f) over the run",
            a_rms <= d_rms / 2,
            Pair(d_rms, a_rms, 1e3, "mm/s"),
            "",
        ),
        Truth(
            "4-settling",
            f"{section}, 6.1",
            "The adaptive controller settles much faster on the bone.",
            "it comes to rest (5 % of v_d) in at most half the time of direct force",
            a_settling is not None
            and (d_settling is None or a_settling <= d_settling / 2),
            f"direct {Seconds(d_settling)}, adaptive {Seconds(a_settling)}",
            "Direct force pushes with a constant force on a spring without damping.",
        ),
        Truth(
            "4-fewer-oscillations",
            fig2,
            "The tool bounces less on the bone with the adaptive controller.",
            "fewer contacts until the end of the run",
            a_hits < d_hits,
            Pair(d_hits, a_hits, unit="contacts"),
            "",
        ),
        Truth(
            "4-smooth",
            fig3,
            "The adaptive controller's force is smooth.",
            "its largest jump is below 1 % of that of direct force",
            a_jump < 0.01 * d_jump,
            Pair(d_jump, a_jump, 1e3, "mN"),
            "It is a state, so it cannot jump. It moves more, though: total variation "
            + Pair(
                direct["control_force_variation"][0],
                adaptive["control_force_variation"][0],
                1e3,
                "mN.",
            ),
        ),
        Truth(
            "4-far-centres",
            f"{section}, Fig. 4.4 and 4.6",
            "Basis functions far from the tool hardly influence the networks.",
            "those more than two widths away say less than 10 % of the sum of "
            "|w_i phi_i|",
            far < 0.1,
            f"{far:.2%}",
            "So by construction: there phi_i is below 2 %.",
        ),
        Truth(
            "4-adapts-quickly",
            "section 6.1",
            "The networks adapt quickly to the unknown environment.",
            "the third network leaves less than half of dF_e/dt (rms) unlearned",
            unlearned < 0.5,
            f"{unlearned:.1%} unlearned",
            "At an adaptation rate of 0.1 the networks stay almost silent; see the "
            "run without adaptation.",
        ),
        Truth(
            "4-no-switching",
            "section 1.5",
            "The controller is not switched between layers, and nothing is trained "
            "beforehand.",
            "its force does not jump at any layer, and all weights start at 0",
            a_jump < 1e-12 and not any(w.any() for w in weights),
            f"largest jump {a_jump:.2g} N, "
            f"largest first weight {max(np.abs(w).max() for w in weights):.2g}",
            "By construction: the law does not know the layers.",
        ),
    ]

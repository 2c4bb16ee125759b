"""Chapter 5, two degrees of freedom: case I, and claims on several cases."""

from functools import partial

import numpy as np

from teleop_drake.thesis.claims.claim import (
    Claim,
    Compared,
    Found,
    NetworksLearn,
    Seconds,
)
from teleop_drake.thesis.claims.learning import UnrepresentedShare
from teleop_drake.thesis.claims.measures import (
    Amplitude,
    During,
)
from teleop_drake.thesis.claims.relation import Pair, Relation
from teleop_drake.thesis.runs import ADAPTIVE, DIRECT, TASKS, ThesisRuns

V_D = 0.1
"""The velocity along x that the surgeon commands, m/s."""

CASES = dict(zip(("I", "II", "III"), TASKS[1:], strict=True))


def _SmoothStart(runs: ThesisRuns) -> Found:
    run = Compared(runs, CASES["I"]).adaptive
    puncture = run.Number("puncture.time")
    late = float(Amplitude(run.recording, puncture - 1.0, puncture)[0])
    return Found(late < 0.05 * V_D, f"{late / V_D:.1%}")


def _DirectOscillates(runs: ThesisRuns) -> Found:
    run = Compared(runs, CASES["I"]).direct
    recording = run.recording
    puncture = run.Number("puncture.time")
    v_x = recording["tool_velocity"][:, 0]
    is_above = v_x[During(recording, 0.0, puncture)] > V_D
    crossings = int(np.count_nonzero(np.diff(is_above)))
    swing = float(np.ptp(v_x[During(recording, puncture - 1.0, puncture)]))
    text = f"{crossings} crossings, {swing / V_D:.0%} of v_d"
    return Found(crossings >= 3 and swing > 0.2 * V_D, text)


def _DirectFaster(runs: ThesisRuns) -> Found:
    direct, adaptive = Compared(runs, CASES["I"]).Numbers("puncture.velocity")
    holds = direct > adaptive + 0.05 * V_D
    return Found(holds, Pair(direct, adaptive, "m/s"))


def _DirectDiverges(runs: ThesisRuns) -> Found:
    full = runs(CASES["I"], DIRECT)
    inside = Compared(runs, CASES["I"]).direct
    recording = inside.recording
    puncture = inside.Number("puncture.time")
    end = float(recording.time[-1])
    early = float(Amplitude(recording, puncture, puncture + 1.0)[1])
    late = float(Amplitude(recording, end - 1.0, end)[1])
    return Found(
        full["diverged"] and late > 2 * early,
        f"amplitude of v_y {early:.3g} to {late:.3g} m/s, "
        f"ended at {Seconds(full['diverged_at'])}",
    )


def _NoForceAlongY(runs: ThesisRuns) -> Found:
    forces = [
        run.recording["environment_force"][:, 1]
        for name in CASES.values()
        for run in runs.OfBoth(name)
    ]
    largest = max(float(np.abs(F).max()) for F in forces)
    return Found(largest == 0.0, f"largest {largest:g} N")


def _MoreFunctions(runs: ThesisRuns) -> Found:
    recordings = [runs(name, ADAPTIVE).recording for name in TASKS]
    five, nine = (
        [UnrepresentedShare(run, count=count) for run in recordings] for count in (5, 9)
    )
    return Found(
        all(b < a for a, b in zip(five[1:], nine[1:], strict=True)),
        "; ".join(
            f"{case}: {a:.0%}, {b:.0%}"
            for case, a, b in zip(CASES, five[1:], nine[1:], strict=True)
        ),
        f"On one axis {nine[0]:.0%} is left with either: dF_e/dt is no function of the "
        "position.",
    )


CLAIMS = [
    Claim(
        key="5-I-smooth-start",
        place="section 5.2, case I, Fig. 5.1",
        claim="Adaptive reaches the commanded velocity in the tissue, smoothly.",
        criterion="|v_x - v_d| below 5 % of v_d in the last second before the puncture",
        measure=_SmoothStart,
    ),
    Claim(
        key="5-I-no-overshoot",
        place="section 5.2, case I, Fig. 5.1",
        claim="Adaptive does so without any overshoot.",
        criterion="v_x exceeds v_d by less than 1 % of it before the puncture",
        reason="As with one axis, the surgeon's loop overshoots.",
        task=CASES["I"],
        relations=[Relation("start_velocity_overshoot", factor=0.01, of="speed")],
    ),
    Claim(
        key="5-I-direct-oscillates",
        place="section 5.2, case I, Fig. 5.1",
        claim="Direct force oscillates about the commanded velocity in the tissue.",
        criterion=(
            "v_x crosses v_d three times or more, and still swings by 20 % of "
            "v_d in the last second before the puncture"
        ),
        measure=_DirectOscillates,
    ),
    Claim(
        key="5-I-direct-faster",
        place="section 5.2, case I, Fig. 5.1",
        claim="Direct force is faster at the puncture.",
        criterion="by more than 5 % of v_d",
        reason="Where in its swing the puncture comes is a matter of the task.",
        measure=_DirectFaster,
    ),
    Claim(
        key="5-I-direct-diverges",
        place="section 5.2, case I, Fig. 5.1",
        claim="Direct force diverges after the puncture.",
        criterion=(
            "it exceeds five times v_d in the end, and |v_y| has at least "
            "doubled before x = 1.4 m, one second against another"
        ),
        reason=(
            "The loop of haptic device and 0.2 s tolerates 4.7 1/kg in free "
            "space; M_r^-1 of the arm has an eigenvalue of 6. The stretched "
            "arm, at 1.5 m, ends either run soon after."
        ),
        measure=_DirectDiverges,
    ),
    Claim(
        key="5-I-tracking",
        place="section 5.2, case I, Fig. 5.1",
        claim="Adaptive tracks the velocity very well compared with direct force.",
        criterion=(
            "less than half the rms of v - v_d(t - T_f) of direct force on both"
            " axes, inside the workspace"
        ),
        task=CASES["I"],
        relations=[Relation("velocity_rms_error", "m/s", factor=0.5)],
    ),
    Claim(
        key="5-I-less-force",
        place="section 5.2, case I, Fig. 5.3",
        claim="Adaptive needs less control force.",
        criterion="lower peak on every axis, inside the workspace",
        reason=(
            "The backstepping law pushes hard at the start and stops the "
            "bouncing with force."
        ),
        task=CASES["I"],
        relations=[Relation("control_force_peak", "N")],
    ),
    Claim(
        key="5-I-less-variation",
        place="section 5.2, case I, Fig. 5.3",
        claim="The adaptive controller's force is the smoother one: it moves less.",
        criterion="lower total variation on every axis, inside the workspace",
        task=CASES["I"],
        relations=[Relation("control_force_variation", "N")],
    ),
    Claim(
        key="5-I-networks",
        place="section 5.2, case I, Fig. 5.4 to 5.6",
        claim="The networks work well and adapt quickly.",
        criterion="the third network leaves less than half of dF_e/dt (rms) unlearned",
        reason="As with one axis, they stay almost silent.",
        measure=partial(NetworksLearn, task="two_dof_puncture"),
    ),
    Claim(
        key="5-no-force-along-y",
        place="section 5.2, Fig. 5.2, 5.8, 5.15",
        claim="The sensed force along y is zero in all cases.",
        criterion="exactly, in all six runs",
        reason="By construction: the environment pushes along x only.",
        measure=_NoForceAlongY,
    ),
    Claim(
        key="5-more-functions",
        place="section 5.2, after (5.50)",
        claim=(
            "An appropriate number of basis functions reduces the approximation error."
        ),
        criterion=(
            "with 9 functions per axis in the place of 5, constant weights "
            "chosen in hindsight leave less of dF_e/dt (rms), in cases I to III"
        ),
        reason="What can be represented is not what is learned: see 5-I-networks.",
        measure=_MoreFunctions,
    ),
]

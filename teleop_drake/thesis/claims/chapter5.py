"""Chapter 5: two degrees of freedom, cases I to III."""

import itertools

import numpy as np

from teleop_drake.thesis.claims.claim import (
    Compared,
    Found,
    Listed,
    Measures,
    Pair,
    Seconds,
    Shares,
)
from teleop_drake.thesis.claims.learning import UnrepresentedShare
from teleop_drake.thesis.claims.measures import (
    Amplitude,
    During,
    FirstEvent,
    ImpactForces,
    PathError,
    RiseTime,
    UnlearnedShare,
)
from teleop_drake.thesis.runs import ADAPTIVE, DIRECT, TASKS, Both, Delay, ThesisRuns

_V_D = 0.1
"""What the surgeon commands along x, m/s."""

_CASES = dict(zip(("I", "II", "III"), TASKS[1:], strict=True))
_SETTLING = "collision.settling_time"


def _Both(runs: ThesisRuns, case: str) -> Both:
    return Compared(runs, _CASES[case])


# Case I.


@Measures("5-I-smooth-start")
def _SmoothStart(runs: ThesisRuns) -> Found:
    run = _Both(runs, "I").adaptive
    puncture = run.Number("puncture.time")
    late = float(Amplitude(run.recording, puncture - 1.0, puncture)[0])
    return Found(late < 0.05 * _V_D, f"{late / _V_D:.1%}")


@Measures("5-I-no-overshoot")
def _NoOvershoot(runs: ThesisRuns) -> Found:
    start = float(_Both(runs, "I").adaptive["start_velocity_overshoot"])
    return Found(start < 0.01 * _V_D, f"{start / _V_D:.1%}")


@Measures("5-I-direct-oscillates")
def _DirectOscillates(runs: ThesisRuns) -> Found:
    run = _Both(runs, "I").direct
    recording, puncture = run.recording, run.Number("puncture.time")
    v_x = recording["tool_velocity"][:, 0]
    is_above = v_x[During(recording, 0.0, puncture)] > _V_D
    crossings = int(np.count_nonzero(np.diff(is_above)))
    swing = float(np.ptp(v_x[During(recording, puncture - 1.0, puncture)]))
    text = f"{crossings} crossings, {swing / _V_D:.0%} of v_d"
    return Found(crossings >= 3 and swing > 0.2 * _V_D, text)


@Measures("5-I-direct-faster")
def _DirectFaster(runs: ThesisRuns) -> Found:
    direct, adaptive = _Both(runs, "I").Numbers("puncture.velocity")
    holds = direct > adaptive + 0.05 * _V_D
    return Found(holds, Pair(direct, adaptive, "m/s"))


@Measures("5-I-direct-diverges")
def _DirectDiverges(runs: ThesisRuns) -> Found:
    full, inside = runs(_CASES["I"], DIRECT), _Both(runs, "I").direct
    recording = inside.recording
    puncture, end = inside.Number("puncture.time"), float(recording.time[-1])
    early = float(Amplitude(recording, puncture, puncture + 1.0)[1])
    late = float(Amplitude(recording, end - 1.0, end)[1])
    return Found(
        full["diverged"] and late > 2 * early,
        f"amplitude of v_y {early:.3g} to {late:.3g} m/s, "
        f"ended at {Seconds(full['diverged_at'])}",
    )


@Measures("networks")
def _Networks(runs: ThesisRuns, task: str) -> Found:
    share = UnlearnedShare(runs(task, ADAPTIVE).recording)
    return Found(share < 0.5, f"{share:.1%} unlearned")


@Measures("5-no-force-along-y")
def _NoForceAlongY(runs: ThesisRuns) -> Found:
    forces = [
        run.recording["environment_force"][:, 1]
        for name in _CASES.values()
        for run in runs.OfBoth(name)
    ]
    largest = max(float(np.abs(F).max()) for F in forces)
    return Found(largest == 0.0, f"largest {largest:g} N")


@Measures("5-more-functions")
def _MoreFunctions(runs: ThesisRuns) -> Found:
    recordings = [runs(name, ADAPTIVE).recording for name in TASKS]
    five, nine = (
        [UnrepresentedShare(run, count=count) for run in recordings] for count in (5, 9)
    )
    return Found(
        all(b < a for a, b in zip(five[1:], nine[1:], strict=True)),
        "; ".join(
            f"{case}: {a:.0%}, {b:.0%}"
            for case, a, b in zip(_CASES, five[1:], nine[1:], strict=True)
        ),
        f"On one axis {nine[0]:.0%} is left with either: dF_e/dt is no function of the "
        "position.",
    )


# Cases II and III.


@Measures("5-{case}-direct-never-converges")
def _NeverConverges(runs: ThesisRuns, case: str) -> Found:
    direct, adaptive = (run[_SETTLING] for run in _Both(runs, case))
    text = f"direct {Seconds(direct)}, adaptive {Seconds(adaptive)}"
    return Found(direct is None and adaptive is not None, text)


@Measures("5-{case}-lower-first-impact")
def _LowerFirstImpact(runs: ThesisRuns, case: str) -> Found:
    both = _Both(runs, case)
    direct, adaptive = both.Numbers("collision.initial_impact_force")
    speeds = Pair(*both.Numbers("collision.velocity"), "m/s")
    return Found(
        adaptive <= 0.75 * direct,
        Pair(direct, adaptive, "N"),
        f"Speed at the contact: {speeds}.",
    )


@Measures("5-{case}-direct-position")
def _DirectPosition(runs: ThesisRuns, case: str) -> Found:
    direct, adaptive = (PathError(run.recording) for run in _Both(runs, case))
    return Found(
        (direct < 0.15).all(),
        Shares(direct),
        f"Adaptive: {Shares(adaptive)}.",
    )


@Measures("5-{case}-direct-unstable-{axis}")
def _DirectUnstable(runs: ThesisRuns, case: str, axis: str) -> Found:
    recording = _Both(runs, case).direct.recording
    contact, end = FirstEvent(recording, "contact"), float(recording.time[-1])
    p = recording["tool_position"][:, "xy".index(axis)]
    away = np.abs(p - p[np.searchsorted(recording.time, contact)])
    windows = ((contact, contact + 2.0), (end - 2.0, end))
    early, late = (float(away[During(recording, *x)].max()) for x in windows)
    return Found(late >= 1.1 * early, f"first {early:.3g}, last {late:.3g} m")


@Measures("5-{case}-sluggish")
def _Sluggish(runs: ThesisRuns, case: str) -> Found:
    direct, adaptive = (RiseTime(run.recording) for run in _Both(runs, case))
    return Found(adaptive > direct, Pair(direct, adaptive, "s"))


@Measures("5-{case}-stable-on-bone")
def _StableOnBone(runs: ThesisRuns, case: str) -> Found:
    recording = _Both(runs, case).adaptive.recording
    asked = float(np.asarray(recording.teleoperation.surgeon.contact_force)[0])
    force = float(recording["environment_force"][-1, 0])
    speed = float(np.linalg.norm(recording["tool_velocity"][-1]))
    text = f"{force:.4g} N of {asked:g} N, {speed:.2g} m/s"
    return Found(abs(force / asked - 1) < 0.01 and speed < 0.01 * _V_D, text)


@Measures("5-II-damps-out")
def _DampsOut(runs: ThesisRuns) -> Found:
    run = _Both(runs, "II").adaptive
    hits, settling = ImpactForces(run.recording), run[_SETTLING]
    return Found(
        settling is not None and all(b < a for a, b in itertools.pairwise(hits)),
        f"{Listed(hits)} N; settled after {Seconds(settling)}",
    )


@Measures("5-II-direct-impacts-grow")
def _DirectImpactsGrow(runs: ThesisRuns) -> Found:
    hits = ImpactForces(_Both(runs, "II").direct.recording)
    holds = len(hits) > 1 and min(hits[1:]) > hits[0]
    return Found(holds, f"{Listed(hits)} N")


@Measures("5-II-larger-gains")
def _LargerGains(runs: ThesisRuns) -> Found:
    gains = [{"controller.G1": 4.0 * x, "controller.G2": 30.0 * x} for x in (1.5, 2)]
    times, errors = [], []
    for delay in ({}, Delay(0.0)):
        tried = [runs(_CASES["II"], ADAPTIVE, x, delay) for x in ({}, *gains)]
        times.append(", ".join(Seconds(x[_SETTLING]) for x in tried))
        errors.append([run["velocity_rms_error"][0] for run in tried])
    return Found(
        (np.diff(errors[0]) < 0).all(),
        f"{Listed(errors[0])} m/s; settled after {times[0]}",
        f"It is not the delay: without it the error is {Listed(errors[1])} m/s, and "
        f"the tool settles after {times[1]}.",
    )

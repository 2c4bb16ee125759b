"""Chapter 4: one degree of freedom."""

import math
from functools import partial

import numpy as np

from teleop_drake.channels import CHANNEL_KINDS, NetworkChannelConfig
from teleop_drake.thesis.claims.claim import (
    Claim,
    Found,
    IsLess,
    NetworksLearn,
    Pair,
    Seconds,
)
from teleop_drake.thesis.claims.measures import FarShare, LargestJump
from teleop_drake.thesis.runs import ADAPTIVE, Both, Delay, ThesisRuns

_V_D = 1e-3
"""What the surgeon commands, m/s."""

_START = "start_velocity_overshoot"


def _Both(runs: ThesisRuns) -> Both:
    return runs.OfBoth("one_dof")


def _Number(runs: ThesisRuns, metric: str, which: str, in_kind: str) -> Found:
    direct, adaptive = _Both(runs).Numbers(metric)
    holds = {
        "larger with direct force": direct > adaptive,
        "smaller with direct force": direct < adaptive,
        "more negative with direct force": direct < adaptive < 0,
        "the same in both": abs(direct / adaptive - 1) < 0.01,
    }
    return Found(holds[in_kind], direct if which == "direct" else adaptive)


def _Reduction(runs: ThesisRuns, metric: str) -> Found:
    direct, adaptive = _Both(runs).Numbers(metric)
    return Found(abs(adaptive) < abs(direct), 1 - adaptive / direct)


def _SameAtPuncture(runs: ThesisRuns) -> Found:
    both = _Both(runs)
    speeds, forces = (both.Numbers(f"puncture.{x}") for x in ("velocity", "force"))
    text = f"speed: {Pair(*speeds, 'mm/s')}; force: {Pair(*forces, 'mN')}"
    return Found(all(abs(a / b - 1) < 0.01 for a, b in (speeds, forces)), text)


def _ImpactOrder(runs: ThesisRuns) -> Found:
    both = _Both(runs)
    first = both.Numbers("collision.initial_impact_force")
    largest = both.Numbers("collision.peak_force")
    return Found(
        first[0] < first[1] < largest[0] and math.isclose(first[1], largest[1]),
        f"first: {Pair(*first, 'mN')}; largest: {Pair(*largest, 'mN')}",
    )


def _DirectStartOvershoot(runs: ThesisRuns) -> Found:
    ours = _Both(runs).direct[_START] / _V_D
    return Found(ours > 0.05, f"{ours:.1%}")


def _NoStartOvershoot(runs: ThesisRuns) -> Found:
    ours = _Both(runs).adaptive[_START] / _V_D
    no_delay = runs.Short("one_dof", ADAPTIVE, Delay(0.0))[_START] / _V_D
    return Found(
        ours < 0.01,
        f"{ours:.1%}",
        "The surgeon's loop overshoots, not the controller: the haptic device "
        "integrates the error for the 0.2 s until the tool's velocity is felt. Without "
        f"delay it is {no_delay:.1%}.",
    )


def _Settling(runs: ThesisRuns) -> Found:
    both = _Both(runs)
    direct, adaptive = (run["collision.settling_time"] for run in both)
    observed = both.direct.recording.time[-1] - both.direct["collision.time"]
    text = f"direct {Seconds(direct)}, adaptive {Seconds(adaptive)}"
    return Found(
        adaptive is not None and (direct is None or adaptive <= direct / 2),
        text.replace("never", f"not within {observed:.2g} s"),
    )


def _Smooth(runs: ThesisRuns) -> Found:
    both = _Both(runs)
    direct, adaptive = (LargestJump(run) for run in both)
    moved = tuple(float(run["control_force_variation"][0]) for run in both)
    return Found(
        adaptive < 0.01 * direct,
        Pair(direct, adaptive, "mN"),
        f"It moves more, though: total variation {Pair(moved[0], moved[1], 'mN')}.",
    )


def _FarCentres(runs: ThesisRuns) -> Found:
    share = FarShare(_Both(runs).adaptive.recording)
    return Found(share < 0.1, f"{share:.2%}")


def _NoSwitching(runs: ThesisRuns) -> Found:
    run = _Both(runs).adaptive
    jump = LargestJump(run)
    first = max(np.abs(run.recording[f"weights_{i}"][0]).max() for i in (1, 3))
    text = f"largest jump {jump:.2g} N, largest first weight {first:.2g}"
    return Found(jump < 1e-12 and first == 0, text)


def _DelayOfChannels(runs: ThesisRuns) -> Found:
    trips = {
        kind.kind: 2 * kind().delay
        for kind in CHANNEL_KINDS.kinds
        if issubclass(kind, NetworkChannelConfig) and kind is not NetworkChannelConfig
    }
    text = ", ".join(f"{name} {trip:.3g} s" for name, trip in trips.items())
    return Found(None, text)

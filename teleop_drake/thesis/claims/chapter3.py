"""Chapter 3: a network that learns a disturbance."""

import math

import numpy as np

from teleop_drake.thesis.claims.claim import Found, Measures, Shares
from teleop_drake.thesis.claims.measures import Late, Rms
from teleop_drake.thesis.runs import NETWORKS, NO_ADAPTATION, Run, ThesisRuns

_CASES = dict(zip(("I", "II"), NETWORKS, strict=True))


@Measures("3-{case}-{which}-{axis}")
def _Error(runs: ThesisRuns, case: str, which: str, axis: str, printed: float) -> Found:
    ours = runs(_CASES[case])[f"{which}_error"]["xz".index(axis)]
    return Found(printed / 2 <= 1e3 * ours <= 2 * printed, ours)


@Measures("3-{case}-error-vanishes")
def _ErrorVanishes(runs: ThesisRuns, case: str) -> Found:
    recording = runs(_CASES[case]).recording
    error = recording["tool_position"] - recording["desired_position"]
    late = Late(recording, error) / np.abs(error).max(axis=0)
    return Found((late < 0.1).all(), Shares(late, "xz"))


@Measures("3-{case}-network-adapts")
def _NetworkAdapts(runs: ThesisRuns, case: str) -> Found:
    recording = runs(_CASES[case]).recording
    F_e = recording["environment_force"]
    unlearned = Late(recording, F_e - recording["disturbance_estimate"])
    rest = float(np.linalg.norm(unlearned) / np.linalg.norm(Late(recording, F_e)))
    return Found(rest < 0.1, f"{rest:.1%}")


@Measures("3-coarse-estimate")
def _CoarseEstimate(runs: ThesisRuns) -> Found:
    run, silent = runs(NETWORKS[0]), runs(NETWORKS[0], NO_ADAPTATION)
    force = np.linalg.norm(run.recording["environment_force"], axis=1)
    off = math.hypot(*run["disturbance_rms_error"]) / Rms(run.recording, force)
    x, z = _Ratios("rms_error", run, silent)
    text = f"off by {off:.0%}; without it x {x:.2f} times, z {z:.2f} times the error"
    return Found(off >= 0.1 and min(x, z) >= 2, text)


@Measures("3-slightly-more")
def _SlightlyMore(runs: ThesisRuns) -> Found:
    pair = [runs(name) for name in NETWORKS]
    growth = [x for name in ("max_error", "rms_error") for x in _Ratios(name, *pair)]
    factors = ", ".join(f"{x:.2f}" for x in growth)
    return Found(max(growth) < 1.5, f"growth by the factors {factors}")


@Measures("3-less-accurate")
def _LessAccurate(runs: ThesisRuns) -> Found:
    errors = {
        case: runs(name)["disturbance_rms_error"] for case, name in _CASES.items()
    }
    return Found(
        all(b > a for a, b in zip(*errors.values(), strict=True)),
        "; ".join(f"{case}: x {x:.3g}, z {z:.3g} N" for case, (x, z) in errors.items()),
    )


@Measures("3-larger-gain")
def _LargerGain(runs: ThesisRuns) -> Found:
    ratios = [
        x
        for name in NETWORKS
        for x in _Ratios("rms_error", runs(name), runs(name, {"controller.G1": 4.0}))
    ]
    factors = ", ".join(f"{x:.2f}" for x in ratios)
    return Found(max(ratios) < 1, f"by the factors {factors}")


def _Ratios(metric: str, one: Run, other: Run) -> list[float]:
    """Returns how many times as large the other's metric is on each axis."""
    return [b / a for a, b in zip(one[metric], other[metric], strict=True)]


@Measures("3-effects-of-delay")
def _EffectsOfDelay(runs: ThesisRuns) -> Found:
    scenario = runs(NETWORKS[0]).recording.scenario
    channels = [x for x in vars(scenario) if x.endswith("_channel")]
    return Found(bool(channels), f"{len(channels)} channels")
